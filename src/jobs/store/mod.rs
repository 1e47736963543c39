//! The one place with SQL: clouds, jobs, leases, events, metrics, meshes, kept answers.
//!
//! A [`Store`] is one process's hold on the database `meshway.db` of a data folder: one connection
//! that writes, in a task of its own (see `writer.rs`), and four that read. Readers hold no
//! transaction from one call to the next, so the write-ahead log can always be checkpointed. Space
//! of erased rows is used again and not given back to the file system.
//!
//! The migrations run inside one IMMEDIATE transaction, so that processes that open a new folder at
//! the same moment do not both create the tables.

mod attempts;
mod checkpoints;
mod clouds;
mod events;
mod idempotency;
mod jobs;
mod leases;
mod meshes;
mod metrics;
mod origin;
mod outcome;
mod row;
mod shredder;
mod tombstones;
mod writer;

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use futures_util::future::BoxFuture;
use sqlx::migrate::{Migration, MigrationType, Migrator};
use sqlx::sqlite::{
    SqliteConnectOptions, SqliteJournalMode, SqlitePool, SqlitePoolOptions, SqliteSynchronous,
};
use sqlx::{ConnectOptions, SqlSafeStr, SqliteConnection};
use tokio::sync::watch;

pub use checkpoints::Checkpoint;
pub use events::Event;
pub use idempotency::{Idempotency, IdempotencyState, StoredResponse, Subject};
pub use meshes::{MESH_CHUNK_BYTES, MeshInfo};
pub use origin::is_ours;

use super::clock::{self, Clock};
use super::{Error, Result};
use shredder::Shredder;
use writer::{Transaction, Writer};

/// File of the database in the data folder.
pub const DATABASE_FILE: &str = "meshway.db";

/// Connections that read: a read takes well under a millisecond, so four serve thousands a second.
const READERS: u32 = 4;

/// The write-ahead log is cut to this size after a checkpoint: a large mesh leaves a large log.
const LOG_LIMIT_BYTES: &str = "67108864";

/// What the store is told.
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
            clock: Arc::new(clock::now),
        }
    }
}

/// A process's hold on the database; clones share it.
#[derive(Clone)]
pub struct Store {
    inner: Arc<Inner>,
}

/// Busy timeouts that opening waits while other processes open the same database.
const OPENING: u32 = 4;

/// Pause between two tries of that.
const PAUSE: Duration = Duration::from_millis(20);

struct Inner {
    writer: Writer,
    readers: SqlitePool,
    shredder: Shredder,
    changed: watch::Sender<u64>,
    options: Arc<Options>,
}

impl Store {
    /// Opens the database of a data folder that exists, creating and migrating it as needed. Needs
    /// a tokio runtime, in which the writing task lives.
    ///
    /// # Errors
    /// `Busy` where other processes still migrate after several times the busy timeout; `Migration` if the file is of a later version;
    /// `Database` if it is none of ours or cannot be opened.
    pub async fn open(data_dir: &Path, options: Options) -> Result<Self> {
        let connect = SqliteConnectOptions::new()
            .filename(data_dir.join(DATABASE_FILE))
            .foreign_keys(true)
            .busy_timeout(options.busy_timeout)
            .disable_statement_logging();
        let writing = connect
            .clone()
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .pragma("journal_size_limit", LOG_LIMIT_BYTES)
            // What a user erases is overwritten: meshes of patients do not stay in free pages.
            .pragma("secure_delete", "ON");
        let db = migrated(&writing, OPENING * options.busy_timeout).await?;
        let readers = SqlitePoolOptions::new()
            .max_connections(READERS)
            .acquire_timeout(options.busy_timeout)
            .idle_timeout(None)
            .max_lifetime(None)
            .connect_with(connect.clone().read_only(true))
            .await?;
        let options = Arc::new(options);
        let (changed, _) = watch::channel(0);
        let writer = Writer::start(db, Arc::clone(&options), changed.clone());
        Ok(Self {
            inner: Arc::new(Inner {
                writer,
                readers,
                shredder: Shredder::start(connect),
                changed,
                options,
            }),
        })
    }

    /// Finishes the writes that wait and closes all connections; later calls get `Closed`.
    pub async fn close(&self) {
        self.inner.shredder.stop();
        self.inner.readers.close().await;
        self.inner.writer.close().await;
    }

    /// Changes with every commit of this process and every [`Store::wake`]. Subscribe before
    /// reading the rows, then wait: a change in between is not lost.
    pub fn changed(&self) -> watch::Receiver<u64> {
        self.inner.changed.subscribe()
    }

    /// Tells all subscribers that another process has committed.
    pub fn wake(&self) {
        self.inner.changed.send_modify(|commits| *commits += 1);
    }

    /// Overwrites what was erased in the write-ahead log, too, soon and in the background.
    pub fn shred(&self) {
        self.inner.shredder.wake();
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

    fn readers(&self) -> &SqlitePool {
        &self.inner.readers
    }
}

/// A connection to the database, migrated. SQLite refuses to change the journal of a new database while another
/// process does so, without waiting; and migrations of several processes take their time one after the other.
async fn migrated(options: &SqliteConnectOptions, patience: Duration) -> Result<SqliteConnection> {
    let once = async || -> Result<SqliteConnection> {
        let mut db = options.connect().await?;
        migrate(&mut db).await?;
        Ok(db)
    };
    let start = Instant::now();
    loop {
        match once().await {
            Err(Error::Busy) if start.elapsed() < patience => tokio::time::sleep(PAUSE).await,
            result => return result,
        }
    }
}

async fn migrate(db: &mut SqliteConnection) -> Result<()> {
    let migrations = [
        ("init", include_str!("../../../migrations/0001_init.sql")),
        (
            "erased_clouds",
            include_str!("../../../migrations/0002_erased_clouds.sql"),
        ),
        (
            "answers_about_clouds",
            include_str!("../../../migrations/0003_answers_about_clouds.sql"),
        ),
        (
            "jobs_by_verdict",
            include_str!("../../../migrations/0004_jobs_by_verdict.sql"),
        ),
        (
            "metrics_of_blocks",
            include_str!("../../../migrations/0005_metrics_of_blocks.sql"),
        ),
    ];
    let migrator = Migrator::with_migrations(
        (1..)
            .zip(migrations)
            .map(|(version, (name, sql))| {
                // No transaction of its own: it runs inside the one below.
                let own_transaction = true;
                Migration::new(
                    version,
                    name.into(),
                    MigrationType::Simple,
                    sql.into_sql_str(),
                    own_transaction,
                )
            })
            .collect(),
    );
    sqlx::query("BEGIN IMMEDIATE").execute(&mut *db).await?;
    if let Err(error) = migrator.run_direct(None, db, false).await {
        sqlx::query("ROLLBACK").execute(&mut *db).await?;
        return Err(error.into());
    }
    sqlx::query("COMMIT").execute(db).await?;
    Ok(())
}
