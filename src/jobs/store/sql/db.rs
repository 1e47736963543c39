//! What statements run on: a connection, or a pool of them.

use std::future::Future;
use std::time::Duration;

use sqlx::postgres::{PgConnection, PgPool, Postgres};
use sqlx::sqlite::{Sqlite, SqliteConnection, SqlitePool};
use sqlx::{SqlSafeStr, Transaction};

use crate::jobs::{Error, Result};

/// How long a server may be silent. It ends a statement itself earlier than that.
const SILENCE: Duration = Duration::from_secs(8);

/// Writes a record of no meaning, and waits until the server's disk has it: so it has all that was committed
/// before.
pub(in crate::jobs::store) const FLUSH: &str =
    "SELECT pg_logical_emit_message(true, 'meshway', '')";

/// Waits for a server, but not for one that is gone.
///
/// # Errors
/// `Busy` if it is silent for too long.
pub(in crate::jobs::store) async fn in_time<T>(work: impl Future<Output = Result<T>>) -> Result<T> {
    let result = tokio::time::timeout(SILENCE, work).await;
    result.unwrap_or(Err(Error::Busy))
}

/// How statements are told to Postgres.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::jobs::store) enum Protocol {
    /// Each is prepared once a connection, and gets its values apart.
    Prepared,
    /// Each is one message with its values in it: behind a pooler the next message may reach another
    /// session, which knows nothing of what was prepared.
    Whole,
}

/// A connection, with a transaction that its owner began.
pub(in crate::jobs::store) enum Db<'c> {
    Sqlite(&'c mut SqliteConnection),
    Postgres(&'c mut PgConnection, Protocol),
}

/// Connections that read.
#[derive(Clone)]
pub(in crate::jobs::store) enum Readers {
    Sqlite(SqlitePool),
    Postgres(PgPool, Protocol),
}

/// Reads that see the same moment.
pub(in crate::jobs::store) enum Snapshot {
    Sqlite(Transaction<'static, Sqlite>),
    Postgres(Transaction<'static, Postgres>, Protocol),
}

/// What one statement runs on.
pub(in crate::jobs::store) enum On<'e> {
    Sqlite(&'e mut SqliteConnection),
    SqlitePool(&'e SqlitePool),
    Postgres(&'e mut PgConnection, Protocol),
    PostgresPool(&'e PgPool, Protocol),
}

impl Readers {
    /// Begins reads that see one moment.
    pub(in crate::jobs::store) async fn begin(&self) -> Result<Snapshot> {
        const SNAPSHOT: &str = "BEGIN ISOLATION LEVEL REPEATABLE READ, READ ONLY";
        Ok(match self {
            Self::Sqlite(pool) => Snapshot::Sqlite(pool.begin().await?),
            Self::Postgres(pool, protocol) => {
                let begun = pool.begin_with(SNAPSHOT.into_sql_str()).await?;
                Snapshot::Postgres(begun, *protocol)
            }
        })
    }

    /// Closes all connections; later statements get `Closed`.
    pub(in crate::jobs::store) async fn close(&self) {
        match self {
            Self::Sqlite(pool) => pool.close().await,
            Self::Postgres(pool, _) => pool.close().await,
        }
    }
}

impl Snapshot {
    /// The connection that sees it.
    pub(in crate::jobs::store) fn db(&mut self) -> Db<'_> {
        match self {
            Self::Sqlite(transaction) => Db::Sqlite(transaction),
            Self::Postgres(transaction, protocol) => Db::Postgres(transaction, *protocol),
        }
    }
}

impl<'e> From<&'e mut Db<'_>> for On<'e> {
    fn from(db: &'e mut Db<'_>) -> Self {
        match db {
            Db::Sqlite(db) => Self::Sqlite(db),
            Db::Postgres(db, protocol) => Self::Postgres(db, *protocol),
        }
    }
}

impl<'e> From<&'e Readers> for On<'e> {
    fn from(readers: &'e Readers) -> Self {
        match readers {
            Readers::Sqlite(pool) => Self::SqlitePool(pool),
            Readers::Postgres(pool, protocol) => Self::PostgresPool(pool, *protocol),
        }
    }
}
