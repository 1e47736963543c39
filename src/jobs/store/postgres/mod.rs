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
pub(in crate::jobs::store) mod schema;

use std::str::FromStr;
use std::sync::Arc;
use std::time::Duration;

use sqlx::postgres::{PgConnectOptions, PgConnection, PgPool, PgPoolOptions, PgRow};
use sqlx::{AssertSqlSafe, ConnectOptions, Connection, Row};
use tokio::sync::{Notify, watch};
use tokio::time::Instant;
use uuid::Uuid;

use crate::jobs::clock::RemoteClock;
use crate::jobs::store::sql::{Db, FLUSH, Protocol, in_time, scalar};
use crate::jobs::store::writer::Session as _;
use crate::jobs::store::{Options, writer};
use crate::jobs::{Error, Result};
use notice::Notices;

/// Connections that read: each costs the server more than a megabyte.
const READERS: u32 = 4;

/// Statements that a connection keeps prepared: more than there are.
const PREPARED: usize = 400;

/// The server ends what takes longer, so that one process that hangs does not stop the others.
const SETTINGS: &str = "SET statement_timeout = '5s'; SET lock_timeout = '5s';
    SET idle_in_transaction_session_timeout = '5s'";

/// The same for one transaction, where the next one may be in another session.
const POOLED_BEGIN: &str = "BEGIN; SET LOCAL synchronous_commit = off;
    SET LOCAL statement_timeout = '5s'; SET LOCAL lock_timeout = '5s';
    SET LOCAL idle_in_transaction_session_timeout = '5s';
    SELECT pg_advisory_xact_lock(5715126710434267),
    CAST(EXTRACT(EPOCH FROM clock_timestamp()) * 1000 AS BIGINT);
    SELECT COALESCE(MAX(version), 0) FROM _sqlx_migrations";

/// The time of the server, in milliseconds since the epoch.
pub(in crate::jobs::store) const TIME: &str =
    "SELECT CAST(EXTRACT(EPOCH FROM clock_timestamp()) * 1000 AS BIGINT)";

/// Waits for the transactions that write of all other processes. The number of the lock is ours alone.
pub(in crate::jobs::store) const LOCK: &str = "SELECT pg_advisory_xact_lock(5715126710434267)";

/// Begins a transaction, waits for those of all other processes, and then asks for the time. Then, nobody else
/// being able to change that, how far the tables are.
const BEGIN: &str = "BEGIN; SET LOCAL synchronous_commit = off;
    SELECT pg_advisory_xact_lock(5715126710434267),
    CAST(EXTRACT(EPOCH FROM clock_timestamp()) * 1000 AS BIGINT);
    SELECT COALESCE(MAX(version), 0) FROM _sqlx_migrations";

/// How long the row of a process is kept that writes nothing, in milliseconds.
const WRITER_LASTS_MS: i64 = 24 * 60 * 60 * 1_000;

/// How long it is asked what became of a commit whose answer was lost, and the pause between two tries.
const UNCERTAIN: Duration = Duration::from_secs(20);
const PAUSE: Duration = Duration::from_millis(250);

/// How the server is reached.
#[derive(Clone)]
pub(in crate::jobs::store) struct Access {
    connect: PgConnectOptions,
    /// What is between hands each transaction to a session of its own choice.
    pooled: bool,
}

impl Access {
    /// Passwords may come from the environment, as for other clients.
    ///
    /// # Errors
    /// `Database` if it is no address.
    pub(in crate::jobs::store) fn new(url: &str, pooled: bool) -> Result<Self> {
        let connect = PgConnectOptions::from_str(url)?.disable_statement_logging();
        let connect = if pooled {
            // Poolers refuse what they do not keep apart for their clients.
            connect.statement_cache_capacity(0).extra_float_digits(None)
        } else {
            connect.statement_cache_capacity(PREPARED)
        };
        Ok(Self { connect, pooled })
    }

    /// How statements are told to it.
    pub(in crate::jobs::store) fn protocol(&self) -> Protocol {
        if self.pooled {
            Protocol::Whole
        } else {
            Protocol::Prepared
        }
    }

    /// A connection without any limits of time.
    ///
    /// # Errors
    /// `Database` where the server cannot be reached, with why.
    pub(in crate::jobs::store) async fn connect(&self) -> Result<PgConnection> {
        let connected = self.connect.connect().await;
        connected.map_err(|error| Error::Database(Arc::new(error)))
    }

