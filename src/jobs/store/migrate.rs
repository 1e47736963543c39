//! How far the tables are, and bringing them up to date without working with them.

use std::path::Path;

use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection};

use super::postgres::{self, Access};
use super::schema::Schema;
use super::sqlite::{MIGRATIONS, OPENING, connect_options, migrated, writing};
use super::{DATABASE_FILE, Options, Store};
use crate::jobs::{Error, Result};

impl Store {
    /// How far the tables are that [`Store::open`] would open. Nothing is changed.
    ///
    /// # Errors
    /// `Newer` and `Migration` if this program cannot work with them; `Database` if there is no database.
    pub async fn schema(data_dir: &Path, options: &Options) -> Result<Schema> {
        let Some(url) = &options.database else {
            return schema_of(&data_dir.join(DATABASE_FILE)).await;
        };
        let mut db = Access::new(url, options.database_pooled)?.connect().await?;
        let found = postgres::schema::schema(&mut db).await?;
        db.close().await?;
        Ok(found)
    }

    /// Brings them up to date; how far they were. On `SQLite` nobody else may work in the folder.
    ///
    /// # Errors
    /// As [`Store::schema`]; nothing was changed then.
    pub async fn migrate(data_dir: &Path, options: &Options) -> Result<Schema> {
        if let Some(url) = &options.database {
            let mut db = Access::new(url, options.database_pooled)?.connect().await?;
            let before = postgres::schema::migrate(&mut db).await?;
            db.close().await?;
            return Ok(before);
        }
        let file = data_dir.join(DATABASE_FILE);
        let before = schema_of(&file).await?;
        let connect = writing(&connect_options(&file, options));
        let db = migrated(&connect, &MIGRATIONS, OPENING * options.busy_timeout).await?;
        db.close().await?;
        Ok(before)
    }
}

async fn schema_of(file: &Path) -> Result<Schema> {
    let connect = SqliteConnectOptions::new()
        .filename(file)
        .read_only(true)
        .disable_statement_logging();
    let mut db = connect.connect().await?;
    let select = "SELECT COALESCE(MAX(version), 0) FROM _sqlx_migrations";
    let found = sqlx::query_scalar(select).fetch_one(&mut db).await?;
    db.close().await?;
    let known = MIGRATIONS.len() as i64;
    if found > known {
        return Err(Error::Newer {
            needs: found,
            known,
        });
    }
    Ok(Schema { found, known })
}
