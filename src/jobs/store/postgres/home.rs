//! The one data folder of a database: it has uploads that may go on, and without an object store the files of
//! clouds and the bytes that rows name. A service with another folder would take those for missing, and what
//! it erases would stay in the first one.

use std::fs;
use std::io::{ErrorKind, Write};
use std::path::Path;

use tempfile::NamedTempFile;
use uuid::Uuid;

use crate::jobs::store::sql::{Db, query, scalar};
use crate::jobs::{Error, Result};

/// File with the name that the folder has for its database.
const NAME_FILE: &str = "home";

/// Makes the folder the one of the database where that has none.
///
/// # Errors
/// `Elsewhere` if it has another one; `Full` if the folder cannot be written.
pub(in crate::jobs::store) async fn settle(db: &mut Db<'_>, folder: &Path) -> Result<()> {
    let own = name_of(folder).map_err(|error| Error::Full(error.to_string()))?;
    let insert = "INSERT INTO meta (name, value) VALUES ('folder', ?1) ON CONFLICT DO NOTHING";
    query(insert).bind(&own).execute(&mut *db).await?;
    let select = "SELECT value FROM meta WHERE name = 'folder'";
    let home: String = scalar(select).fetch_one(db).await?;
    if home == own {
        Ok(())
    } else {
        Err(Error::Elsewhere)
    }
}

/// Whether the database may be served from the folder: it has none, or this one.
///
/// # Errors
/// `Elsewhere` if it has another one.
pub(in crate::jobs::store) async fn check(db: &mut Db<'_>, folder: &Path) -> Result<()> {
    let select = "SELECT value FROM meta WHERE name = 'folder'";
    let home: Option<String> = scalar(select).fetch_optional(db).await?;
    find(home.as_deref(), folder)
}

/// Finds that a folder is the one of the database, without changing either. `home`: what the database says.
///
/// # Errors
/// `Elsewhere` if it is not.
pub(in crate::jobs::store) fn find(home: Option<&str>, folder: &Path) -> Result<()> {
    let own = fs::read_to_string(folder.join(NAME_FILE)).ok();
    match home {
        Some(home) if own.as_deref() != Some(home) => Err(Error::Elsewhere),
        _ => Ok(()),
    }
}

/// The database has no folder any more: nothing that its rows name is in one.
pub(in crate::jobs::store) async fn leave(db: &mut Db<'_>) -> Result<()> {
    let delete = "DELETE FROM meta WHERE name = 'folder'";
    query(delete).execute(db).await?;
    Ok(())
}

/// The name of a folder, which is made at its first use.
pub(in crate::jobs::store) fn name_of(folder: &Path) -> std::io::Result<String> {
    let file = folder.join(NAME_FILE);
    match fs::read_to_string(&file) {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            let mut new = NamedTempFile::new_in(folder)?;
            write!(new, "{}", Uuid::now_v7())?;
            new.as_file().sync_all()?;
            match new.persist_noclobber(&file) {
                // Another process was first.
                Err(error) if error.error.kind() != ErrorKind::AlreadyExists => {
                    return Err(error.error);
                }
                _ => {}
            }
            fs::read_to_string(file)
        }
        read => read,
    }
}
