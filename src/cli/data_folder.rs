//! The folder of a service: taken if it is ours or nobody's, held by one server, and rid of what an
//! earlier one left.
//!
//! A folder may be named by mistake, and what is removed does not come back. So a folder with other
//! things in it is refused before anything is written, and only files are removed that bear a name
//! of ours.

use std::collections::BTreeSet;
use std::fs::{self, DirEntry, File, Permissions, TryLockError};
use std::io::{self, ErrorKind};
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::Path;

use rustix::fs::Mode;
use rustix::process::umask;

use super::Failure;
use crate::folder::{self, CACHE, CLOUDS, RESUMABLE, UPLOADS, names as own_files};
use crate::jobs::{Store, store};

/// File that the server of the folder holds.
const LOCK: &str = "lock";

/// File that says whose the folder is.
const MARK: &str = "meshway-folder";
const MARK_TEXT: &str = "This folder belongs to a Meshway service: `meshway serve --data-dir`.\n";

/// Made by file systems in the root of a disk, which is a good place for a data folder.
const OF_THE_DISK: &str = "lost+found";

/// How many of the names in a foreign folder a refusal tells.
const NAMES_TOLD: usize = 3;

/// A folder that this process holds; another server is refused until it is dropped.
pub(super) struct DataFolder<'a> {
    path: &'a Path,
    _lock: File,
}

impl<'a> DataFolder<'a> {
    /// Makes the folder where it is missing, and takes it.
    ///
    /// # Errors
    /// `Usage` when it holds other things or another server works there; `Output` when it cannot be
    /// read or made.
    pub(super) async fn take(path: &'a Path) -> Result<Self, Failure> {
        let failed = |error| Failure::Output(format!("--data-dir {}: {error}", path.display()));
        check_ownership(path).await?;
        folder::make(path).map_err(failed)?;
        // Before all others, so that a start that breaks off leaves a folder that is known.
        mark(path).map_err(failed)?;
        let lock = File::options()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(path.join(LOCK))
            .map_err(failed)?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let folder = path.display();
                let detail = format!("--data-dir {folder}: another server works in this folder");
                return Err(Failure::Usage(detail));
            }
            Err(TryLockError::Error(error)) => return Err(failed(error)),
        }
        close_to_others(path).map_err(failed)?;
        folder::make_places(path).map_err(failed)?;
        Ok(Self { path, _lock: lock })
    }

    /// Removes uploads that broke off and cannot go on, and files without a row. A cloud's file that is older
    /// than the database stays: its row may be in the database that was here before.
    pub(super) async fn sweep(&self, store: &Store) -> Result<(), Failure> {
        let failed = |error: crate::jobs::Error| Failure::Output(error.to_string());
        let known: BTreeSet<_> = store.sha256s().await.map_err(failed)?.into_iter().collect();
        let made_at = store.made_at().await.map_err(failed)?;
        self.remove(UPLOADS, |name, _| own_files::is_temporary(name))?;
        let going_on = store.uploads_with_files().await.map_err(failed)?;
        let going_on: BTreeSet<_> = going_on.into_iter().collect();
        self.remove(RESUMABLE, |name, _| {
            own_files::is_resumable(name) && !going_on.contains(name)
        })?;
        let mut older = 0;
        self.remove(CLOUDS, |name, entry| {
            if !own_files::is_cloud(name) || known.contains(name) {
                return false;
            }
            let newer = entry.metadata().is_ok_and(|file| file.mtime() > made_at);
            older += usize::from(!newer);
            newer
        })?;
        if older > 0 {
            tracing::warn!(
                files = older,
                folder = %self.path.join(CLOUDS).display(),
                "files of clouds are older than the database, which does not know them, and stay; \
                 put the database back that they belong to, or remove them"
            );
        }
        Ok(())
    }

    fn remove(
        &self,
        folder: &str,
        mut goes: impl FnMut(&str, &DirEntry) -> bool,
    ) -> Result<(), Failure> {
        let folder = self.path.join(folder);
        let removed = own_files::remove_files(&folder, |name, entry| {
            let goes = goes(name, entry);
            if goes {
                tracing::info!(file = %entry.path().display(), "a file that belongs to nothing is removed");
            }
            goes
        });
        removed.map_err(|error| Failure::output(&folder, &error))
    }
}

/// Makes what is ours in the folder, and what this process and its children make from now on, a matter
/// of the user of the service only: the folder itself may be anybody's to read.
fn close_to_others(path: &Path) -> io::Result<()> {
    umask(Mode::RWXG | Mode::RWXO);
    let ours = [
        LOCK,
        MARK,
        store::DATABASE_FILE,
        store::CONTENT_FILE,
        store::BALLAST_FILE,
    ];
    for name in names(path)? {
        // The logs of a database bear its name with an ending.
        if ours.iter().any(|own| name.starts_with(own))
            && let Err(error) = fs::set_permissions(path.join(&name), Permissions::from_mode(0o600))
        {
            tracing::warn!(file = name, error.message = %error, "others may read a file of the service");
        }
    }
    Ok(())
}

/// Refuses a folder that holds things and neither our mark nor, as folders of the first version,
/// our database.
async fn check_ownership(path: &Path) -> Result<(), Failure> {
    let folder = path.display();
    let names = match names(path) {
        Ok(names) => names,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(Failure::Output(format!("--data-dir {folder}: {error}"))),
    };
    if names.contains(MARK) || names.iter().all(|name| is_bare(path, name)) {
        return Ok(());
    }
    let database = store::DATABASE_FILE;
    let ours = store::is_ours(path).await.map_err(|error| {
        Failure::Output(format!(
            "--data-dir {folder}: {database} cannot be read, so it is not known whose the folder \
             is: {error}"
        ))
    })?;
    if ours {
        return Ok(());
    }
    let told: Vec<&str> = names.iter().take(NAMES_TOLD).map(String::as_str).collect();
    let more = if names.len() > NAMES_TOLD {
        ", …"
    } else {
        ""
    };
    Err(Failure::Usage(format!(
        "--data-dir {folder}: the folder holds other things ({}{more}) and no database of Meshway; \
         nothing was changed. Name a folder that is empty or does not exist; if this was the folder \
         of a service, put its {database} back",
        told.join(", ")
    )))
}

/// Whether it is a file or folder of ours with nothing in it: what a first start leaves that failed.
fn is_bare(path: &Path, name: &str) -> bool {
    let place = path.join(name);
    match name {
        CLOUDS | UPLOADS | RESUMABLE | CACHE => names(&place).is_ok_and(|names| names.is_empty()),
        LOCK | store::DATABASE_FILE => {
            fs::symlink_metadata(place).is_ok_and(|file| file.is_file() && file.len() == 0)
        }
        _ => false,
    }
}

/// What is in the folder.
fn names(path: &Path) -> io::Result<BTreeSet<String>> {
    let name = |entry: io::Result<DirEntry>| Ok(entry?.file_name().to_string_lossy().into_owned());
    let mut names: BTreeSet<String> = fs::read_dir(path)?.map(name).collect::<io::Result<_>>()?;
    names.remove(OF_THE_DISK);
    Ok(names)
}

fn mark(path: &Path) -> io::Result<()> {
    match File::create_new(path.join(MARK)) {
        Ok(mut file) => io::Write::write_all(&mut file, MARK_TEXT.as_bytes()),
        Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(()),
        Err(error) => Err(error),
    }
}
