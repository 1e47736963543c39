//! The one place with SQL: clouds, jobs, leases, events, metrics, meshes, kept answers.
//!
//! A [`Store`] is one process's hold on the database `meshway.db` of a data folder: one connection
//! that writes, in a task of its own (see `writer.rs`), and four that read. Readers hold no
//! transaction from one call to the next, so the write-ahead log can always be checkpointed. Beside
//! it, `content.db` has the bytes of meshes, models and checkpoints (`objects.rs`), which rows name
//! (`graves.rs`). Both give the space of what was erased back to the file system.
//!
//! The migrations run inside one IMMEDIATE transaction, so that processes that open a new folder at
//! the same moment do not both create the tables.

mod attempts;
mod ballast;
mod checkpoints;
mod clouds;
mod events;
mod graves;
mod idempotency;
mod jobs;
mod leases;
mod lift;
mod meshes;
mod metrics;
mod objects;
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
    SqliteAutoVacuum, SqliteConnectOptions, SqliteJournalMode, SqlitePool, SqlitePoolOptions,
    SqliteSynchronous,
};
use sqlx::{ConnectOptions, SqlSafeStr, SqliteConnection};
use tokio::sync::{Mutex, watch};

pub use ballast::BALLAST_FILE;
pub use checkpoints::Checkpoint;
pub use events::Event;
pub use idempotency::{Idempotency, IdempotencyState, StoredResponse, Subject};
pub use meshes::MeshInfo;
pub use objects::CHUNK_BYTES;
pub use origin::is_ours;

use super::clock::{self, Clock};
use super::{Error, Result};
use ballast::Ballast;
use graves::{Burial, Undertaker};
use objects::Objects;
use shredder::Shredder;
use writer::{Transaction, Writer};

/// File of the database in the data folder.
pub const DATABASE_FILE: &str = "meshway.db";

/// File of the large content in the data folder.
pub const CONTENT_FILE: &str = "content.db";

/// Connections that read: a read takes well under a millisecond, so four serve thousands a second.
const READERS: u32 = 4;

/// The write-ahead log is cut to this size after a checkpoint.
const LOG_LIMIT_BYTES: &str = "8388608";

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
    /// The name of the process: what it leaves unfinished is found by it.
    pub process: String,
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
            ballast_bytes: 0,
            clock: Arc::new(clock::now),
        }
    }
}

/// What is done in a transaction.
type Work<T> = Box<dyn for<'c> FnOnce(Transaction<'c>) -> BoxFuture<'c, Result<T>> + Send>;

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
    writer: Arc<Writer>,
    readers: SqlitePool,
    objects: Arc<Objects>,
    burial: Arc<Burial>,
    undertaker: Undertaker,
    changed: watch::Sender<u64>,
    options: Arc<Options>,
}

impl Store {
    /// Opens the database of a data folder that exists, creating and migrating it as needed. Needs
    /// a tokio runtime, in which the writing task lives.
    ///
    /// # Errors
    /// `Busy` where other processes still migrate after several times the busy timeout; `Migration` if the file is of a later version;
    /// `Full` if content from before cannot be moved; `Database` if it is none of ours or cannot be opened.
    pub async fn open(data_dir: &Path, options: Options) -> Result<Self> {
        let options = Arc::new(options);
        let connect = connect_options(&data_dir.join(DATABASE_FILE), &options);
        let patience = OPENING * options.busy_timeout;
        let mut db = migrated(&writing(&connect), &MIGRATIONS, patience).await?;
        let objects = Arc::new(Objects::open(data_dir, &options).await?);
        lift::lift(&mut db, &objects).await?;
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
        let burial = Arc::new(Burial {
            writer: Arc::clone(&writer),
            readers: readers.clone(),
            objects: Arc::clone(&objects),
            ballast: Ballast::new(data_dir, options.ballast_bytes),
            logs: [connect, Objects::connect(data_dir, &options)].map(Shredder::start),
            turn: Mutex::default(),
        });
        Ok(Self {
            inner: Arc::new(Inner {
                undertaker: Undertaker::start(Arc::clone(&burial), changed.subscribe()),
                writer,
                readers,
                objects,
                burial,
                changed,
                options,
            }),
        })
    }

    /// Finishes the writes that wait and closes all connections; later calls get `Closed`.
    pub async fn close(&self) {
        self.inner.undertaker.stop();
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

    /// Tells all subscribers that another process has committed.
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

/// How a database is opened.
fn connect_options(file: &Path, options: &Options) -> SqliteConnectOptions {
    SqliteConnectOptions::new()
        .filename(file)
        .foreign_keys(true)
        .busy_timeout(options.busy_timeout)
        .disable_statement_logging()
}

/// How it is opened to be written.
fn writing(connect: &SqliteConnectOptions) -> SqliteConnectOptions {
    connect
        .clone()
        .create_if_missing(true)
        .auto_vacuum(SqliteAutoVacuum::Incremental)
        .journal_mode(SqliteJournalMode::Wal)
        .synchronous(SqliteSynchronous::Full)
        .pragma("journal_size_limit", LOG_LIMIT_BYTES)
        // What a user erases is overwritten: meshes of patients do not stay in free pages.
        .pragma("secure_delete", "ON")
}

/// Names and texts of the migrations, in their order.
type Migrations = [(&'static str, &'static str)];

const MIGRATIONS: [(&str, &str); 8] = [
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
    ("work", include_str!("../../../migrations/0006_work.sql")),
    (
        "objects",
        include_str!("../../../migrations/0007_objects.sql"),
    ),
    (
        "verdicts_of_snapshots",
        include_str!("../../../migrations/0008_verdicts_of_snapshots.sql"),
    ),
];

/// A connection to the database, migrated. SQLite refuses to change the journal of a new database while another
/// process does so, without waiting; and migrations of several processes take their time one after the other.
async fn migrated(
    options: &SqliteConnectOptions,
    migrations: &Migrations,
    patience: Duration,
) -> Result<SqliteConnection> {
    let once = async || -> Result<SqliteConnection> {
        let mut db = options.connect().await?;
        migrate(&mut db, migrations).await?;
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

async fn migrate(db: &mut SqliteConnection, migrations: &Migrations) -> Result<()> {
    let migrator = Migrator::with_migrations(
        (1..)
            .zip(migrations)
            .map(|(version, &(name, sql))| {
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
