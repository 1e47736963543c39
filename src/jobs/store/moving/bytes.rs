//! The bytes of a folder, put into an object store and read back.

use std::path::Path;
use std::sync::Arc;

use sha2::{Digest, Sha256};
use sqlx::SqliteConnection;
use uuid::Uuid;

use crate::folder::CLOUDS;
use crate::jobs::store::Options;
use crate::jobs::store::check::sha256_of;
use crate::jobs::store::content::bucket::Bucket;
use crate::jobs::store::content::embedded::Embedded;
use crate::jobs::store::content::shelf::sha256_in;
use crate::jobs::{Error, Result};

/// What was put.
#[derive(Debug, Default, Clone, Copy)]
pub struct Bytes {
    /// Number of objects.
    pub objects: u64,
    /// Their bytes.
    pub bytes: u64,
}

/// The key of the object that a file of a cloud becomes: the same at each try, and of the cloud's time.
pub(super) fn cloud_key(id: &str, created_at: i64) -> String {
    let hash = Sha256::digest(id);
    let mut random = [0; 10];
    random.copy_from_slice(&hash[..10]);
    let made_at = u64::try_from(created_at).unwrap_or_default();
    let key = uuid::Builder::from_unix_timestamp_millis(made_at, &random);
    Uuid::to_string(&key.into_uuid())
}

/// Puts all bytes that rows name; what an earlier try put is only read.
pub(super) async fn put(
    folder: &Path,
    here: &mut SqliteConnection,
    bucket: &Bucket,
) -> Result<Bytes> {
    let options = Arc::new(Options::default());
    let embedded = Embedded::open(folder, &options).await?;
    let put = put_all(folder, here, &embedded, bucket).await;
    embedded.close().await;
    put
}

async fn put_all(
    folder: &Path,
    here: &mut SqliteConnection,
    embedded: &Embedded,
    bucket: &Bucket,
) -> Result<Bytes> {
    let mut put = Bytes::default();
    let select = "SELECT object, bytes FROM meshes
                  UNION ALL SELECT object, bytes FROM models
                  UNION ALL SELECT object, bytes FROM checkpoints
                  UNION ALL SELECT object, bytes FROM histories
                  UNION ALL SELECT object, bytes FROM shares
                  UNION ALL SELECT object, bytes FROM upload_parts";
    let named: Vec<(String, i64)> = sqlx::query_as(select).fetch_all(&mut *here).await?;
    for (key, bytes) in named {
        let bytes = bytes.unsigned_abs();
        let data = embedded.whole(&key, bytes).await?;
        if data.len() as u64 != bytes {
            return Err(missing(&key));
        }
        let sha256 = hex::encode(Sha256::digest(&data));
        if !is_there(bucket, &key, bytes, &sha256).await? {
            bucket.put(&key, data.into()).await?;
            check(bucket, &key, bytes, &sha256).await?;
        }
        put.objects += 1;
        put.bytes += bytes;
    }
    let select = "SELECT id, created_at, sha256, bytes FROM clouds WHERE object IS NULL";
    let clouds: Vec<(String, i64, String, i64)> = sqlx::query_as(select).fetch_all(here).await?;
    for (id, created_at, sha256, bytes) in clouds {
        let (key, bytes) = (cloud_key(&id, created_at), bytes.unsigned_abs());
        let file = folder.join(CLOUDS).join(&sha256);
        let hashed = {
            let file = file.clone();
            tokio::task::spawn_blocking(move || sha256_of(&file))
        };
        let hashed = hashed.await.map_err(|_| Error::Closed)?;
        if hashed.ok().as_ref() != Some(&sha256) {
            return Err(missing(&id));
        }
        if !is_there(bucket, &key, bytes, &sha256).await? {
            bucket.put_file(&key, &file).await?;
            check(bucket, &key, bytes, &sha256).await?;
        }
        put.objects += 1;
        put.bytes += bytes;
    }
    Ok(put)
}

async fn is_there(bucket: &Bucket, key: &str, bytes: u64, sha256: &str) -> Result<bool> {
    let there = bucket.bytes(key).await? == Some(bytes);
    Ok(there && sha256_in(bucket, key, bytes).await? == sha256)
}

async fn check(bucket: &Bucket, key: &str, bytes: u64, sha256: &str) -> Result<()> {
    if is_there(bucket, key, bytes, sha256).await? {
        return Ok(());
    }
    Err(Error::NotMoved(format!(
        "the object store does not give back what was put there as {key}; try again, or use another one"
    )))
}

fn missing(what: &str) -> Error {
    Error::NotMoved(format!(
        "the bytes of {what} are missing or damaged; `meshway check --hashes` tells of all of them and \
         what to do"
    ))
}
