//! How a transaction of the writing task begins and ends on `SQLite`.

use std::future::Future;
use std::time::{Duration, Instant};

use sqlx::{Connection, SqliteConnection};

use crate::jobs::store::writer::{self, Session};
use crate::jobs::{Error, Result};

/// The writing task of a database that is `SQLite`, whatever the other ones are.
pub(in crate::jobs::store) type Writer = writer::Writer<SqliteConnection>;

/// Pause between two tries to get the lock that another process has. `SQLite` itself would wait longer and longer,
/// up to 100 ms, while those processes commit and go on in two.
const LOOK: Duration = Duration::from_millis(1);

/// Makes a connection that of a writing task: it does not wait for a lock itself, see [`Session::begin`].
pub(in crate::jobs::store) async fn ready(db: &mut SqliteConnection) -> Result<()> {
    db.run("PRAGMA busy_timeout = 0").await
}

impl Session for SqliteConnection {
    type Db<'c> = &'c mut SqliteConnection;

    fn db(&mut self) -> Self::Db<'_> {
        self
    }

    async fn begin(&mut self, patience: Duration) -> Result<()> {
        let start = Instant::now();
        loop {
            match self.run("BEGIN IMMEDIATE").await {
                Err(Error::Busy) if start.elapsed() < patience => tokio::time::sleep(LOOK).await,
                begun => return begun,
            }
        }
    }

    async fn run(&mut self, statement: &'static str) -> Result<()> {
        sqlx::query(statement).execute(self).await?;
        Ok(())
    }

    async fn commit(&mut self) -> Result<()> {
        self.run("COMMIT").await
    }

    async fn roll_back(&mut self) {
        // Fails when SQLite has rolled back already (a full disk), or nothing was begun.
        let _ = self.run("ROLLBACK").await;
    }

    async fn close(self) -> Result<()> {
        Ok(Connection::close(self).await?)
    }
}

impl Writer {
    /// Gives free pages back to the file system, a few in each transaction, until no more than so
    /// many are left.
    pub(in crate::jobs::store) async fn vacuum(&self, keep: i64) -> Result<()> {
        shrink(keep, || {
            self.write(move |tx| Box::pin(give_back(tx.db, keep)))
        })
        .await
    }
}

/// Repeats [`give_back`] in transactions of their own until no more than so many pages are left.
pub(in crate::jobs::store) async fn shrink<F>(keep: i64, give_back: impl Fn() -> F) -> Result<()>
where
    F: Future<Output = Result<i64>>,
{
    let mut before = i64::MAX;
    loop {
        let left = give_back().await?;
        // A database that cannot shrink keeps them.
        if left <= keep || left >= before {
            return Ok(());
        }
        before = left;
    }
}

/// Gives a few free pages back where there are more than so many; how many there were.
pub(in crate::jobs::store) async fn give_back(db: &mut SqliteConnection, keep: i64) -> Result<i64> {
    let count = "PRAGMA freelist_count";
    let free: i64 = sqlx::query_scalar(count).fetch_one(&mut *db).await?;
    if free > keep {
        let give_back = "PRAGMA incremental_vacuum(64)";
        sqlx::query(give_back).execute(db).await?;
    }
    Ok(free)
}
