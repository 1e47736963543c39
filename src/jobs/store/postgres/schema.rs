//! The schema on a server: several programs of several versions may use it at the same time.
//!
//! All new migrations of a program are one transaction, in which nobody else writes: as on `SQLite`, whoever
//! comes second finds them done. A program works with tables that a newer one has brought up to date, unless
//! `meta` has a row `least_schema`: the number of the migration that a program must know at least.

use sqlx::Row;
use sqlx::migrate::MigrateError;
use sqlx::postgres::{PgConnection, PgRow};

use crate::jobs::store::postgres::LOCK;
use crate::jobs::store::schema::{Migrations, Schema, migrator};
use crate::jobs::{Error, Result};

const MIGRATIONS: &Migrations = &[
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
    (
        "shares",
        include_str!("../../../../migrations/postgres/0004_shares.sql"),
    ),
    (
        "counted together",
        include_str!("../../../../migrations/postgres/0005_counted_together.sql"),
    ),
];

/// The driver's own table of migrations, which its other tools know.
const TABLE: &str = "CREATE TABLE IF NOT EXISTS _sqlx_migrations (
    version BIGINT PRIMARY KEY,
    description TEXT NOT NULL,
    installed_on TIMESTAMPTZ NOT NULL DEFAULT now(),
    success BOOLEAN NOT NULL,
    checksum BYTEA NOT NULL,
    execution_time BIGINT NOT NULL
)";

/// How far the tables are, without changing anything.
///
/// # Errors
/// `Newer` if this program is too old for them; `Migration` if they are none of ours.
pub(in crate::jobs::store) async fn schema(db: &mut PgConnection) -> Result<Schema> {
    let known = MIGRATIONS.len() as i64;
    let applied = applied(db).await?;
    for (version, (applied, checksum)) in (1..=known).zip(&applied) {
        let own = migrator(MIGRATIONS, true);
        let own = own.iter().find(|migration| migration.version == version);
        if *applied != version {
            return Err(MigrateError::VersionMissing(version).into());
        }
        if own.is_some_and(|own| *own.checksum != **checksum) {
            return Err(MigrateError::VersionMismatch(version).into());
        }
    }
    let found = applied.last().map_or(0, |(version, _)| *version);
    if found > known {
        let select = "SELECT value FROM meta WHERE name = 'least_schema'";
        let least = sqlx::raw_sql(select).fetch_optional(db).await?;
        let least: Option<String> = least.map(|row| row.try_get(0)).transpose()?;
        let least = least.map(|least| least.parse().unwrap_or(i64::MAX));
        if let Some(needs) = least.filter(|least| *least > known) {
            return Err(Error::Newer { needs, known });
        }
    }
    Ok(Schema { found, known })
}

async fn applied(db: &mut PgConnection) -> Result<Vec<(i64, Vec<u8>)>> {
    let select = "SELECT to_regclass('_sqlx_migrations') IS NOT NULL";
    let there = sqlx::raw_sql(select).fetch_one(&mut *db).await?;
    if !there.try_get::<bool, _>(0)? {
        return Ok(Vec::new());
    }
    let select = "SELECT version, checksum FROM _sqlx_migrations ORDER BY version";
    let rows = sqlx::raw_sql(select).fetch_all(db).await?;
    let migration = |row: &PgRow| Ok((row.try_get(0)?, row.try_get(1)?));
    rows.iter().map(migration).collect()
}

/// Brings the tables up to date; how far they were.
///
/// # Errors
/// As [`schema`].
pub(in crate::jobs::store) async fn migrate(db: &mut PgConnection) -> Result<Schema> {
    // The usual case takes no lock.
    let before = schema(db).await?;
    if before.is_current() {
        return Ok(before);
    }
    sqlx::raw_sql("BEGIN").execute(&mut *db).await?;
    let migrated = apply(db).await;
    let end = if migrated.is_ok() {
        "COMMIT"
    } else {
        "ROLLBACK"
    };
    sqlx::raw_sql(end).execute(db).await?;
    migrated
}

/// Runs what is new. No statement is prepared: there may be a pooler between.
async fn apply(db: &mut PgConnection) -> Result<Schema> {
    sqlx::raw_sql(LOCK).execute(&mut *db).await?;
    // Others may have been first.
    let before = schema(db).await?;
    sqlx::raw_sql(TABLE).execute(&mut *db).await?;
    for migration in migrator(MIGRATIONS, true).iter() {
        if migration.version <= before.found {
            continue;
        }
        let failed = |error| MigrateError::ExecuteMigration(error, migration.version);
        let run = sqlx::raw_sql(migration.sql.clone()).execute(&mut *db).await;
        run.map_err(failed)?;
        let insert = "INSERT INTO _sqlx_migrations
                (version, description, success, checksum, execution_time)
            VALUES ($1, $2, TRUE, $3, -1)";
        let insert = sqlx::query(insert)
            .bind(migration.version)
            .bind(&*migration.description)
            .bind(&*migration.checksum)
            .persistent(false);
        insert.execute(&mut *db).await?;
    }
    Ok(before)
}
