//! The one place with SQL: clouds, jobs, leases, events, metrics, meshes, kept answers.
//!
//! A [`Store`] is one process's hold on the database `meshway.db` of a data folder: one connection
//! that writes, in a task of its own, and four that read. Readers hold no transaction from one call
//! to the next, so the write-ahead log can always be checkpointed. The bytes of meshes, models and
//! checkpoints are beside it in `content.db`, or with those of clouds in an object store. The databases
//! give the space of erased rows back to the file system.
//!
//! - `sqlite`: how the databases are opened, migrated, written and cleaned;
//! - `content`: large content, and the rule that keeps rows and bytes together;
//! - `records`: the rows, one file a noun.
//!
//! # Errors
//!
//! Every method that writes can fail with `Busy`, `Full`, `Closed`, `Inconsistent` or `Database`;
//! every method that reads with `Busy`, `Closed`, `Inconsistent` or `Database`; every one that writes
//! or reads content, with `ContentUnavailable` besides. Their own documentation names other errors
//! only.
#![expect(
    clippy::missing_errors_doc,
    reason = "what all methods have in common is said once, above"
)]

mod content;
mod names;
mod records;
mod sqlite;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use futures_util::future::BoxFuture;
use sqlx::sqlite::{SqlitePool, SqlitePoolOptions};
use tokio::sync::{Mutex, watch};

pub use content::ballast::BALLAST_FILE;
pub use content::clouds::LocalFile;
pub use content::embedded::CHUNK_BYTES;
pub use names::{Acts, Records};
pub use records::act::{Act, Outcome as AuditOutcome};
pub use records::audit::{AuditFault, AuditHead, AuditRow};
pub use records::checkpoints::Checkpoint;
pub use records::idempotency::{Idempotency, IdempotencyState, StoredResponse, Subject};
pub use records::meshes::MeshInfo;
pub use sqlite::origin::is_ours;

use super::clock::{self, Clock};
use super::{Error, Result};
use crate::config::ObjectsUrl;
use crate::identity::{Caller, Tenant};
use content::ballast::Ballast;
use content::embedded::Embedded;
use content::graves::{Burial, Undertaker};
use content::objects::Objects;
use content::{lift, place};
use sqlite::shredder::Shredder;
use sqlite::writer::{Transaction, Writer};
use sqlite::{MIGRATIONS, OPENING, connect_options, migrated, writing};

/// File of the database in the data folder.
pub const DATABASE_FILE: &str = "meshway.db";

/// File of the large content in the data folder.
pub const CONTENT_FILE: &str = "content.db";

/// Connections that read: a read takes well under a millisecond, so four serve thousands a second.
const READERS: u32 = 4;

/// Options of a store.
#[derive(Clone)]
pub struct Options {
    /// Most jobs that may wait; a job that goes back into the queue is never refused.
    pub queue_limit: u64,
    /// Failed attempts after which a job fails.
    pub max_failures: i64,
    /// Events of a job after which `job.progress` and `training.metrics` are left out.
    pub events_limit: i64,
    /// Metric rows of a job after which further ones are left out.
    pub metrics_limit: i64,
    /// How long a write waits for another process before it fails with `Busy`.
    pub busy_timeout: Duration,
    /// Name of the process, by which its unfinished content is found; empty for the server of the
    /// folder.
    pub process: String,
    /// The object store with the content; none: it is in the folder.
    pub objects: Option<ObjectsUrl>,
    /// How old an object in an object store is that no row names, before it is garbage: longer than
    /// any writing takes.
    pub garbage_age: Duration,
    /// Rows are read, and nothing else is done: content stays where it is, whoever has it.
    pub rows_only: bool,
    /// Bytes of the disk that are set aside for erasing on a full one.
    pub ballast_bytes: u64,
    /// The time, in milliseconds since the epoch.
    pub clock: Clock,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            queue_limit: 1_000,
            max_failures: 3,
            events_limit: 100_000,
            metrics_limit: 200_000,
            // Below the lease of 6 s: a worker learns that it could not renew before it lost it.
            busy_timeout: Duration::from_secs(5),
            process: String::new(),
            objects: None,
            garbage_age: Duration::from_hours(1),
            rows_only: false,
            ballast_bytes: 0,
            clock: Arc::new(clock::now),
        }
    }
}

/// What is done in a transaction.
type Work<T> = Box<dyn for<'c> FnOnce(Transaction<'c>) -> BoxFuture<'c, Result<T>> + Send>;

/// The connections of a process to the database. Clones share them.
#[derive(Clone)]
pub struct Store {
    inner: Arc<Inner>,
}

struct Inner {
    writer: Arc<Writer>,
    readers: SqlitePool,
    objects: Arc<Objects>,
    burial: Arc<Burial>,
    undertaker: Option<Undertaker>,
    folder: PathBuf,
    changed: watch::Sender<u64>,
    options: Arc<Options>,
}

impl Store {
    /// Opens the database of a data folder that exists, creating and migrating it as needed. Needs
    /// a tokio runtime, in which the writing task lives.
    ///
    /// # Errors
    /// `Busy` where other processes still migrate after several times the busy timeout; `Migration` if the file is of a later version;
    /// `Full` if content from before cannot be moved; `ContentRefused` if the object store cannot be used or is not
    /// that of this database; `Database` if it is none of ours or cannot be opened.
    pub async fn open(data_dir: &Path, options: Options) -> Result<Self> {
        let options = Arc::new(options);
        let connect = connect_options(&data_dir.join(DATABASE_FILE), &options);
        let patience = OPENING * options.busy_timeout;
        let mut db = migrated(&writing(&connect), &MIGRATIONS, patience).await?;
        let objects = Arc::new(place::open(&mut db, data_dir, &options).await?);
        if !options.rows_only {
            lift::lift(&mut db, &objects).await?;
        }
        let readers = SqlitePoolOptions::new()
            .max_connections(READERS)
            .acquire_timeout(options.busy_timeout)
            .idle_timeout(None)
            .max_lifetime(None)
            .connect_with(connect.clone().read_only(true))
            .await?;
        let (changed, _) = watch::channel(0);
        let writer = Writer::start(db, Arc::clone(&options), changed.clone());
        let writer = Arc::new(writer);
        let mut logs = vec![connect];
        if objects.bucket().is_none() {
            logs.push(Embedded::connect(data_dir, &options));
        }
        let undertaken = !options.rows_only;
        let burial = Arc::new(Burial {
            writer: Arc::clone(&writer),
            readers: readers.clone(),
            objects: Arc::clone(&objects),
            ballast: Ballast::new(data_dir, options.ballast_bytes),
            logs: logs.into_iter().map(Shredder::start).collect(),
            turn: Mutex::default(),
            late: AtomicBool::default(),
        });
        Ok(Self {
            inner: Arc::new(Inner {
                undertaker: undertaken
                    .then(|| Undertaker::start(Arc::clone(&burial), changed.subscribe())),
                folder: data_dir.to_owned(),
                writer,
                readers,
                objects,
                burial,
                changed,
                options,
            }),
        })
    }

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

    /// The store's time, in milliseconds since the epoch.
    pub fn now(&self) -> i64 {
        (self.inner.options.clock)()
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

    fn readers(&self) -> &SqlitePool {
        &self.inner.readers
    }
}
