//! Whether a database is ours, and since when it is here.

use std::path::Path;

use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection};

use crate::jobs::store::sql::{either, scalar};
use crate::jobs::store::{DATABASE_FILE, Store};
use crate::jobs::{Result, clock};

/// Whether the folder holds a database that some version of this program made. Writes nothing.
///
/// # Errors
/// `Database` if there is such a file but it cannot be read as a database.
pub async fn is_ours(data_dir: &Path) -> Result<bool> {
    let file = data_dir.join(DATABASE_FILE);
    if !file.is_file() {
        return Ok(false);
    }
    let connect = SqliteConnectOptions::new()
        .filename(file)
        .read_only(true)
        .disable_statement_logging();
    let mut db = connect.connect().await?;
    // Two steps: without the table, the second statement is none.
    let migrated: bool = sqlx::query_scalar(
        "SELECT EXISTS (SELECT 1 FROM sqlite_schema WHERE type = 'table' AND name = '_sqlx_migrations')",
    )
    .fetch_one(&mut db)
    .await?;
    let ours = migrated
        && sqlx::query_scalar(
            "SELECT EXISTS (SELECT 1 FROM _sqlx_migrations
                            WHERE version = 1 AND description = 'init')",
        )
        .fetch_one(&mut db)
        .await?;
    db.close().await?;
    Ok(ours)
}

impl Store {
    /// When the database was made, in whole seconds since the epoch by the clock of this machine, which
    /// files have their times from.
    pub async fn made_at(&self) -> Result<i64> {
        let made_at: i64 = scalar(either(
            "SELECT CAST(strftime('%s', MIN(installed_on)) AS INTEGER) FROM _sqlx_migrations",
            "SELECT CAST(FLOOR(EXTRACT(EPOCH FROM MIN(installed_on))) AS BIGINT)
             FROM _sqlx_migrations",
        ))
        .fetch_one(self.readers())
        .await?;
        let ahead = self.now() - clock::now();
        Ok(made_at - ahead / 1_000)
    }
}
