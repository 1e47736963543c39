//! Where the bytes of an upload go that may go on: into its file, or with an object store into one object
//! after the other.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::FileExt;
use std::path::PathBuf;

use bytes::BytesMut;
use tempfile::NamedTempFile;

use crate::folder::{UPLOADS, in_folder};
use crate::http::AppState;
use crate::http::upload::blocking;
use crate::http::upload::parts::{Target, path};
use crate::http::upload::spool::storage;
use crate::http::wire::error::{ApiError, Code, Result};
use crate::jobs::UploadId;

/// Bytes behind those that count.
pub(super) struct Sink {
    place: Place,
    /// Bytes of the upload that are written.
    at: u64,
    /// Bytes of the upload before the file.
    before: u64,
}

enum Place {
    /// The file of the upload.
    Own(File),
    /// The next part, on its way to the object store.
    Part(NamedTempFile),
}

impl Sink {
    /// Behind so many bytes of an upload.
    ///
    /// # Errors
    /// [`Code::Gone`] where they are not there any more, and those of the disk.
    pub(super) async fn open(app: &AppState, id: &UploadId, from: u64) -> Result<Self> {
        let (own, parts) = (path(app, id), app.config.data_dir.join(UPLOADS));
        let opened = if app.store.keeps_files() {
            blocking(move || own_file(own, from)).await?
        } else {
            let part = blocking(move || in_folder(&parts, || NamedTempFile::new_in(&parts)));
            part.await?.map(|part| Some((Place::Part(part), from)))
        };
        let opened = opened.map_err(|error| storage(&error))?;
        let (place, before) = opened.ok_or_else(|| {
            let detail = "bytes of the upload are not there any more; begin a new one";
            ApiError::new(Code::Gone, detail)
        })?;
        Ok(Self {
            place,
            at: from,
            before,
        })
    }

    /// Bytes of the upload that are written.
    pub(super) fn at(&self) -> u64 {
        self.at
    }

    /// Writes further bytes.
    ///
    /// # Errors
    /// Those of the disk.
    pub(super) async fn write(mut self, batch: BytesMut) -> Result<Self> {
        let written = blocking(move || {
            self.file().write_all_at(&batch, self.at - self.before)?;
            self.at += batch.len() as u64;
            Ok(self)
        });
        written.await?.map_err(|error: io::Error| storage(&error))
    }

    /// Counts what was written, once it is where it stays.
    ///
    /// # Errors
    /// Those of the disk, the database and the object store.
    pub(super) async fn commit(mut self, app: &AppState, target: &mut Target<'_>) -> Result<Self> {
        let part = match &self.place {
            Place::Own(_) => None,
            Place::Part(part) => Some(part.path().to_owned()),
        };
        if part.is_none() {
            let synced = blocking(move || self.file().sync_data().map(|()| self));
            self = synced.await?.map_err(|error: io::Error| storage(&error))?;
        }
        target.count(app, self.at, part.as_deref()).await?;
        if part.is_some() {
            self.file().set_len(0).map_err(|error| storage(&error))?;
            self.before = self.at;
        }
        Ok(self)
    }

    fn file(&self) -> &File {
        match &self.place {
            Place::Own(file) => file,
            Place::Part(part) => part.as_file(),
        }
    }
}

/// The file of an upload, cut to the bytes that count; none if it does not have them.
fn own_file(path: PathBuf, from: u64) -> io::Result<Option<(Place, u64)>> {
    let file = match OpenOptions::new().write(true).open(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        file => file?,
    };
    if file.metadata()?.len() < from {
        return Ok(None);
    }
    file.set_len(from)?;
    Ok(Some((Place::Own(file), 0)))
}
