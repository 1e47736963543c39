//! The rows in Postgres: how they are connected to, migrated and written, and how other processes hear
//! of it.
//!
//! As on `SQLite` there is one writer at a time, over all processes: a transaction that writes takes a
//! lock before its first statement and holds it to its commit. So no statement needs another meaning,
//! and the numbers of events and of the audit trail are in the order of the commits: a reader that has
//! seen one number has seen all before it.
//!
//! The lock is not held while the server's disk works, or one flush after the other would be all that
//! many processes can write: the commit itself waits for no disk, and then the process waits for the
//! flush of all that is before it, together with the others. Only then is anybody answered. What a reader
//! sees may be lost until then, so whoever tells of it or removes bytes for good waits, too: [`FLUSH`].

pub(in crate::jobs::store) mod home;
pub(in crate::jobs::store) mod notice;

use std::str::FromStr;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

use sqlx::postgres::{PgConnectOptions, PgConnection, PgPool, PgPoolOptions, PgRow};
use sqlx::{AssertSqlSafe, ConnectOptions, Connection, Row};
use tokio::sync::Notify;
use tokio::time::Instant;
use uuid::Uuid;

use crate::jobs::store::schema::migrator;
use crate::jobs::store::sql::{FLUSH, in_time};
use crate::jobs::store::writer::Session as _;
use crate::jobs::store::{Options, writer};
use crate::jobs::{Error, Result, clock};

/// Connections that read: each costs the server more than a megabyte.
const READERS: u32 = 4;

/// Statements that a connection keeps prepared: more than there are.
const PREPARED: usize = 400;

/// The server ends what takes longer, so that one process that hangs does not stop the others.
const SETTINGS: &str = "SET statement_timeout = '5s'; SET lock_timeout = '5s';
    SET idle_in_transaction_session_timeout = '5s'";

/// Begins a transaction, waits for those of all other processes, and then asks for the time. The number of
/// the lock is ours alone.
const BEGIN: &str = "BEGIN; SET LOCAL synchronous_commit = off;
    SELECT pg_advisory_xact_lock(5715126710434267),
    CAST(EXTRACT(EPOCH FROM clock_timestamp()) * 1000 AS BIGINT)";

/// How long the row of a process is kept that writes nothing, in milliseconds.
const WRITER_LASTS_MS: i64 = 24 * 60 * 60 * 1_000;

/// How long it is asked what became of a commit whose answer was lost, and the pause between two tries.
const UNCERTAIN: Duration = Duration::from_secs(20);
const PAUSE: Duration = Duration::from_millis(250);

const MIGRATIONS: [(&str, &str); 3] = [
    (
        "init",
        include_str!("../../../../migrations/postgres/0001_init.sql"),
    ),
    (
        "nodes",
        include_str!("../../../../migrations/postgres/0002_nodes.sql"),
    ),
    (
        "histories",
        include_str!("../../../../migrations/postgres/0003_histories.sql"),
    ),
];

/// How the server is connected to. Passwords may come from the environment, as for other clients.
///
/// # Errors
/// `Database` if it is no address.
pub(in crate::jobs::store) fn connect_options(url: &str) -> Result<PgConnectOptions> {
    Ok(PgConnectOptions::from_str(url)?
        .statement_cache_capacity(PREPARED)
        .disable_statement_logging())
}

/// The clock of the server, read off that of the machine: their difference is seen with each
/// transaction that writes.
#[derive(Clone, Default)]
pub(in crate::jobs::store) struct ServerClock {
    ahead: Arc<AtomicI64>,
}

impl ServerClock {
    /// Milliseconds since the epoch.
    pub(in crate::jobs::store) fn now(&self) -> i64 {
        clock::now() + self.ahead.load(Ordering::Relaxed)
    }

    fn set(&self, now: i64) {
        self.ahead.store(now - clock::now(), Ordering::Relaxed);
    }
}

/// The connection that writes.
pub(in crate::jobs::store) struct Session {
    connect: PgConnectOptions,
    db: PgConnection,
    /// It is of no use any more: the next transaction needs another one.
    lost: bool,
    /// Its row in `writers`, and the number of its last commit.
    name: String,
    commits: i64,
    clock: ServerClock,
    committed: Arc<Notify>,
}

