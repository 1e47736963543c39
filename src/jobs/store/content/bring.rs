//! From the folder to an object store: what a service brings along that had its bytes in its folder before.
//!
//! One that dies in between leaves the rest to the next: each step names what it brought before anything
//! of the folder goes.

use std::fs::File;
use std::io::ErrorKind;
use std::path::Path;
use std::sync::Arc;

use bytes::Bytes;

use super::bucket::Bucket;
use super::embedded::Embedded;
use super::graves::is_named;
use super::objects::new_key;
use crate::folder::{CLOUDS, RESUMABLE};
use crate::jobs::store::sql::{Db, query};
use crate::jobs::store::{CONTENT_FILE, Options};
use crate::jobs::{Error, Result};

/// Brings all of it.
pub(super) async fn all(
    db: &mut Db<'_>,
    data_dir: &Path,
    options: &Arc<Options>,
    bucket: &Bucket,
) -> Result<()> {
    content(db, data_dir, options, bucket).await?;
    clouds(db, &data_dir.join(CLOUDS), bucket).await?;
    uploads(db, &data_dir.join(RESUMABLE), bucket).await
}

/// What is in `content.db` keeps its keys: an object that is there already is written with the same bytes.
async fn content(
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
        remove(&data_dir.join(format!("{CONTENT_FILE}{end}")));
    }
    Ok(())
}

/// Each cloud gets an object of its own, also where tenants share a file. One without a file stays as it is:
/// its jobs tell that it is missing.
async fn clouds(db: &mut Db<'_>, folder: &Path, bucket: &Bucket) -> Result<()> {
    let select = "SELECT id, sha256 FROM clouds WHERE object IS NULL ORDER BY sha256";
    let rows = query(select).fetch_all(&mut *db).await?;
    let mut brought = Vec::new();
    for row in rows {
        let (id, sha256): (String, String) = (row.at(0)?, row.at(1)?);
        let file = folder.join(&sha256);
        if !file.is_file() {
            continue;
        }
        let kept = bucket.put_file(&new_key(), &file).await?;
        let update = "UPDATE clouds SET object = ?2 WHERE id = ?1";
        let update = query(update).bind(id).bind(kept.key);
        update.execute(&mut *db).await?;
        brought.push(file);
    }
    if !brought.is_empty() {
        tracing::info!(
            clouds = brought.len(),
            "clouds of the folder moved to the object store"
        );
    }
    for file in &brought {
        remove(file);
    }
    Ok(())
}

/// What came of uploads that may go on, as far as it counts.
async fn uploads(db: &mut Db<'_>, folder: &Path, bucket: &Bucket) -> Result<()> {
    let select = "SELECT id, bytes FROM uploads
                  WHERE bytes > 0 AND cloud_id IS NULL AND error IS NULL
                    AND NOT EXISTS (SELECT 1 FROM upload_parts WHERE upload_id = uploads.id)";
    for row in query(select).fetch_all(&mut *db).await? {
        let (id, bytes): (String, i64) = (row.at(0)?, row.at(1)?);
        let path = folder.join(&id);
        let counts = || {
            let file = File::options().write(true).open(&path)?;
            let there = file.metadata()?.len();
            file.set_len(there.min(bytes.unsigned_abs()))?;
            Ok(there >= bytes.unsigned_abs())
        };
        match counts() {
            Ok(true) => {}
            Ok(false) => continue,
            Err(error) if std::io::Error::kind(&error) == ErrorKind::NotFound => continue,
            Err(error) => return Err(Error::Full(error.to_string())),
        }
        let kept = bucket.put_file(&new_key(), &path).await?;
        let insert =
            "INSERT INTO upload_parts (upload_id, at, bytes, object) VALUES (?1, 0, ?2, ?3)";
        let insert = query(insert).bind(id).bind(bytes).bind(kept.key);
        insert.execute(&mut *db).await?;
        remove(&path);
    }
    Ok(())
}

fn remove(file: &Path) {
    match std::fs::remove_file(file) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            let file = file.display();
            tracing::warn!(%file, error.message = %error, "a file whose bytes moved stays");
        }
        _ => {}
    }
}
