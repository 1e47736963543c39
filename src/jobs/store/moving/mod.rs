//! From a folder with `SQLite` to a database on a server, and perhaps an object store.
//!
//! Bytes go first, under keys that a second try finds again; then all rows in one transaction, which is
//! rolled back unless each table reads the same on both sides; at last the folder is marked. The id of
//! the database goes along, as the objects bear it; by it a second try knows that the rows are there.

mod bytes;
mod tables;

use std::path::Path;
use std::sync::Arc;

use sqlx::postgres::PgConnection;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{AssertSqlSafe, ConnectOptions, Connection, Row, SqliteConnection};

use super::content::bucket::Bucket;
use super::postgres::{Access, LOCK, home, schema};
use super::{DATABASE_FILE, Options, Store};
use crate::jobs::{Error, Result};
use bytes::cloud_key;
use tables::{Cell, Table, go_on};

pub use bytes::Bytes;
pub use tables::{DERIVED, Sum, TABLES};

/// Tables that have a row in a database where nothing has been done.
const NEVER_EMPTY: [&str; 2] = ["meta", "now_served"];

/// What was moved.
#[derive(Debug)]
pub struct Moved {
    /// Each table, and its rows.
    pub tables: Vec<(&'static str, Sum)>,
    /// The objects that were written.
    pub objects: Bytes,
    /// The rows were there already, from an earlier try.
    pub before: bool,
}

impl Store {
    /// Where the rows of a folder were moved to, if they were.
    ///
    /// # Errors
    /// `Database` if it has no database.
    pub async fn moved_to(folder: &Path) -> Result<Option<String>> {
        let mut db = plain(folder, true).await?;
        let there = "SELECT EXISTS (SELECT 1 FROM sqlite_schema WHERE name = 'meta')";
        let there: bool = sqlx::query_scalar(there).fetch_one(&mut db).await?;
        let select = "SELECT value FROM meta WHERE name = 'moved_to'";
        let moved = if there {
            sqlx::query_scalar(select).fetch_optional(&mut db).await?
        } else {
            None
        };
        db.close().await?;
        Ok(moved)
    }

    /// Lets a service work with the rows of a folder again that were moved.
    ///
    /// # Errors
    /// `Database` if it has no database.
    pub async fn take_back(folder: &Path) -> Result<()> {
        let mut db = plain(folder, false).await?;
        let delete = "DELETE FROM meta WHERE name = 'moved_to'";
        sqlx::query(delete).execute(&mut db).await?;
        Ok(db.close().await?)
    }

    /// Moves all that is in a folder, which the caller holds, to the database and the object store of the
    /// options. `name`: how the database is told of, without a password.
    ///
    /// # Errors
    /// `NotMoved`: why not, and what to do. Nothing is changed on either side then but jobs that ran,
    /// which wait again; objects that were written stay for the next try.
    pub async fn relocate(folder: &Path, options: &Options, name: &str) -> Result<Moved> {
        let url = options.database.as_deref().unwrap_or_default();
        let access = Access::new(url, options.database_pooled)?;
        let mut there = access.connect().await?;
        schema::migrate(&mut there).await?;
        let used = used(folder).await?;
        let objects = match (used, &options.objects) {
            (Some(used), Some(other)) if used != other.to_string() => {
                return Err(Error::NotMoved(format!(
                    "the bytes of this folder are in the object store {used} already; leave --objects \
                     out, or give that address"
                )));
            }
            (Some(used), _) => Some(used.parse().map_err(Error::NotMoved)?),
            (None, _) => None,
        };
        // As a service does when it starts: the tables of this version, and nothing half done.
        if Self::moved_to(folder).await?.is_none() {
            let own = Options {
                objects: objects.clone(),
                ..Options::default()
            };
            let store = Self::open(folder, own).await?;
            let settled = store.settle().await;
            store.close().await;
            settled?;
        }
        let mut here = plain(folder, true).await?;
        let id = id_of(&mut here).await?;
        let mut moved = Moved {
            tables: Vec::new(),
            objects: Bytes::default(),
            before: id_there(&mut there).await? == id,
        };
        if !moved.before {
            check_empty(&mut there).await?;
            let to = options.objects.as_ref().filter(|_| objects.is_none());
            if let Some(url) = to {
                let bucket = Bucket::new(url, options)?;
                bucket.take(&id, false).await?;
                moved.objects = bytes::put(folder, &mut here, &bucket).await?;
            }
            let place = to.map(ToString::to_string);
            let home = home::name_of(folder).map_err(|error| Error::Full(error.to_string()))?;
            moved.tables = rows(&mut here, &mut there, place, home).await?;
        }
        there.close().await?;
        here.close().await?;
        let mut here = plain(folder, false).await?;
        let mark = "INSERT INTO meta (name, value) VALUES ('moved_to', ?1)
                    ON CONFLICT (name) DO UPDATE SET value = excluded.value";
        sqlx::query(mark).bind(name).execute(&mut here).await?;
        here.close().await?;
        Ok(moved)
    }

