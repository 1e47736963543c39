//! The bytes of meshes, models and checkpoints, in chunks, in a database of their own beside the
//! rows: `content.db`.
//!
//! It has a writer of its own, so that no large write stands before a lease, an event or a submit;
//! and it gives the space of what was removed back to the file system. Large objects are written and
//! removed in small transactions: the log stays short, and other processes get their turn.
//!
//! Nothing here knows what an object is. One is complete, and stays, once a row of `meshway.db`
//! names its key: see `graves.rs`.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use bytes::Bytes;
use sqlx::sqlite::{SqliteConnectOptions, SqlitePool};
use tokio::sync::watch;

use crate::jobs::Result;
use crate::jobs::store::sqlite::writer::{Writer, ready};
use crate::jobs::store::sqlite::{OPENING, connect_options, migrated, readers, writing};
use crate::jobs::store::{CONTENT_FILE, Options};

/// Size of every chunk of an object but the last: large enough for ~155 MiB/s in and ~700 MiB/s
/// out, small enough that a hundred downloads hold 25 MiB.
pub const CHUNK_BYTES: usize = 256 * 1024;

/// Bytes written in one transaction.
const BATCH_BYTES: usize = 16 * CHUNK_BYTES;

/// Chunks removed in one transaction. Each is overwritten, and the disk may be nearly full.
const REMOVED_AT_ONCE: i64 = 4;

/// Larger pages than the default: a chunk takes 17 of them.
const PAGE_BYTES: u32 = 16 * 1024;

/// Pages in the log at which it is written into the database: two batches.
const LOG_PAGES: &str = "512";

const MIGRATIONS: [(&str, &str); 1] = [(
    "init",
    include_str!("../../../../migrations/content/0001_init.sql"),
)];

/// A process's hold on the content.
pub(in crate::jobs::store) struct Embedded {
    writer: Writer,
    readers: SqlitePool,
    made_by: String,
}

impl Embedded {
    /// Opens the content of a data folder, making it where it is missing.
    pub(in crate::jobs::store) async fn open(
        data_dir: &Path,
        options: &Arc<Options>,
    ) -> Result<Self> {
        let connect = Self::connect(data_dir, options);
        let opened = writing(&connect)
            .page_size(PAGE_BYTES)
            .pragma("wal_autocheckpoint", LOG_PAGES);
        let mut db = migrated(&opened, &MIGRATIONS, OPENING * options.busy_timeout).await?;
        ready(&mut db).await?;
        let readers = readers(connect, options).await?;
        // Nobody waits for content: the row that names it is what is heard of.
        let (unheard, _) = watch::channel(0);
        Ok(Self {
            writer: Writer::start(db, Arc::clone(options), unheard),
            readers,
            made_by: options.process.clone(),
        })
    }

    /// How its database is opened.
    pub(in crate::jobs::store) fn connect(
        data_dir: &Path,
        options: &Options,
    ) -> SqliteConnectOptions {
        connect_options(&data_dir.join(CONTENT_FILE), options)
    }

    pub(in crate::jobs::store) async fn close(&self) {
        self.readers.close().await;
        self.writer.close().await;
    }

    /// Writes the bytes under a new key. After an error some may be there.
    pub(in crate::jobs::store) async fn put(&self, key: &str, data: Bytes) -> Result<()> {
        let mut rest = data;
        let mut position = 0;
        loop {
            let batch = rest.split_to(rest.len().min(BATCH_BYTES));
            self.put_batch(key.to_owned(), position, batch).await?;
            position += (BATCH_BYTES / CHUNK_BYTES) as i64;
            if rest.is_empty() {
                return Ok(());
            }
        }
    }

    async fn put_batch(&self, key: String, first: i64, batch: Bytes) -> Result<()> {
        let made_by = self.made_by.clone();
        self.writer
            .write(move |tx| {
                Box::pin(async move {
                    if first == 0 {
                        let insert = "INSERT INTO objects (key, made_by, created_at)
                                      VALUES (?1, ?2, ?3)";
                        sqlx::query(insert)
                            .bind(&key)
                            .bind(made_by)
                            .bind(tx.now)
                            .execute(&mut *tx.db)
                            .await?;
                    }
                    for (position, chunk) in (first..).zip(batch.chunks(CHUNK_BYTES)) {
                        let insert = "INSERT INTO chunks (object, position, data)
                                      VALUES (?1, ?2, ?3)";
                        sqlx::query(insert)
                            .bind(&key)
                            .bind(position)
                            .bind(chunk)
                            .execute(&mut *tx.db)
                            .await?;
                    }
                    Ok(())
                })
            })
            .await
    }

    /// The bytes from the start of a range on, to its end or to that of their chunk; none of an object
    /// that was removed.
    pub(in crate::jobs::store) async fn part(
        &self,
        key: &str,
        range: Range<u64>,
    ) -> Result<Option<Bytes>> {
        let chunk_bytes = CHUNK_BYTES as u64;
        let position = (range.start / chunk_bytes) as i64;
        let from = (range.start % chunk_bytes) as usize;
        let Some(chunk) = self.chunk(key, position).await? else {
            return Ok(None);
        };
        let to = chunk.len().min(from + (range.end - range.start) as usize);
        Ok((from < to).then(|| Bytes::from(chunk).slice(from..to)))
    }

    async fn chunk(&self, key: &str, position: i64) -> Result<Option<Vec<u8>>> {
        let select = "SELECT data FROM chunks WHERE object = ?1 AND position = ?2";
        Ok(sqlx::query_scalar(select)
            .bind(key)
            .bind(position)
            .fetch_optional(&self.readers)
            .await?)
    }

    /// All bytes of an object that has so many, as far as they are there.
    pub(in crate::jobs::store) async fn whole(&self, key: &str, bytes: u64) -> Result<Vec<u8>> {
        let mut data = Vec::with_capacity(bytes as usize);
        for position in 0.. {
            let Some(chunk) = self.chunk(key, position).await? else {
                break;
            };
            data.extend_from_slice(&chunk);
        }
        Ok(data)
    }

    /// Keys of all objects, or of those that a process made, in the order of their making.
    pub(in crate::jobs::store) async fn keys(&self, made_by: Option<&str>) -> Result<Vec<String>> {
        let select = "SELECT key FROM objects WHERE ?1 IS NULL OR made_by = ?1 ORDER BY key";
        Ok(sqlx::query_scalar(select)
            .bind(made_by)
            .fetch_all(&self.readers)
            .await?)
    }

    /// Removes an object; one that is not there is no error.
    pub(in crate::jobs::store) async fn remove(&self, key: &str) -> Result<()> {
        loop {
            let key = key.to_owned();
            let removed = self.writer.write(move |tx| {
                Box::pin(async move {
                    let delete = "DELETE FROM chunks WHERE rowid IN
                                  (SELECT rowid FROM chunks WHERE object = ?1 LIMIT ?2)";
                    let chunks = sqlx::query(delete)
                        .bind(&key)
                        .bind(REMOVED_AT_ONCE)
                        .execute(&mut *tx.db)
                        .await?
                        .rows_affected();
                    if chunks == 0 {
                        sqlx::query("DELETE FROM objects WHERE key = ?1")
                            .bind(&key)
                            .execute(tx.db)
                            .await?;
                    }
                    Ok(chunks)
                })
            });
            if removed.await? == 0 {
                return Ok(());
            }
        }
    }

    /// Gives the space of what was removed back to the file system.
    pub(in crate::jobs::store) async fn vacuum(&self) -> Result<()> {
        self.writer.vacuum(0).await
    }
}
