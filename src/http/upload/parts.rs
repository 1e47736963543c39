//! Uploads that may go on after they were cut: their files, and whose turn it is.
//!
//! The newest request for an upload wins. A client that comes again believes its last request dead,
//! while the service may still wait for bytes of it; so that one is cut, what it brought is kept, and
//! the new one goes on behind it.

use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, Weak};

use axum::body::Body;
use bytes::BytesMut;
use tempfile::{Builder, NamedTempFile};
use tokio::sync::OwnedMutexGuard;
use tokio_util::sync::CancellationToken;

use crate::folder::{RESUMABLE, UPLOADS, in_folder};
use crate::http::AppState;
use crate::http::upload::bodies::BATCH;
use crate::http::upload::sink::Sink;
use crate::http::upload::spool::{Spooled, storage};
use crate::http::upload::{blocking, next, pace};
use crate::http::wire::error::{ApiError, Code, Result};
use crate::identity::Caller;
use crate::jobs::{Step, Upload, UploadId};

/// Bytes that are written before the disk has to have them: so many are sent again at most after a
/// crash of the machine.
const SYNC_BYTES: u64 = 8 << 20;

/// Uploads of which it is remembered who is at work, above which those are dropped where nobody is.
const REMEMBERED: usize = 256;

/// Whose turn it is.
#[derive(Debug, Default)]
pub(in crate::http) struct Turns(Mutex<HashMap<UploadId, Weak<Turn>>>);

#[derive(Debug, Default)]
struct Turn {
    alone: Arc<tokio::sync::Mutex<()>>,
    /// Cut when a newer request comes.
    newest: Mutex<CancellationToken>,
}

/// A request's turn at an upload, until it is dropped.
#[derive(Debug)]
pub(in crate::http) struct Held {
    /// Cancelled when a newer request comes.
    pub(in crate::http) cut: CancellationToken,
    _alone: OwnedMutexGuard<()>,
    _turn: Arc<Turn>,
}

impl Turns {
    /// Cuts the request that is at work on the upload, if one is, and waits until it has ended.
    ///
    /// # Errors
    /// [`Code::UploadTaken`] if a newer one comes meanwhile.
    pub(in crate::http) async fn take(&self, id: &UploadId) -> Result<Held> {
        let turn = self.turn(id);
        let cut = CancellationToken::new();
        {
            let mut newest = turn.newest.lock().unwrap_or_else(PoisonError::into_inner);
            std::mem::replace(&mut *newest, cut.clone()).cancel();
        }
        tokio::select! {
            biased;
            () = cut.cancelled() => Err(taken()),
            alone = Arc::clone(&turn.alone).lock_owned() => Ok(Held {
                cut,
                _alone: alone,
                _turn: turn,
            }),
        }
    }

    fn turn(&self, id: &UploadId) -> Arc<Turn> {
        let mut turns = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(turn) = turns.get(id).and_then(Weak::upgrade) {
            return turn;
        }
        if turns.len() >= REMEMBERED {
            turns.retain(|_, turn| turn.strong_count() > 0);
        }
        let turn = Arc::default();
        turns.insert(id.clone(), Arc::downgrade(&turn));
        turn
    }
}

fn taken() -> ApiError {
    let detail = "a newer request goes on with the upload; ask where it is, and go on from there";
    ApiError::new(Code::UploadTaken, detail)
}

/// Where the bytes of an upload are.
pub(in crate::http) fn path(app: &AppState, id: &UploadId) -> PathBuf {
    app.config.data_dir.join(RESUMABLE).join(id.as_str())
}

/// Makes the empty file of an upload, which survives a loss of power. None is needed with an object store.
///
/// # Errors
/// [`Code::InsufficientStorage`], [`Code::Internal`].
pub(in crate::http) async fn make(app: &AppState, id: &UploadId) -> Result<()> {
    if !app.store.keeps_files() {
        return Ok(());
    }
    let path = path(app, id);
    let made = blocking(move || {
        let folder = path.parent().unwrap_or(Path::new("."));
        let mut options = OpenOptions::new();
        options.write(true).create_new(true).mode(0o600);
        in_folder(folder, || options.open(&path))?;
        File::open(folder)?.sync_all()
    });
    made.await?.map_err(|error| storage(&error))
}

/// Removes the file of an upload whose row is gone, or has what came of it.
pub(in crate::http) async fn remove(app: &AppState, id: &UploadId) {
    match tokio::fs::remove_file(path(app, id)).await {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            // The next start removes files without a row.
            tracing::warn!(error.message = %error, "the file of an upload stays");
        }
        _ => {}
    }
}

