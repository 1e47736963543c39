//! What can go wrong with clouds, jobs and their rows, each with a stable code.

use std::sync::Arc;

use sqlx::postgres::PgDatabaseError;
use thiserror::Error;

use super::CloudId;
use crate::identity::Policy;

/// Why the store did not do what it was asked. Nothing was written.
///
/// It can be cloned, because all requests of a group commit that fails share its reason.
#[derive(Debug, Clone, Error)]
#[non_exhaustive]
pub enum Error {
    /// Another writer held the database for longer than the busy timeout, or its server is away.
    #[error("the database is busy or cannot be reached; try again in a moment")]
    Busy,
    /// The disk is full or refuses to be written.
    #[error("the disk is full or cannot be written: {0}")]
    Full(String),
    /// The object store with the content is away, or does not do what it is asked.
    #[error("the object store does not do what it is asked: {0}")]
    ContentUnavailable(String),
    /// The object store that was named cannot be used, or is not that of the database.
    #[error("{0}")]
    ContentRefused(String),
    /// As many jobs as allowed wait already.
    #[error("{limit} jobs are waiting already")]
    QueueFull {
        /// Most jobs that may wait.
        limit: u64,
    },
    /// The tenant or the key has taken all that it may.
    #[error("the quota {} of {} {} is used up", policy.name(), policy.quota, policy.unit())]
    Quota {
        /// Which limit it is.
        policy: Policy,
        /// When it is worth to try again.
        retry_seconds: u32,
    },
    /// The job names a cloud that is not here.
    #[error("there is no cloud {0}")]
    CloudMissing(CloudId),
    /// It is held: nobody may erase it.
    #[error("it is held; whoever may erase it can lift the hold first")]
    Held,
    /// The claim is over: the job ended, was erased, or runs in another attempt.
    #[error("the claim on the job is over")]
    Stale,
    /// A mesh at evaluation 0 would take the place of the result.
    #[error("a snapshot needs an evaluation of at least 1")]
    SnapshotAtZero,
    /// A row holds something that this version never writes.
    #[error("{table}.{column} holds something unexpected: {detail}")]
    Inconsistent {
        /// Table of the row.
        table: &'static str,
        /// Column of the row.
        column: &'static str,
        /// What is wrong with it.
        detail: String,
    },
    /// The store was closed while the request waited.
    #[error("the store is closed")]
    Closed,
    /// The database on the server has the rows of another data folder.
    #[error(
        "the database belongs to another data folder, which has the bytes that its rows name; name \
         that folder, or another database"
    )]
    Elsewhere,
    /// The rows of the folder are in another database now.
    #[error(
        "the rows of this folder were moved to {0}; serve that with --database, or let this folder be worked \
         with again by `meshway move --take-back`: it has nothing of what happened since"
    )]
    Moved(String),
    /// Rows and bytes are not moved, and why.
    #[error("{0}")]
    NotMoved(String),
    /// The tables are for later versions of this program.
    #[error(
        "the tables need a program that knows migration {needs}, and this one knows {known} and no later \
         one; use a newer version of it, as the others that work with this database do"
    )]
    Newer {
        /// Number of the migration that a program must know.
        needs: i64,
        /// The last one that this program knows.
        known: i64,
    },
    /// The schema cannot be brought up to date.
    #[error("migrating the database: {0}")]
    Migration(Arc<sqlx::migrate::MigrateError>),
    /// The database refused an operation: a defect of ours or of the file.
    #[error("database: {0}")]
    Database(Arc<sqlx::Error>),
}

impl Error {
    /// Stable `snake_case` name, the same in logs and over HTTP.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Busy => "database_busy",
            Self::Full(_) => "insufficient_storage",
            Self::ContentUnavailable(_) => "storage_unavailable",
            Self::QueueFull { .. } => "queue_full",
            Self::Quota { .. } => "quota",
            Self::CloudMissing(_) => "cloud_missing",
            Self::Held => "held",
            Self::Stale => "stale_attempt",
            Self::Closed => "draining",
            Self::ContentRefused(_)
            | Self::SnapshotAtZero
            | Self::Inconsistent { .. }
            | Self::Elsewhere
            | Self::Newer { .. }
            | Self::Moved(_)
            | Self::NotMoved(_)
            | Self::Migration(_)
            | Self::Database(_) => "internal",
        }
    }

    /// A column that cannot be read, for `map_err`.
    pub(super) fn inconsistent<E: ToString>(
        table: &'static str,
        column: &'static str,
    ) -> impl FnOnce(E) -> Self {
        move |error| Self::Inconsistent {
            table,
            column,
            detail: error.to_string(),
        }
    }
}

impl From<sqlx::Error> for Error {
    fn from(error: sqlx::Error) -> Self {
        // Primary result codes of SQLite; extended ones carry them in their low byte.
        const BUSY: i32 = 5;
        const LOCKED: i32 = 6;
        const READONLY: i32 = 8;
        const IOERR: i32 = 10;
        const FULL: i32 = 13;
        match &error {
            sqlx::Error::PoolClosed | sqlx::Error::WorkerCrashed => Self::Closed,
            // The connection to a server was lost, or cannot be made.
            sqlx::Error::PoolTimedOut
            | sqlx::Error::Io(_)
            | sqlx::Error::Tls(_)
            | sqlx::Error::Protocol(_) => Self::Busy,
            sqlx::Error::Database(database)
                if database.try_downcast_ref::<PgDatabaseError>().is_some() =>
            {
                let code = database.code().unwrap_or_default();
                let detail = database.message().to_owned();
                of_postgres(&code, detail).unwrap_or_else(|| Self::Database(Arc::new(error)))
            }
            sqlx::Error::Database(database) => {
                let code = database
                    .code()
                    .and_then(|code| code.parse::<i32>().ok())
                    .map(|code| code & 0xff);
                match code {
                    Some(BUSY | LOCKED) => Self::Busy,
                    Some(FULL | IOERR | READONLY) => Self::Full(database.message().to_owned()),
                    _ => Self::Database(Arc::new(error)),
                }
            }
            _ => Self::Database(Arc::new(error)),
        }
    }
}

/// What a SQLSTATE means for whoever asked; none for a defect of ours.
fn of_postgres(code: &str, detail: String) -> Option<Error> {
    /// Classes and codes of what passes: connections, shut-downs and starts of the server, too many
    /// clients, conflicts, locks, time-outs, and a server that only reads because another one took over.
    const PASSES: [&str; 11] = [
        "08", "57P01", "57P02", "57P03", "53300", "40001", "40P01", "55P03", "57014", "25006",
        "25P03",
    ];
    match code {
        "53100" => Some(Error::Full(detail)),
        "23503" | "23514" => Some(Error::Inconsistent {
            table: "the database",
            column: "a constraint",
            detail,
        }),
        code if PASSES.iter().any(|passes| code.starts_with(passes)) => Some(Error::Busy),
        _ => None,
    }
}

impl From<sqlx::migrate::MigrateError> for Error {
    fn from(error: sqlx::migrate::MigrateError) -> Self {
        Self::Migration(Arc::new(error))
    }
}