    /// Connections that read. None is made before the first read.
    pub(in crate::jobs::store) fn readers(&self, options: &Options) -> PgPool {
        let pool = PgPoolOptions::new()
            .max_connections(READERS)
            .acquire_timeout(options.busy_timeout);
        let pool = if self.pooled {
            pool
        } else {
            pool.after_connect(|db, _| Box::pin(set_up(db)))
        };
        pool.connect_lazy_with(self.connect.clone())
    }

    /// How processes hear of each other: by notices, or by looking.
    pub(in crate::jobs::store) fn notices(
        &self,
        senders: PgPool,
        committed: Arc<Notify>,
        changed: &watch::Sender<u64>,
    ) -> Notices {
        if self.pooled {
            Notices::polled(changed)
        } else {
            Notices::start(&self.connect, senders, committed, changed)
        }
    }
}

/// The connection that writes.
pub(in crate::jobs::store) struct Session {
    access: Access,
    db: PgConnection,
    /// It is of no use any more: the next transaction needs another one.
    lost: bool,
    /// Its row in `writers`, and the number of its last commit.
    name: String,
    commits: i64,
    /// The last migration that the tables had gone through then.
    version: i64,
    clock: RemoteClock,
    committed: Arc<Notify>,
}

impl Session {
    /// Connects and migrates. `committed` is told of each commit.
    ///
    /// # Errors
    /// `Database` where the server cannot be reached, with why; `Migration` if the schema is of a later
    /// version.
    pub(in crate::jobs::store) async fn open(
        access: &Access,
        clock: RemoteClock,
        committed: Arc<Notify>,
    ) -> Result<Self> {
        let mut db = access.connect().await?;
        schema::migrate(&mut db).await?;
        access.set_up(&mut db).await?;
        let row = sqlx::raw_sql(TIME).fetch_one(&mut db).await?;
        let now: i64 = row.try_get(0)?;
        clock.set(now);
        let before = now - WRITER_LASTS_MS;
        let delete = AssertSqlSafe(format!("DELETE FROM writers WHERE at < {before}"));
        sqlx::raw_sql(delete).execute(&mut db).await?;
        Ok(Self {
            access: access.clone(),
            db,
            lost: false,
            name: Uuid::now_v7().to_string(),
            commits: 0,
            version: 0,
            clock,
            committed,
        })
    }

    /// What statements run on.
    pub(in crate::jobs::store) fn rows(&mut self) -> Db<'_> {
        Db::Postgres(&mut self.db, self.access.protocol())
    }

    async fn connect(&mut self) -> Result<()> {
        let connected = async {
            let mut db = self.access.connect.connect().await?;
            self.access.set_up(&mut db).await?;
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
                self.run("BEGIN").await?;
                // Where the server has not noticed yet that the connection is gone, this waits for its end.
                self.run(LOCK).await?;
                let commits = scalar("SELECT commits FROM writers WHERE name = ?1");
                let commits = commits.bind(self.name.clone());
                let commits: Option<i64> = commits.fetch_optional(&mut self.rows()).await?;
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
        let begin = if self.access.pooled {
            POOLED_BEGIN
        } else {
            BEGIN
        };
        let begun = async { Ok(sqlx::raw_sql(begin).fetch_all(&mut self.db).await?) };
        let rows: Vec<PgRow> = in_time(begun).await?;
        let [row, version] = rows.as_slice() else {
            return Err(Error::Busy);
        };
        self.clock.set(row.try_get(1)?);
        let version: i64 = version.try_get(0)?;
        if version != self.version {
            // Statements that were prepared before a newer program changed the tables are refused.
            in_time(async { Ok(self.db.clear_cached_statements().await?) }).await?;
            self.version = version;
        }
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

impl Access {
    async fn set_up(&self, db: &mut PgConnection) -> sqlx::Result<()> {
        if self.pooled {
            Ok(())
        } else {
            set_up(db).await
        }
    }
}

/// Not told when connecting: poolers between here and the server refuse it there.
async fn set_up(db: &mut PgConnection) -> sqlx::Result<()> {
    sqlx::raw_sql(SETTINGS).execute(db).await?;
    Ok(())
}
