//! Files of clouds: in the folder `clouds/`, or with an object store an object each.

use std::fs::File;
use std::io::{ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use bytes::Bytes;
use futures_util::TryStreamExt;
use sha2::{Digest, Sha256};
use tempfile::{NamedTempFile, TempPath};

use super::bucket::Bucket;
use super::objects::{Kept, new_key};
use crate::folder::{CLOUDS, UPLOADS, in_folder};
use crate::jobs::store::Store;
use crate::jobs::{Cloud, Error, Result};

/// An open file with the bytes of a cloud, for as long as this is held.
#[derive(Debug)]
pub struct LocalFile {
    file: File,
    path: PathBuf,
    /// Removes what was fetched.
    fetched: Option<TempPath>,
}

impl LocalFile {
    /// The same without the name of what was fetched: if this process is killed nothing of it stays, and
    /// whoever clears the folder then does not take it away from a child that is still at work.
    #[must_use]
    pub fn unnamed(mut self) -> Self {
        self.fetched = None;
        self
    }

    /// Where it is, while it has its name.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// All of its bytes, with or without a name.
    ///
    /// # Errors
    /// Those of reading.
    pub fn read(&self) -> std::io::Result<Vec<u8>> {
        let mut file = &self.file;
        file.seek(SeekFrom::Start(0))?;
        let mut bytes = Vec::with_capacity(file.metadata()?.len() as usize);
        file.read_to_end(&mut bytes)?;
        Ok(bytes)
    }
}

impl Store {
    /// Whether new clouds are files in the folder `clouds/`, which are the caller's to put there.
    pub fn keeps_files(&self) -> bool {
        self.inner.objects.bucket().is_none()
    }

    /// The file of a cloud in the folder, where it is one.
    pub fn cloud_path(&self, sha256: &str) -> PathBuf {
        self.inner.folder.join(CLOUDS).join(sha256)
    }

    /// A file with the bytes of the cloud: its own, or one that is fetched from the object store. None
    /// if they are not there.
    ///
    /// # Errors
    /// `ContentUnavailable` without the object store; `Full` if there is no room, or the folder cannot be
    /// read; `Inconsistent` if the bytes are others.
    pub async fn cloud_file(&self, cloud: &Cloud) -> Result<Option<LocalFile>> {
        let Some(key) = &cloud.object else {
            let path = self.cloud_path(&cloud.sha256);
            return match tokio::fs::File::open(&path).await {
                Ok(file) => Ok(Some(LocalFile {
                    file: file.into_std().await,
                    path,
                    fetched: None,
                })),
                Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
                Err(error) => Err(Error::Full(format!("{}: {error}", path.display()))),
            };
        };
        let object = Kept {
            key: key.clone(),
            bytes: cloud.bytes,
        };
        let Some((file, sha256)) = self.fetch(&[object]).await? else {
            return Ok(None);
        };
        if sha256 != cloud.sha256 {
            return Err(Error::Inconsistent {
                table: "clouds",
                column: "object",
                detail: format!("the bytes of {} are not those that were sent", cloud.id),
            });
        }
        let (file, fetched) = file.into_parts();
        Ok(Some(LocalFile {
            file,
            path: fetched.to_path_buf(),
            fetched: Some(fetched),
        }))
    }

    /// A temporary file with the bytes of objects one after the other, and its SHA-256; none if some are not
    /// there.
    pub(in crate::jobs::store) async fn fetch(
        &self,
        objects: &[Kept],
    ) -> Result<Option<(NamedTempFile, String)>> {
        let (bucket, folder) = (self.bucket()?, self.inner.folder.join(UPLOADS));
        let file = in_folder(&folder, || NamedTempFile::new_in(&folder)).map_err(full)?;
        let mut written = Written {
            file,
            hash: Sha256::new(),
        };
        for object in objects {
            let mut parts = bucket.parts(&object.key, object.bytes);
            while let Some(part) = parts.try_next().await? {
                let Some(part) = part else {
                    return Ok(None);
                };
                written = written.with(part).await?;
            }
        }
        Ok(Some((written.file, hex::encode(written.hash.finalize()))))
    }

    /// Whether the bytes of the cloud are there.
    ///
    /// # Errors
    /// `ContentUnavailable` without the object store.
    pub async fn has_cloud_file(&self, cloud: &Cloud) -> Result<bool> {
        match &cloud.object {
            Some(key) => self.bucket()?.has(key).await,
            None => Ok(tokio::fs::try_exists(self.cloud_path(&cloud.sha256))
                .await
                .unwrap_or(false)),
        }
    }

    /// Writes a file that a row is to name into the object store.
    pub(in crate::jobs::store) async fn put_file(&self, file: &Path) -> Result<Kept> {
        let key = new_key();
        match self.bucket()?.put_file(&key, file).await {
            Ok(kept) => Ok(kept),
            Err(error) => {
                self.discard(vec![key]).await;
                Err(error)
            }
        }
    }

    fn bucket(&self) -> Result<&Bucket> {
        let none = || Error::ContentRefused("there is no object store".to_owned());
        self.inner.objects.bucket().ok_or_else(none)
    }
}

/// A file, and the hash of what was written to it.
struct Written {
    file: NamedTempFile,
    hash: Sha256,
}

impl Written {
    /// The same with more bytes. Hashing and writing block, and leases are renewed meanwhile.
    async fn with(mut self, part: Bytes) -> Result<Self> {
        let written = tokio::task::spawn_blocking(move || {
            self.hash.update(&part);
            self.file.write_all(&part).map(|()| self)
        });
        let written = written.await.map_err(|_| Error::Closed)?;
        written.map_err(full)
    }
}

#[expect(clippy::needless_pass_by_value, reason = "for `map_err`")]
fn full(error: std::io::Error) -> Error {
    Error::Full(error.to_string())
}
