//! The one place with SQL: clouds, jobs, leases, events, metrics, meshes, kept answers.
//!
//! A [`Store`] is one process's hold on a database, which is `meshway.db` of a data folder or one of a
//! Postgres server: one connection that writes, in a task of its own, and four that read. Readers hold
//! no transaction from one call to the next, so the write-ahead log can always be checkpointed. Beside
//! it, `content.db` has the bytes of meshes, models and checkpoints. The databases of the folder give
//! the space of erased rows back to the file system.
//!
//! - `sql`: one text of SQL for both kinds of databases;
//! - `writer`: the task that writes, in groups;
//! - `sqlite`: how the databases of the folder are opened, migrated, written and cleaned;
//! - `postgres`: the same for the rows on a server, and how its clients hear of each other;
//! - `content`: large content, and the rule that keeps rows and bytes together;
//! - `records`: the rows, one file a noun.
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

mod content;
mod engine;
mod names;
mod postgres;
mod records;
mod sql;
mod sqlite;
mod writer;

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use futures_util::future::BoxFuture;
use sqlx::sqlite::{SqliteConnectOptions, SqlitePoolOptions};
use tokio::sync::{Mutex, Notify, watch};

pub use content::ballast::BALLAST_FILE;
pub use content::objects::CHUNK_BYTES;
pub use names::{Acts, Records};
pub use records::act::{Act, Outcome as AuditOutcome};
pub use records::audit::{AuditFault, AuditHead, AuditRow};
pub use records::checkpoints::Checkpoint;
pub use records::idempotency::{Idempotency, IdempotencyState, StoredResponse, Subject};
pub use records::meshes::MeshInfo;
pub use sqlite::origin::is_ours;

use super::clock::{self, Clock};
use super::{Error, Result};
use crate::identity::{Caller, Tenant};
use content::ballast::Ballast;
use content::graves::{Burial, Undertaker};
use content::lift;
use content::objects::Objects;
use engine::{Engine, Transaction, Writer};
use postgres::notice::Notices;
use postgres::{ServerClock, Session};
use sql::Readers;
use sqlite::shredder::Shredder;
use sqlite::writer::ready;
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
    /// Name of the process, by which its unfinished content is found.
    pub process: String,
    /// Bytes of the disk that are set aside for erasing on a full one.
    pub ballast_bytes: u64,
    /// The time, in milliseconds since the epoch; none: that of the database, which for `SQLite` is
    /// that of the machine.
    pub clock: Option<Clock>,
    /// Address of a Postgres database for the rows, with its password where that is not in the
    /// environment; none: `SQLite` in the data folder.
    pub database: Option<String>,
}

impl Options {
    fn now(&self) -> i64 {
        self.clock.as_ref().map_or_else(clock::now, |clock| clock())
    }
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
            ballast_bytes: 0,
            clock: None,
            database: None,
        }
    }
}

/// How long claims on jobs last, and how long a worker waits for the database: a server may be away
/// for some seconds to start again, or for another one to take its place.
#[derive(Debug, Clone, Copy)]
pub struct Terms {
    /// How long a job is held without a renewal, in milliseconds.
    pub lease_ms: i64,
    /// Time between two renewals; also the longest time until a cancellation is heard. At least three may
    /// be lost.
    pub renewal: Duration,
    /// How often a worker asks, with half a second between, before it gives a job up.
    pub tries: u32,
}

/// On `SQLite`, where only a stopped process or a full disk is in the way.
const LOCAL: Terms = Terms {
    lease_ms: 6_000,
    renewal: Duration::from_millis(1_500),
    tries: 20,
};

/// With a server.
const REMOTE: Terms = Terms {
    lease_ms: 30_000,
    renewal: Duration::from_secs(5),
    tries: 240,
};

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
    undertaker: Undertaker,
    changed: watch::Sender<u64>,
    options: Arc<Options>,
}

/// The open database of the rows.
struct Rows {
    engine: Engine,
    readers: Readers,
    notices: Option<Notices>,
    /// The databases of the folder whose write-ahead logs are emptied.
    logs: Vec<SqliteConnectOptions>,
}