impl Session {
    /// Connects and migrates. `committed` is told of each commit.
    ///
    /// # Errors
    /// `Database` where the server cannot be reached, with why; `Migration` if the schema is of a later
    /// version.
    pub(in crate::jobs::store) async fn open(
        connect: &PgConnectOptions,
        clock: ServerClock,
        committed: Arc<Notify>,
    ) -> Result<Self> {
        let unreachable = |error| Error::Database(Arc::new(error));
        let mut db = connect.connect().await.map_err(unreachable)?;
        migrate(&mut db).await?;
        set_up(&mut db).await?;
        let select = "SELECT CAST(EXTRACT(EPOCH FROM clock_timestamp()) * 1000 AS BIGINT)";
        let now: i64 = sqlx::query_scalar(select).fetch_one(&mut db).await?;
        clock.set(now);
        let delete = "DELETE FROM writers WHERE at < $1";
        let delete = sqlx::query(delete).bind(now - WRITER_LASTS_MS);
        delete.execute(&mut db).await?;
        Ok(Self {
            connect: connect.clone(),
            db,
            lost: false,
            name: Uuid::now_v7().to_string(),
            commits: 0,
            clock,
            committed,
        })
    }

    async fn connect(&mut self) -> Result<()> {
        let connected = async {
            let mut db = self.connect.connect().await?;
            set_up(&mut db).await?;
            Ok(db)
        };
        self.db = in_time(connected).await?;
        self.lost = false;
        Ok(())
    }

    /// Asks on another connection what became of the last commit, whose answer was lost.
    async fn was_committed(&mut self) -> Result<()> {
        let start = Instant::now();
        while start.elapsed() < UNCERTAIN {
            let asked = async {
                self.connect().await?;
                // Where the server has not noticed yet that the connection is gone, this waits for its end.
                let begun = async { Ok(sqlx::raw_sql(BEGIN).execute(&mut self.db).await?) };
                in_time(begun).await?;
                let select = "SELECT commits FROM writers WHERE name = $1";
                let commits = sqlx::query_scalar(select).bind(&self.name);
                let commits = async { Ok(commits.fetch_optional(&mut self.db).await?) };
                let commits: Option<i64> = in_time(commits).await?;
                self.run("ROLLBACK").await?;
                self.run(FLUSH).await?;
                Ok::<_, Error>(commits)
            };
            match asked.await {
                Ok(commits) if commits == Some(self.commits) => return Ok(()),
                Ok(_) => return Err(Error::Busy),
                Err(_) => tokio::time::sleep(PAUSE).await,
            }
        }
        Err(Error::Busy)
    }

    async fn commit_and_flush(&mut self) -> Result<()> {
        let (name, commits, now) = (&self.name, self.commits, self.clock.now());
        let commit = format!(
            "INSERT INTO writers (name, commits, at) VALUES ('{name}', {commits}, {now})
             ON CONFLICT (name) DO UPDATE SET commits = excluded.commits, at = excluded.at; COMMIT"
        );
        // A name that is made here, and numbers.
        let commit = sqlx::raw_sql(AssertSqlSafe(commit));
        in_time(async { Ok(commit.execute(&mut self.db).await?) }).await?;
        self.run(FLUSH).await
    }
}

impl writer::Session for Session {
    type Db<'c> = &'c mut PgConnection;

    fn db(&mut self) -> Self::Db<'_> {
        &mut self.db
    }

    /// The server has the patience, as it was told when it was connected to.
    async fn begin(&mut self, _: Duration) -> Result<()> {
        if self.lost {
            self.connect().await?;
        }
        let begun = async { Ok(sqlx::raw_sql(BEGIN).fetch_one(&mut self.db).await?) };
        let row: PgRow = in_time(begun).await?;
        self.clock.set(row.try_get(1)?);
        Ok(())
    }

    async fn run(&mut self, statement: &'static str) -> Result<()> {
        in_time(async {
            sqlx::raw_sql(statement).execute(&mut self.db).await?;
            Ok(())
        })
        .await
    }

    async fn commit(&mut self) -> Result<()> {
        self.commits += 1;
        match self.commit_and_flush().await {
            // The connection, or the patience, was lost: it may be committed all the same.
            Err(Error::Busy) => self.was_committed().await?,
            committed => committed?,
        }
        self.committed.notify_one();
        Ok(())
    }

    async fn roll_back(&mut self) {
        self.lost |= self.run("ROLLBACK").await.is_err();
    }

    async fn close(self) -> Result<()> {
        Ok(self.db.close().await?)
    }
}

/// Connections that read. None is made before the first read.
pub(in crate::jobs::store) fn readers(connect: &PgConnectOptions, options: &Options) -> PgPool {
    PgPoolOptions::new()
        .max_connections(READERS)
        .acquire_timeout(options.busy_timeout)
        .after_connect(|db, _| Box::pin(set_up(db)))
        .connect_lazy_with(connect.clone())
}

/// Not told when connecting: poolers between here and the server refuse it there.
async fn set_up(db: &mut PgConnection) -> sqlx::Result<()> {
    sqlx::raw_sql(SETTINGS).execute(db).await?;
    Ok(())
}

/// Brings the schema up to date, under a lock: processes that start together wait for the first.
async fn migrate(db: &mut PgConnection) -> Result<()> {
    let migrator = migrator(&MIGRATIONS, false);
    Ok(migrator.run_direct(None, db, false).await?)
}
