//! The one place with SQL: clouds, jobs, leases, events, metrics, meshes, kept answers.
//!
//! A [`Store`] is one process's hold on a database, which is `meshway.db` of a data folder or one of a
//! Postgres server: one connection that writes, in a task of its own, and four that read. Readers hold
//! no transaction from one call to the next, so the write-ahead log can always be checkpointed. The bytes
//! of meshes, models and checkpoints are beside it in `content.db`, or with those of clouds in an object
//! store. The databases of the folder give the space of erased rows back to the file system.
//!
//! - `options` and `open`: what it is opened with, and how;
//! - `sql`: one text of SQL for both kinds of databases;
//! - `writer`: the task that writes, in groups;
//! - `sqlite`: how the databases of the folder are opened, migrated, written and cleaned;
//! - `postgres`: the same for the rows on a server, and how its clients hear of each other;
//! - `content`: large content, and the rule that keeps rows and bytes together;
//! - `records`: the rows, one file a noun;
//! - `migrate`, `check` and `moving`: what is done beside a service, by the command line.
//!
//! # Errors
//!
//! Every method that writes can fail with `Busy`, `Full`, `Closed`, `Inconsistent` or `Database`;
//! every method that reads with `Busy`, `Closed`, `Inconsistent` or `Database`. Their own
//! documentation names other errors only.
#![expect(
    clippy::missing_errors_doc,
    reason = "what all methods have in common is said once, above"
)]

mod check;
mod content;
mod engine;
mod migrate;
mod moving;
mod names;
mod open;
mod options;
mod postgres;
mod records;
mod schema;
mod sql;
mod sqlite;
mod writer;

use std::path::PathBuf;
use std::sync::Arc;

use futures_util::future::BoxFuture;
use tokio::sync::watch;

pub use check::{Checked, Damage, Finding, Named};
pub use content::ballast::BALLAST_FILE;
pub use content::clouds::LocalFile;
pub use content::embedded::CHUNK_BYTES;
pub use moving::{Bytes as MovedBytes, DERIVED, Moved, Sum, TABLES};
pub use names::{Acts, Records};
pub use options::{Options, Terms};
pub use records::act::{Act, Outcome as AuditOutcome};
pub use records::audit::{AuditFault, AuditHead, AuditRow};
pub use records::checkpoints::Checkpoint;
pub use records::idempotency::{Idempotency, IdempotencyState, StoredResponse, Subject};
pub use records::meshes::MeshInfo;
pub use records::nodes::{NewNode, Role};
pub use records::queue::Waiting;
pub use records::sessions::Session;
pub use records::shares::{Offered, Share};
pub use schema::Schema;
pub use sqlite::origin::is_ours;

use super::{Error, Result};
use crate::identity::{Caller, Tenant};
use content::graves::{Burial, Undertaker};
use content::objects::Objects;
use engine::{Transaction, Writer};
use options::{LOCAL, REMOTE};
use postgres::notice::Notices;
use records::submits::Submits;
use sql::Readers;
use sqlite::shredder::Shredder;

/// File of the database in the data folder.
pub const DATABASE_FILE: &str = "meshway.db";

/// File of the large content in the data folder.
pub const CONTENT_FILE: &str = "content.db";

/// Connections that read: a read takes well under a millisecond, so four serve thousands a second.
const READERS: u32 = 4;

/// What is done in a transaction.
type Work<T> = Box<dyn for<'c> FnOnce(Transaction<'c>) -> BoxFuture<'c, Result<T>> + Send>;

/// The connections of a process to the database. Clones share them.
#[derive(Clone)]
pub struct Store {
    inner: Arc<Inner>,
}

struct Inner {
    writer: Arc<Writer>,
    readers: Readers,
    notices: Option<Notices>,
    objects: Arc<Objects>,
    burial: Arc<Burial>,
    undertaker: Option<Undertaker>,
    folder: PathBuf,
    changed: watch::Sender<u64>,
    options: Arc<Options>,
    submits: Submits,
}

impl Store {
    /// The records of a tenant, to be read. There is no other way to a record by its id.
    pub fn of<'s>(&'s self, tenant: &'s Tenant) -> Records<'s> {
        Records::new(self, tenant)
    }

    /// What a caller does to the records of its tenant, of which the audit trail tells.
    pub fn by<'s>(&'s self, caller: &'s Caller) -> Acts<'s> {
        Acts::new(self, caller)
    }

    /// Finishes the writes that wait and closes all connections; later calls get `Closed`.
    pub async fn close(&self) {
        self.inner.undertaker.iter().for_each(Undertaker::stop);
        self.inner.notices.iter().for_each(Notices::stop);
        self.inner.burial.logs.iter().for_each(Shredder::stop);
        self.inner.objects.close().await;
        self.inner.readers.close().await;
        self.inner.writer.close().await;
    }

    /// Changes with every commit of this process and every [`Store::wake`]. Subscribe before
    /// reading the rows, then wait: a change in between is not lost.
    pub fn changed(&self) -> watch::Receiver<u64> {
        self.inner.changed.subscribe()
    }

    /// Tells all subscribers that another process committed something.
    pub fn wake(&self) {
        self.inner.changed.send_modify(|commits| *commits += 1);
    }

    /// Overwrites what was erased in the write-ahead logs, too, soon and in the background.
    pub fn shred(&self) {
        self.inner.burial.logs.iter().for_each(Shredder::wake);
    }

    /// How long claims last here.
    pub fn terms(&self) -> Terms {
        match self.inner.readers {
            Readers::Sqlite(_) => LOCAL,
            Readers::Postgres(..) => REMOTE,
        }
    }

    /// The store's time, in milliseconds since the epoch.
    pub fn now(&self) -> i64 {
        self.inner.options.now()
    }

    /// Proves that the database can be written: takes the write lock and commits nothing.
    ///
    /// # Errors
    /// `Busy`, `Full` or `Database`: why it cannot.
    pub async fn check_writable(&self) -> Result<()> {
        self.write(|_| Box::pin(async { Ok(()) })).await
    }

    async fn write<T, F>(&self, work: F) -> Result<T>
    where
        T: Send + 'static,
        F: for<'c> FnOnce(Transaction<'c>) -> BoxFuture<'c, Result<T>> + Send + 'static,
    {
        self.inner.writer.write(work).await
    }

    /// As [`Store::write`], for work that gives space back: on a full disk it may use the room that
    /// is set aside.
    async fn erase<T>(&self, work: impl Fn() -> Work<T>) -> Result<T>
    where
        T: Send + 'static,
    {
        match self.write(work()).await {
            Err(Error::Full(_)) if self.inner.burial.ballast.release() => self.write(work()).await,
            result => result,
        }
    }

    fn readers(&self) -> &Readers {
        &self.inner.readers
    }
}
