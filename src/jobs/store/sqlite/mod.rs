//! How the databases are opened, migrated, written and cleaned.
//!
//! The migrations run inside one IMMEDIATE transaction, so that processes that open a new folder at
//! the same moment do not both create the tables.

pub(in crate::jobs::store) mod origin;
pub(in crate::jobs::store) mod shredder;
pub(in crate::jobs::store) mod writer;

use std::path::Path;
use std::time::{Duration, Instant};

use sqlx::sqlite::{
    SqliteAutoVacuum, SqliteConnectOptions, SqliteJournalMode, SqlitePool, SqlitePoolOptions,
    SqliteSynchronous,
};
use sqlx::{ConnectOptions, SqliteConnection};

use crate::jobs::store::schema::{Migrations, migrator};
use crate::jobs::store::{Options, READERS};
use crate::jobs::{Error, Result};

/// The write-ahead log is cut to this size after a checkpoint.
const LOG_LIMIT_BYTES: &str = "8388608";

/// Busy timeouts that opening waits while other processes open the same database.
pub(in crate::jobs::store) const OPENING: u32 = 4;

/// Pause between two tries of that.
const PAUSE: Duration = Duration::from_millis(20);

/// How a database is opened.
pub(in crate::jobs::store) fn connect_options(
    file: &Path,
    options: &Options,
) -> SqliteConnectOptions {
    SqliteConnectOptions::new()
        .filename(file)
        .foreign_keys(true)
        .busy_timeout(options.busy_timeout)
        .disable_statement_logging()
}

/// How it is opened to be written.
pub(in crate::jobs::store) fn writing(connect: &SqliteConnectOptions) -> SqliteConnectOptions {
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

pub(in crate::jobs::store) const MIGRATIONS: [(&str, &str); 22] = [
    ("init", include_str!("../../../../migrations/0001_init.sql")),
    (
        "erased_clouds",
        include_str!("../../../../migrations/0002_erased_clouds.sql"),
    ),
    (
        "answers_about_clouds",
        include_str!("../../../../migrations/0003_answers_about_clouds.sql"),
    ),
    (
        "jobs_by_verdict",
        include_str!("../../../../migrations/0004_jobs_by_verdict.sql"),
    ),
    (
        "metrics_of_blocks",
        include_str!("../../../../migrations/0005_metrics_of_blocks.sql"),
    ),
    ("work", include_str!("../../../../migrations/0006_work.sql")),
    (
        "objects",
        include_str!("../../../../migrations/0007_objects.sql"),
    ),
    (
        "verdicts_of_snapshots",
        include_str!("../../../../migrations/0008_verdicts_of_snapshots.sql"),
    ),
    (
        "sources",
        include_str!("../../../../migrations/0009_sources.sql"),
    ),
    (
        "tenants",
        include_str!("../../../../migrations/0010_tenants.sql"),
    ),
    (
        "turns",
        include_str!("../../../../migrations/0011_turns.sql"),
    ),
    ("keys", include_str!("../../../../migrations/0012_keys.sql")),
    (
        "uploads",
        include_str!("../../../../migrations/0013_uploads.sql"),
    ),
    (
        "retention",
        include_str!("../../../../migrations/0014_retention.sql"),
    ),
    (
        "batches",
        include_str!("../../../../migrations/0015_batches.sql"),
    ),
    (
        "webhooks",
        include_str!("../../../../migrations/0016_webhooks.sql"),
    ),
    (
        "waiting",
        include_str!("../../../../migrations/0017_waiting.sql"),
    ),
    (
        "sums_of_waiting",
        include_str!("../../../../migrations/0018_sums_of_waiting.sql"),
    ),
    (
        "cloud_objects",
        include_str!("../../../../migrations/0019_cloud_objects.sql"),
    ),
    (
        "nodes",
        include_str!("../../../../migrations/0020_nodes.sql"),
    ),
    (
        "histories",
        include_str!("../../../../migrations/0021_histories.sql"),
    ),
    (
        "shares",
        include_str!("../../../../migrations/0022_shares.sql"),
    ),
];

/// Connections that read it.
pub(in crate::jobs::store) async fn readers(
    connect: SqliteConnectOptions,
    options: &Options,
) -> Result<SqlitePool> {
    let pool = SqlitePoolOptions::new()
        .max_connections(READERS)
        .acquire_timeout(options.busy_timeout)
        .idle_timeout(None)
        .max_lifetime(None);
    Ok(pool.connect_with(connect.read_only(true)).await?)
}

/// A connection to the database, migrated. SQLite refuses to change the journal of a new database while another
/// process does so, without waiting; and migrations of several processes take their time one after the other.
pub(in crate::jobs::store) async fn migrated(
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
    let migrator = migrator(migrations, true);
    sqlx::query("BEGIN IMMEDIATE").execute(&mut *db).await?;
    if let Err(error) = migrator.run_direct(None, db, false).await {
        sqlx::query("ROLLBACK").execute(&mut *db).await?;
        return Err(error.into());
    }
    sqlx::query("COMMIT").execute(db).await?;
    Ok(())
}
