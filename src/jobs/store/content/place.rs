//! Which place a database has its content in: once it is an object store it stays one.

use std::io::ErrorKind;
use std::path::Path;
use std::sync::Arc;

use bytes::Bytes;

use super::bucket::Bucket;
use super::embedded::Embedded;
use super::graves::is_named;
use super::objects::Objects;
use crate::jobs::store::postgres::home;
use crate::jobs::store::sql::{Db, query, scalar};
use crate::jobs::store::{CONTENT_FILE, Options};
use crate::jobs::{Error, Result};

/// Opens the content where the options have it. The server of a folder finds that the place is the
/// right one, and takes what is in the folder along.
///
/// # Errors
/// `ContentRefused` if it is not; `Elsewhere` if it is another folder than this one.
pub(in crate::jobs::store) async fn open(
    db: &mut Db<'_>,
    data_dir: &Path,
    options: &Arc<Options>,
) -> Result<Objects> {
    if matches!(db, Db::Postgres(..)) && !options.rows_only {
        home::settle(db, data_dir).await?;
    }
    let select = "SELECT value FROM meta WHERE name = 'objects'";
    let used: Option<String> = scalar(select).fetch_optional(&mut *db).await?;
    match (&options.objects, used) {
        (None, Some(used)) if !options.rows_only => Err(Error::ContentRefused(format!(
            "the content of this folder is in the object store {used}; name it with --objects"
        ))),
        (None, _) => Ok(Objects::Embedded(Embedded::open(data_dir, options).await?)),
        (Some(url), used) => {
            let bucket = Bucket::new(url, options)?;
            // The server has looked before it starts workers.
            if options.process.is_empty() {
                let select = "SELECT value FROM meta WHERE name = 'id'";
                let id: String = scalar(select).fetch_one(&mut *db).await?;
                bucket.take(&id, used.is_some()).await?;
                let upsert = "INSERT INTO meta (name, value) VALUES ('objects', ?1)
                              ON CONFLICT (name) DO UPDATE SET value = excluded.value";
                let url = bucket.url().to_string();
                query(upsert).bind(url).execute(&mut *db).await?;
                bring(db, data_dir, options, &bucket).await?;
            }
            Ok(Objects::Bucket(Box::new(bucket)))
        }
    }
}

/// Brings the content of the folder to the object store, under the same keys, and removes its file.
/// One that dies in between leaves the rest to the next; an object that is there already is written
/// with the same bytes.
async fn bring(
    db: &mut Db<'_>,
    data_dir: &Path,
    options: &Arc<Options>,
    bucket: &Bucket,
) -> Result<()> {
    if !data_dir.join(CONTENT_FILE).is_file() {
        return Ok(());
    }
    let embedded = Embedded::open(data_dir, options).await?;
    let keys = embedded.keys(None).await?;
    tracing::info!(
        objects = keys.len(),
        "content of the folder moves to the object store"
    );
    for key in keys {
        if is_named(&mut *db, &key).await? {
            let data = embedded.whole(&key, 0).await?;
            bucket.put(&key, Bytes::from(data)).await?;
        }
        embedded.remove(&key).await?;
    }
    // What was erased is overwritten before its file goes.
    embedded.vacuum().await?;
    embedded.close().await;
    for end in ["", "-wal", "-shm"] {
        let file = data_dir.join(format!("{CONTENT_FILE}{end}"));
        match std::fs::remove_file(file) {
            Err(error) if error.kind() != ErrorKind::NotFound => {
                tracing::warn!(error.message = %error, "the file of the content stays, empty");
            }
            _ => {}
        }
    }
    Ok(())
}
