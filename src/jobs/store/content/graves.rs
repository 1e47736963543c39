//! What keeps rows and objects together: bytes come before their row and go after it.
//!
//! A key is made once, its bytes are written once, and at most one row ever names it. A row that
//! goes, or names another object, puts the old key among the graves in the same transaction; the
//! bytes are removed after it, and whoever dies in between leaves the grave to the next one.
//!
//! An object without a row is one that is about to be named, or that nobody will name any more
//! because its process died. Which of them cannot be seen; so taking it for garbage is a transaction
//! that finds no row with its key and refuses the key for ever. One that would name it later finds
//! that, and writes its bytes again under another key. Nothing that is named is ever removed.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use bytes::Bytes;
use futures_util::future::BoxFuture;
use tokio::sync::{Mutex, watch};
use tokio::time::timeout;
use tokio_util::task::AbortOnDropHandle;

use super::ballast::Ballast;
use super::objects::{Kept, Objects, new_key};
use crate::jobs::store::engine::Writer;
use crate::jobs::store::sql::{On, Readers, query, scalar};
use crate::jobs::store::sqlite::shredder::Shredder;
use crate::jobs::store::{Store, Transaction};
use crate::jobs::{Error, Result};

/// Graves that are read at a time, and keys that are looked at in one transaction.
const AT_ONCE: usize = 256;

/// Free pages that the database of the rows keeps for the next ones: 1 MiB.
const FREE_PAGES: i64 = 256;

/// Pause before another try after an error.
const PAUSE: Duration = Duration::from_secs(1);

/// Removes the bytes of keys that are in their graves.
pub(in crate::jobs::store) struct Burial {
    pub(in crate::jobs::store) writer: Arc<Writer>,
    pub(in crate::jobs::store) readers: Readers,
    pub(in crate::jobs::store) objects: Arc<Objects>,
    pub(in crate::jobs::store) ballast: Ballast,
    /// The logs of the databases in the data folder.
    pub(in crate::jobs::store) logs: Vec<Shredder>,
    /// One at a time.
    pub(in crate::jobs::store) turn: Mutex<()>,
    /// Whether an object store kept erasing waiting, and nothing could be removed since.
    pub(in crate::jobs::store) late: AtomicBool,
}

impl Burial {
    /// Removes all of them, and gives their space back.
    pub(in crate::jobs::store) async fn run(&self) -> Result<()> {
        let _turn = self.turn.lock().await;
        loop {
            match self.once().await {
                // What is set aside is for this: removing needs some room before it gives any.
                Err(Error::Full(_)) if self.ballast.release() => {}
                result => {
                    self.logs.iter().for_each(Shredder::wake);
                    self.late.store(result.is_err(), Ordering::Relaxed);
                    return result.inspect(|()| self.ballast.fill());
                }
            }
        }
    }

    async fn run_if_needed(&self) -> Result<()> {
        let select = "SELECT EXISTS (SELECT 1 FROM graves)";
        if scalar(select).fetch_one(&self.readers).await? {
            self.run().await?;
        }
        Ok(())
    }

    async fn once(&self) -> Result<()> {
        loop {
            let select = "SELECT key FROM graves ORDER BY key LIMIT ?1";
            // A row that the server's disk still has must find its bytes: nothing is removed before it has the
            // grave.
            let graves = query(select).bind(AT_ONCE as i64);
            let graves = graves.fetch_settled(&self.readers).await?;
            let keys: Vec<String> = graves.iter().map(|row| row.at(0)).collect::<Result<_>>()?;
            if keys.is_empty() {
                break;
            }
            self.objects.remove(&keys).await?;
            self.objects.vacuum().await?;
            let close = self.writer.write(move |mut tx| {
                Box::pin(async move {
                    for key in &keys {
                        query("DELETE FROM graves WHERE key = ?1")
                            .bind(key)
                            .execute(&mut tx.db)
                            .await?;
                    }
                    Ok(())
                })
            });
            close.await?;
        }
        self.objects.vacuum().await?;
        self.writer.vacuum(FREE_PAGES).await
    }
}

/// Buries in the background, whoever made the graves: after each commit that this process makes or
/// hears of it looks for some.
pub(in crate::jobs::store) struct Undertaker(AbortOnDropHandle<()>);

impl Undertaker {
    /// Starts the task. Needs a tokio runtime.
    pub(in crate::jobs::store) fn start(
        burial: Arc<Burial>,
        mut changed: watch::Receiver<u64>,
    ) -> Self {
        changed.mark_changed();
        Self(AbortOnDropHandle::new(tokio::spawn(async move {
            while changed.changed().await.is_ok() {
                while let Err(error) = burial.run_if_needed().await {
                    tracing::debug!(%error, "erased content cannot be removed yet");
                    tokio::time::sleep(PAUSE).await;
                }
            }
        })))
    }

