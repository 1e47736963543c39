//! The folder of a service: made, held by one server, and rid of what an earlier one left.

use std::collections::BTreeSet;
use std::fs::{self, DirBuilder, File, TryLockError};
use std::os::unix::fs::DirBuilderExt;
use std::path::Path;

use super::Failure;
use crate::jobs::Store;

/// Folder of the uploaded bytes, by their SHA-256.
const CLOUDS: &str = "clouds";
/// Folder of uploads under way.
const UPLOADS: &str = "tmp";
/// Folder of encoded meshes.
const CACHE: &str = "cache";

/// A folder that this process holds; another server is refused until it is dropped.
pub(super) struct DataFolder<'a> {
    path: &'a Path,
    _lock: File,
}

impl<'a> DataFolder<'a> {
    /// Makes the folder where it is missing, and takes it.
    pub(super) fn take(path: &'a Path) -> Result<Self, Failure> {
        let failed = |error| Failure::Output(format!("--data-dir {}: {error}", path.display()));
        // Clouds may be anybody's body: readable by the user of the service only.
        let mut builder = DirBuilder::new();
        builder.recursive(true).mode(0o700);
        for folder in [CLOUDS, UPLOADS, CACHE] {
            builder.create(path.join(folder)).map_err(failed)?;
        }
        let lock = File::create(path.join("lock")).map_err(failed)?;
        match lock.try_lock() {
            Ok(()) => Ok(Self { path, _lock: lock }),
            Err(TryLockError::WouldBlock) => {
                let folder = path.display();
                let detail = format!("--data-dir {folder}: another server works in this folder");
                Err(Failure::Usage(detail))
            }
            Err(TryLockError::Error(error)) => Err(failed(error)),
        }
    }

    /// Removes uploads that broke off, and files of clouds without a row.
    pub(super) async fn sweep(&self, store: &Store) -> Result<(), Failure> {
        let failed = |error: crate::jobs::Error| Failure::Output(error.to_string());
        let known: BTreeSet<_> = store.sha256s().await.map_err(failed)?.into_iter().collect();
        self.remove(UPLOADS, |_| true)?;
        self.remove(CLOUDS, |name| !known.contains(name))
    }

    fn remove(&self, folder: &str, left: impl Fn(&str) -> bool) -> Result<(), Failure> {
        let folder = self.path.join(folder);
        let failed = |error: std::io::Error| Failure::output(&folder, &error);
        for entry in fs::read_dir(&folder).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            if left(&entry.file_name().to_string_lossy()) {
                tracing::info!(file = %entry.path().display(), "a file that belongs to nothing is removed");
                fs::remove_file(entry.path()).map_err(failed)?;
            }
        }
        Ok(())
    }
}
