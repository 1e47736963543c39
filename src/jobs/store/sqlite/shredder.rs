//! Erased rows in the write-ahead log: `secure_delete` overwrites them in the database, but their
//! old pages stay readable in the log until it is emptied.
//!
//! Emptying it needs a moment in which nobody reads or writes, so it is a task of its own with a
//! connection of its own: it asks briefly, and asks again, and holds up neither the request that
//! erased something nor the writer.

use std::sync::Arc;
use std::time::Duration;

use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection};
use tokio::sync::Notify;
use tokio_util::task::AbortOnDropHandle;

/// How long one attempt may keep writers waiting.
const PATIENCE: Duration = Duration::from_millis(50);
/// Pause between two attempts.
const PAUSE: Duration = Duration::from_secs(1);

/// Empties the log when it is woken.
pub(in crate::jobs::store) struct Shredder {
    erased: Arc<Notify>,
    task: AbortOnDropHandle<()>,
}

impl Shredder {
    /// Starts the task. Needs a tokio runtime.
    pub(in crate::jobs::store) fn start(connect: SqliteConnectOptions) -> Self {
        let erased = Arc::new(Notify::new());
        let connect = connect.busy_timeout(PATIENCE);
        let task = tokio::spawn(run(connect, Arc::clone(&erased)));
        Self {
            erased,
            task: AbortOnDropHandle::new(task),
        }
    }

    /// Something was erased.
    pub(in crate::jobs::store) fn wake(&self) {
        self.erased.notify_one();
    }

    /// Ends the task; the last process to close the database empties the log anyway.
    pub(in crate::jobs::store) fn stop(&self) {
        self.task.abort();
    }
}

async fn run(connect: SqliteConnectOptions, erased: Arc<Notify>) {
    loop {
        erased.notified().await;
        loop {
            match empty_log(&connect).await {
                Ok(true) => break,
                Ok(false) => {}
                Err(error) => tracing::debug!(%error, "the log cannot be emptied yet"),
            }
            tokio::time::sleep(PAUSE).await;
        }
    }
}

/// Whether nothing is left in the log.
async fn empty_log(connect: &SqliteConnectOptions) -> sqlx::Result<bool> {
    let mut db = connect.connect().await?;
    let (busy, _, _): (i64, i64, i64) = sqlx::query_as("PRAGMA wal_checkpoint(TRUNCATE)")
        .fetch_one(&mut db)
        .await?;
    db.close().await?;
    Ok(busy == 0)
}
