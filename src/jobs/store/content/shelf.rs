//! All content of a database, looked at from beside its service: nothing is made, taken or removed.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use sha2::{Digest, Sha256};
use sqlx::Row;
use sqlx::sqlite::{SqlitePool, SqlitePoolOptions};

use futures_util::TryStreamExt;

use super::bucket::Bucket;
use super::embedded::Embedded;
use crate::config::ObjectsUrl;
use crate::jobs::Result;
use crate::jobs::store::{CONTENT_FILE, Options};

/// Objects that are listed in one statement.
const PAGE: i64 = 5_000;

/// An object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::jobs::store) struct Found {
    pub(in crate::jobs::store) bytes: u64,
    /// It was begun so long ago that a row would name it by now.
    pub(in crate::jobs::store) old: bool,
}

/// Where the content is.
pub(in crate::jobs::store) enum Shelf {
    /// In `content.db` of the folder; none: there is no such file.
    Embedded(Option<SqlitePool>, Arc<Options>),
    Bucket(Box<Bucket>),
}

impl Shelf {
    /// Opens what is there. `database`: the id of the database, whose the objects are.
    ///
    /// # Errors
    /// `ContentRefused` if the object store cannot be used or is not that of the database.
    pub(in crate::jobs::store) async fn open(
        folder: &Path,
        objects: Option<&ObjectsUrl>,
        database: &str,
        options: &Arc<Options>,
    ) -> Result<Self> {
        if let Some(url) = objects {
            let bucket = Bucket::new(url, options)?;
            bucket.take(database, true).await?;
            return Ok(Self::Bucket(Box::new(bucket)));
        }
        let there = folder.join(CONTENT_FILE).is_file();
        let connect = Embedded::connect(folder, options).read_only(true);
        let pool = SqlitePoolOptions::new().max_connections(1);
        let pool = there.then(|| pool.connect_lazy_with(connect));
        Ok(Self::Embedded(pool, Arc::clone(options)))
    }

    /// All objects by their keys.
    pub(in crate::jobs::store) async fn list(&self) -> Result<HashMap<String, Found>> {
        match self {
            Self::Bucket(bucket) => bucket.list().await,
            Self::Embedded(None, _) => Ok(HashMap::new()),
            Self::Embedded(Some(pool), options) => {
                let before = options.now() - options.garbage_age.as_millis() as i64;
                let mut found = HashMap::new();
                let mut last = String::new();
                loop {
                    let select = "SELECT key, created_at, (SELECT COALESCE(SUM(length(data)), 0)
                                      FROM chunks WHERE object = key) AS bytes
                                  FROM objects WHERE key > ?1 ORDER BY key LIMIT ?2";
                    let page = sqlx::query(select).bind(&last).bind(PAGE);
                    let page = page.fetch_all(pool).await?;
                    let Some(end) = page.last() else {
                        return Ok(found);
                    };
                    last = end.try_get("key")?;
                    for row in page {
                        let made_at: i64 = row.try_get("created_at")?;
                        let bytes: i64 = row.try_get("bytes")?;
                        let object = Found {
                            bytes: bytes.unsigned_abs(),
                            old: made_at <= before,
                        };
                        found.insert(row.try_get("key")?, object);
                    }
                }
            }
        }
    }

    /// The size of an object; none if it is not there.
    pub(in crate::jobs::store) async fn bytes(&self, key: &str) -> Result<Option<u64>> {
        match self {
            Self::Bucket(bucket) => bucket.bytes(key).await,
            Self::Embedded(None, _) => Ok(None),
            Self::Embedded(Some(pool), _) => {
                let select = "SELECT SUM(length(data)) FROM chunks WHERE object = ?1";
                let sum = sqlx::query_scalar::<_, Option<i64>>(select).bind(key);
                Ok(sum.fetch_one(pool).await?.map(i64::unsigned_abs))
            }
        }
    }

    /// The SHA-256 of an object of so many bytes, as far as they are there.
    pub(in crate::jobs::store) async fn sha256(&self, key: &str, bytes: u64) -> Result<String> {
        let mut hash = Sha256::new();
        match self {
            Self::Bucket(bucket) => return sha256_in(bucket, key, bytes).await,
            Self::Embedded(None, _) => {}
            Self::Embedded(Some(pool), _) => {
                let select = "SELECT data FROM chunks WHERE object = ?1 ORDER BY position";
                let mut chunks = sqlx::query_scalar::<_, Vec<u8>>(select)
                    .bind(key)
                    .fetch(pool);
                while let Some(chunk) = chunks.try_next().await? {
                    hash.update(&chunk);
                }
            }
        }
        Ok(hex::encode(hash.finalize()))
    }
}

/// The SHA-256 of an object of so many bytes, as far as they are there.
pub(in crate::jobs::store) async fn sha256_in(
    bucket: &Bucket,
    key: &str,
    bytes: u64,
) -> Result<String> {
    let mut hash = Sha256::new();
    let mut parts = bucket.parts(key, bytes);
    while let Some(Some(part)) = parts.try_next().await? {
        hash.update(&part);
    }
    Ok(hex::encode(hash.finalize()))
}