/// What a body is appended to.
pub(in crate::http) struct Target<'a> {
    /// In whose name.
    pub(in crate::http) caller: &'a Caller,
    /// The upload; counts the bytes that the disk has.
    pub(in crate::http) upload: &'a mut Upload,
    /// Number of all its bytes, where it is known by now.
    pub(in crate::http) length: Option<u64>,
    /// Ends the request.
    pub(in crate::http) cut: &'a CancellationToken,
}

impl Target<'_> {
    /// Counts bytes that are in place, in the file that is the upload's own or in one that is its next part.
    pub(super) async fn count(
        &mut self,
        app: &AppState,
        to: u64,
        part: Option<&Path>,
    ) -> Result<()> {
        let step = Step {
            from: self.upload.bytes,
            to,
            length: self.length,
            complete: false,
            keep_ms: app.config.upload_keep_ms(),
        };
        let (acts, id) = (app.store.by(self.caller), &self.upload.id);
        *self.upload = match part {
            Some(part) if step.to > step.from => acts.append_part(id, step, part).await?,
            _ => acts.advance_upload(id, step).await?,
        };
        Ok(())
    }
}

/// Appends a body behind the bytes that count. Returns why it ended early, if it did: what came before
/// is kept.
///
/// # Errors
/// When no more can be kept: those of disk and database; [`Code::Gone`] when bytes that count are not
/// there any more.
pub(in crate::http) async fn append(
    app: &AppState,
    mut target: Target<'_>,
    body: Body,
) -> Result<Result<()>> {
    let mut sink = Sink::open(app, &target.upload.id, target.upload.bytes).await?;
    let limit = target.length.unwrap_or(app.config.body_limit_bytes());
    let place = app.bodies.batch();
    let (mut pace, mut stream) = (pace(app), body.into_data_stream());
    let mut batch = BytesMut::new();
    let outcome = loop {
        let chunk = tokio::select! {
            biased;
            () = target.cut.cancelled() => break Err(taken()),
            chunk = next(&mut pace, &mut stream) => chunk,
        };
        match chunk {
            Err(error) => break Err(error),
            Ok(None) => break Ok(()),
            Ok(Some(chunk)) => batch.extend_from_slice(&chunk),
        }
        if sink.at() + batch.len() as u64 > limit {
            batch.clear();
            let detail = "more bytes came than the upload may have";
            break Err(ApiError::new(Code::UploadLength, detail));
        }
        if place.is_none() || batch.len() >= BATCH {
            sink = sink.write(batch.split()).await?;
            if sink.at() - target.upload.bytes >= SYNC_BYTES {
                sink = sink.commit(app, &mut target).await?;
            }
        }
    };
    let sink = sink.write(batch).await?;
    sink.commit(app, &mut target).await?;
    Ok(outcome)
}

/// A complete upload as any other: a temporary file, which is a second name of the same bytes, or a copy of
/// those of the object store. The first ones stay until it is known what came of them.
///
/// # Errors
/// [`Code::InsufficientStorage`], [`Code::Internal`], and those of the store.
pub(in crate::http) async fn spooled(app: &AppState, id: &UploadId) -> Result<Spooled> {
    if !app.store.keeps_files() {
        let (file, sha256) = app.store.upload_file(id).await?;
        let bytes = file.as_file().metadata().map_err(|error| storage(&error))?;
        return Ok(Spooled {
            bytes: bytes.len(),
            sha256,
            file,
        });
    }
    let (path, folder) = (path(app, id), app.config.data_dir.join(UPLOADS));
    let spooled = blocking(move || -> io::Result<Spooled> {
        let link = |to: &Path| {
            // Not every file system has second names.
            std::fs::hard_link(&path, to)
                .or_else(|_| std::fs::copy(&path, to).map(drop))
                .and_then(|()| File::open(to))
        };
        let file: NamedTempFile = in_folder(&folder, || Builder::new().make_in(&folder, link))?;
        Spooled::of(file)
    });
    spooled.await?.map_err(|error| storage(&error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn the_newest_request_has_the_turn() {
        let turns = Turns::default();
        let id = UploadId::at(0);
        let first = turns.take(&id).await.unwrap();
        // Others are not touched.
        drop(turns.take(&UploadId::at(0)).await.unwrap());
        assert!(!first.cut.is_cancelled());
        let mut second = Box::pin(turns.take(&id));
        assert!(futures_util::poll!(&mut second).is_pending());
        assert!(first.cut.is_cancelled());
        let mut third = Box::pin(turns.take(&id));
        assert!(futures_util::poll!(&mut third).is_pending());
        assert_eq!(second.await.unwrap_err().code(), Code::UploadTaken);
        drop(first);
        assert!(!third.await.unwrap().cut.is_cancelled());
    }
}