    /// Ends the task; the graves stay for the next process.
    pub(in crate::jobs::store) fn stop(&self) {
        self.0.abort();
    }
}

impl Store {
    /// Writes bytes that a row is to name.
    pub(in crate::jobs::store) async fn put_object(&self, data: Bytes) -> Result<Kept> {
        let key = new_key();
        match self.inner.objects.put(&key, data).await {
            Ok(kept) => Ok(kept),
            Err(error) => {
                self.discard(vec![key]).await;
                Err(error)
            }
        }
    }

    /// Runs a transaction that names objects. If it fails they are garbage.
    pub(in crate::jobs::store) async fn name<T, F>(&self, objects: &[&Kept], work: F) -> Result<T>
    where
        T: Send + 'static,
        F: for<'c> FnOnce(Transaction<'c>) -> BoxFuture<'c, Result<T>> + Send + 'static,
    {
        let named = self.write(work).await;
        // Also where the answer to the commit was lost: one that is named after all stays.
        if named.is_err() {
            let keys = objects.iter().map(|object| object.key.clone());
            self.discard(keys.collect()).await;
        }
        named
    }

    /// Removes objects that no row names, of all processes or of one that has ended; returns their
    /// number. Processes that are about to name theirs write them again.
    pub async fn collect_garbage(&self, made_by: Option<&str>) -> Result<u64> {
        let mut found = 0;
        for keys in self.inner.objects.keys(made_by).await?.chunks(AT_ONCE) {
            found += self.refuse(keys.to_vec()).await?;
        }
        Ok(found)
    }

    /// Removes at once what was erased just now; what cannot be, later.
    pub(in crate::jobs::store) async fn bury(&self) {
        if self.inner.undertaker.is_none() {
            return;
        }
        let burial = &self.inner.burial;
        let buried = match self.inner.objects.patience() {
            None => burial.run().await,
            Some(_) if burial.late.load(Ordering::Relaxed) => return,
            Some(patience) => timeout(patience, burial.run()).await.unwrap_or_else(|_| {
                burial.late.store(true, Ordering::Relaxed);
                Err(Error::ContentUnavailable("it takes long".to_owned()))
            }),
        };
        if let Err(error) = buried {
            tracing::warn!(error.message = %error, "erased content is removed later");
        }
    }

    /// As for garbage of which it is known that nobody will name it. After an error it stays until
    /// all is looked at.
    pub(in crate::jobs::store) async fn discard(&self, keys: Vec<String>) {
        if let Err(error) = self.refuse(keys).await {
            tracing::debug!(%error, "content without a row stays for now");
        }
    }

    async fn refuse(&self, keys: Vec<String>) -> Result<u64> {
        let unnamed = async |store: &Self| -> Result<bool> {
            for key in &keys {
                if !is_named(store.readers(), key).await? {
                    return Ok(true);
                }
            }
            Ok(false)
        };
        // The usual case takes no lock.
        if !unnamed(self).await? {
            return Ok(0);
        }
        self.write(move |mut tx| {
            Box::pin(async move {
                let mut found = 0;
                for key in &keys {
                    if is_named(&mut tx.db, key).await? {
                        continue;
                    }
                    for statement in [
                        "INSERT INTO refused (key) VALUES (?1) ON CONFLICT DO NOTHING",
                        "INSERT INTO graves (key) VALUES (?1) ON CONFLICT DO NOTHING",
                    ] {
                        query(statement).bind(key).execute(&mut tx.db).await?;
                    }
                    found += 1;
                }
                Ok(found)
            })
        })
        .await
    }
}

impl Transaction<'_> {
    /// Lets a row of this transaction name the object.
    ///
    /// # Errors
    /// `Busy` if it was taken for garbage: its bytes are to be written again.
    pub(in crate::jobs::store) async fn may_name(&mut self, object: &Kept) -> Result<()> {
        let select = "SELECT EXISTS (SELECT 1 FROM refused WHERE key = ?1)";
        let refused: bool = scalar(select)
            .bind(&object.key)
            .fetch_one(&mut self.db)
            .await?;
        if refused { Err(Error::Busy) } else { Ok(()) }
    }
}

pub(in crate::jobs::store) async fn is_named<'e>(db: impl Into<On<'e>>, key: &str) -> Result<bool> {
    let select = "SELECT EXISTS (SELECT 1 FROM meshes WHERE object = ?1)
                      OR EXISTS (SELECT 1 FROM models WHERE object = ?1)
                      OR EXISTS (SELECT 1 FROM checkpoints WHERE object = ?1)
                      OR EXISTS (SELECT 1 FROM clouds WHERE object = ?1)
                      OR EXISTS (SELECT 1 FROM upload_parts WHERE object = ?1)
                      OR EXISTS (SELECT 1 FROM histories WHERE object = ?1)
                      OR EXISTS (SELECT 1 FROM shares WHERE object = ?1)";
    scalar(select).bind(key).fetch_one(db).await
}