    /// Has nothing run and nothing be in flight: there is no process any more that would end it.
    async fn settle(&self) -> Result<()> {
        self.release_all().await?;
        self.idempotency_abandon_all().await?;
        Ok(())
    }
}

/// All rows in one transaction.
async fn rows(
    here: &mut SqliteConnection,
    there: &mut PgConnection,
    place: Option<String>,
    home: String,
) -> Result<Vec<(&'static str, Sum)>> {
    // Limits of the role are for short statements.
    let begin = "BEGIN; SET LOCAL statement_timeout = 0; SET LOCAL lock_timeout = 0;
                 SET LOCAL idle_in_transaction_session_timeout = 0";
    sqlx::raw_sql(begin).execute(&mut *there).await?;
    sqlx::query("BEGIN").execute(&mut *here).await?;
    let copied = copy(here, there, place, home).await;
    sqlx::query("ROLLBACK").execute(here).await?;
    let end = if copied.is_ok() { "COMMIT" } else { "ROLLBACK" };
    sqlx::raw_sql(end).execute(there).await?;
    copied
}

async fn copy(
    here: &mut SqliteConnection,
    there: &mut PgConnection,
    place: Option<String>,
    home: String,
) -> Result<Vec<(&'static str, Sum)>> {
    sqlx::raw_sql(LOCK).execute(&mut *there).await?;
    // Somebody may have been here since.
    check_empty(there).await?;
    let mut copied = Vec::new();
    for name in TABLES {
        let table = Table::of(name, here, there).await?;
        run(there, format!("ALTER TABLE {name} DISABLE TRIGGER USER")).await?;
        if NEVER_EMPTY.contains(&name) {
            run(there, format!("DELETE FROM {name}")).await?;
        }
        let of_cloud = ["id", "created_at", "object"].map(|column| table.place(column));
        let sum = table.copy(here, there, |cells| {
            if let ("clouds", true, [Some(id), Some(made), Some(object)]) =
                (name, place.is_some(), of_cloud)
            {
                name_object(cells, id, made, object);
            }
        });
        let sum = sum.await?;
        run(there, format!("ALTER TABLE {name} ENABLE TRIGGER USER")).await?;
        copied.push((name, table, sum));
    }
    go_on(here, there).await?;
    let mut sums = Vec::new();
    for (name, table, sum) in copied {
        let found = table.sum(there).await?;
        if found != sum {
            return Err(Error::NotMoved(format!(
                "the table {name} did not arrive as it is: {} rows of SHA-256 {} became {} of {}",
                sum.rows, sum.sha256, found.rows, found.sha256
            )));
        }
        sums.push((name, sum));
    }
    // What is said of the database as a whole is no longer as it was.
    for (name, value) in [("folder", Some(home)), ("objects", place)] {
        let Some(value) = value else { continue };
        let upsert = "INSERT INTO meta (name, value) VALUES ($1, $2)
                      ON CONFLICT (name) DO UPDATE SET value = excluded.value";
        let upsert = sqlx::query(upsert).bind(name).bind(value);
        upsert.persistent(false).execute(&mut *there).await?;
    }
    Ok(sums)
}

/// The file of a cloud has become an object.
fn name_object(cells: &mut [Cell], id: usize, made: usize, object: usize) {
    if let (Cell::Text(Some(id)), Cell::Integer(Some(made)), Cell::Text(None)) =
        (&cells[id], &cells[made], &cells[object])
    {
        cells[object] = Cell::Text(Some(cloud_key(id, *made)));
    }
}

/// Finds that nothing is in the database that would be lost or mixed up.
async fn check_empty(there: &mut PgConnection) -> Result<()> {
    for name in TABLES.iter().filter(|name| !NEVER_EMPTY.contains(name)) {
        let select = format!("SELECT EXISTS (SELECT 1 FROM {name})");
        let row = sqlx::raw_sql(AssertSqlSafe(select))
            .fetch_one(&mut *there)
            .await?;
        if row.try_get(0)? {
            return Err(Error::NotMoved(format!(
                "the database has rows already, in the table {name}; name one that is empty or new"
            )));
        }
    }
    Ok(())
}

async fn run(there: &mut PgConnection, statement: String) -> Result<()> {
    sqlx::raw_sql(AssertSqlSafe(statement))
        .execute(there)
        .await?;
    Ok(())
}

async fn id_of(here: &mut SqliteConnection) -> Result<String> {
    let select = "SELECT value FROM meta WHERE name = 'id'";
    Ok(sqlx::query_scalar(select).fetch_one(here).await?)
}

async fn id_there(there: &mut PgConnection) -> Result<String> {
    let select = "SELECT value FROM meta WHERE name = 'id'";
    Ok(sqlx::raw_sql(select).fetch_one(there).await?.try_get(0)?)
}

/// The object store with the bytes of a folder, if one has them.
async fn used(folder: &Path) -> Result<Option<String>> {
    let options = Options {
        rows_only: true,
        ..Options::default()
    };
    // Brings the tables up to date first: earlier versions knew no object stores.
    Store::migrate(folder, &options).await?;
    let mut db = plain(folder, true).await?;
    let select = "SELECT value FROM meta WHERE name = 'objects'";
    let used = sqlx::query_scalar(select).fetch_optional(&mut db).await?;
    db.close().await?;
    Ok(used)
}

/// A connection to the rows of a folder that nobody works in.
async fn plain(folder: &Path, read_only: bool) -> Result<SqliteConnection> {
    let connect = SqliteConnectOptions::new()
        .filename(folder.join(DATABASE_FILE))
        .read_only(read_only)
        .disable_statement_logging();
    connect
        .connect()
        .await
        .map_err(|error| Error::Database(Arc::new(error)))
}