impl Store {
    /// Opens the database of a data folder that exists, creating and migrating it as needed, or the one
    /// of a server. Needs a tokio runtime, in which the writing task lives.
    ///
    /// # Errors
    /// `Busy` where other processes still migrate after several times the busy timeout; `Migration` if the database is of a later version;
    /// `Full` if content from before cannot be moved; `Database` if it is none of ours or cannot be opened;
    /// `Elsewhere` if another data folder belongs to the database of the server.
    pub async fn open(data_dir: &Path, options: Options) -> Result<Self> {
        let (changed, _) = watch::channel(0);
        match options.database.clone() {
            None => Self::open_sqlite(data_dir, options, changed).await,
            Some(url) => Self::open_postgres(&url, data_dir, options, changed).await,
        }
    }

    async fn open_sqlite(
        data_dir: &Path,
        options: Options,
        changed: watch::Sender<u64>,
    ) -> Result<Self> {
        let options = Arc::new(options);
        let connect = connect_options(&data_dir.join(DATABASE_FILE), &options);
        let patience = OPENING * options.busy_timeout;
        let mut db = migrated(&writing(&connect), &MIGRATIONS, patience).await?;
        let objects = Arc::new(Objects::open(data_dir, &options).await?);
        lift::lift(&mut db, &objects).await?;
        ready(&mut db).await?;
        let readers = SqlitePoolOptions::new()
            .max_connections(READERS)
            .acquire_timeout(options.busy_timeout)
            .idle_timeout(None)
            .max_lifetime(None)
            .connect_with(connect.clone().read_only(true))
            .await?;
        let rows = Rows {
            engine: Engine::Sqlite(db),
            readers: Readers::Sqlite(readers),
            notices: None,
            logs: vec![connect, Objects::connect(data_dir, &options)],
        };
        Ok(Self::over(rows, objects, data_dir, options, changed))
    }

    async fn open_postgres(
        url: &str,
        data_dir: &Path,
        mut options: Options,
        changed: watch::Sender<u64>,
    ) -> Result<Self> {
        let clock = ServerClock::default();
        let committed = Arc::new(Notify::new());
        let connect = postgres::connect_options(url)?;
        let session =
            Session::open(&connect, data_dir, clock.clone(), Arc::clone(&committed)).await?;
        options
            .clock
            .get_or_insert_with(|| Arc::new(move || clock.now()));
        let options = Arc::new(options);
        let objects = Arc::new(Objects::open(data_dir, &options).await?);
        let pool = postgres::readers(&connect, &options);
        let notices = Notices::start(&connect, pool.clone(), committed, &changed);
        let rows = Rows {
            engine: Engine::Postgres(Box::new(session)),
            readers: Readers::Postgres(pool),
            notices: Some(notices),
            logs: vec![Objects::connect(data_dir, &options)],
        };
        Ok(Self::over(rows, objects, data_dir, options, changed))
    }

    /// A store over open databases.
    fn over(
        rows: Rows,
        objects: Arc<Objects>,
        data_dir: &Path,
        options: Arc<Options>,
        changed: watch::Sender<u64>,
    ) -> Self {
        let writer = Writer::start(rows.engine, Arc::clone(&options), changed.clone());
        let writer = Arc::new(writer);
        let burial = Arc::new(Burial {
            writer: Arc::clone(&writer),
            readers: rows.readers.clone(),
            objects: Arc::clone(&objects),
            ballast: Ballast::new(data_dir, options.ballast_bytes),
            logs: rows.logs.into_iter().map(Shredder::start).collect(),
            turn: Mutex::default(),
        });
        Self {
            inner: Arc::new(Inner {
                undertaker: Undertaker::start(Arc::clone(&burial), changed.subscribe()),
                writer,
                readers: rows.readers,
                notices: rows.notices,
                objects,
                burial,
                changed,
                options,
            }),
        }
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
        self.inner.undertaker.stop();
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
            Readers::Postgres(_) => REMOTE,
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
