//! The one writer of a process: a task that owns the only connection that may write, and commits in
//! groups.
//!
//! A request is a closure over the open transaction. The task takes all requests that wait, runs
//! each in a savepoint of its own, commits once, and only then answers: an answer means that the
//! disk has it. A request that fails is rolled back alone; a commit that fails fails all of them.

use std::sync::Arc;
use std::time::Duration;

use futures_util::future::BoxFuture;
use sqlx::{Connection, SqliteConnection};
use tokio::sync::{mpsc, oneshot, watch};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::jobs::store::Options;
use crate::jobs::{Error, Result};

/// Most requests in one commit: bounds how long the first of them waits for the last.
const MAX_GROUP: usize = 64;

/// Requests that may wait before the next one waits to be put into the queue.
const QUEUE: usize = 1_024;

/// Pause between two commits when requests wait already. Other processes look for the lock every
/// 1 to 100 ms (`SQLite`'s busy handler is not fair); without a gap a busy server would starve the
/// renewals of its workers. The next group grows meanwhile, so that little throughput is lost.
const GAP: Duration = Duration::from_millis(1);

/// An open write transaction, and what its statements need besides.
pub(in crate::jobs::store) struct Transaction<'c> {
    /// The connection that writes.
    pub(in crate::jobs::store) db: &'c mut SqliteConnection,
    /// Milliseconds since the epoch when the request was begun, not when it was queued: a lease
    /// that is given after a wait has its full length.
    pub(in crate::jobs::store) now: i64,
    /// Limits of the store.
    pub(in crate::jobs::store) options: &'c Options,
}

/// Hands requests to the writing task.
pub(in crate::jobs::store) struct Writer {
    requests: mpsc::Sender<Box<dyn Request>>,
    stop: CancellationToken,
    tasks: TaskTracker,
}

impl Writer {
    /// Starts the task; `changed` counts the commits.
    pub(in crate::jobs::store) fn start(
        db: SqliteConnection,
        options: Arc<Options>,
        changed: watch::Sender<u64>,
    ) -> Self {
        let (requests, waiting) = mpsc::channel(QUEUE);
        let stop = CancellationToken::new();
        let tasks = TaskTracker::new();
        let writing = Writing {
            db,
            options,
            changed,
        };
        tasks.spawn(writing.run(waiting, stop.clone()));
        tasks.close();
        Self {
            requests,
            stop,
            tasks,
        }
    }

    /// Runs `work` in a transaction and answers after its commit. A caller that goes away does not
    /// stop it.
    ///
    /// # Errors
    /// What `work` says, or why the commit failed; nothing was written then.
    pub(in crate::jobs::store) async fn write<T, F>(&self, work: F) -> Result<T>
    where
        T: Send + 'static,
        F: for<'c> FnOnce(Transaction<'c>) -> BoxFuture<'c, Result<T>> + Send + 'static,
    {
        let (reply, answer) = oneshot::channel();
        let pending = Pending {
            work: Some(work),
            outcome: None,
            reply,
        };
        self.requests
            .send(Box::new(pending))
            .await
            .map_err(|_| Error::Closed)?;
        answer.await.unwrap_or(Err(Error::Closed))
    }

    /// Gives free pages back to the file system, a few in each transaction, until no more than so
    /// many are left.
    pub(in crate::jobs::store) async fn vacuum(&self, keep: i64) -> Result<()> {
        let mut before = i64::MAX;
        loop {
            let left = self.write(move |tx| {
                Box::pin(async move {
                    let count = "PRAGMA freelist_count";
                    let free: i64 = sqlx::query_scalar(count).fetch_one(&mut *tx.db).await?;
                    if free > keep {
                        let give_back = "PRAGMA incremental_vacuum(64)";
                        sqlx::query(give_back).execute(tx.db).await?;
                    }
                    Ok(free)
                })
            });
            let left = left.await?;
            // A database that cannot shrink keeps them.
            if left <= keep || left >= before {
                return Ok(());
            }
            before = left;
        }
    }

    /// Refuses new requests, finishes those that wait, and closes the connection.
    pub(in crate::jobs::store) async fn close(&self) {
        self.stop.cancel();
        self.tasks.wait().await;
    }
}

/// A request without the type of its answer.
trait Request: Send {
    /// Runs the work; whether it is to be kept.
    fn run<'c>(&'c mut self, transaction: Transaction<'c>) -> BoxFuture<'c, bool>;

    /// Answers, knowing how the commit went.
    fn answer(self: Box<Self>, committed: Result<()>);
}

struct Pending<T, F> {
    work: Option<F>,
    outcome: Option<Result<T>>,
    reply: oneshot::Sender<Result<T>>,
}

impl<T, F> Request for Pending<T, F>
where
    T: Send,
    F: for<'c> FnOnce(Transaction<'c>) -> BoxFuture<'c, Result<T>> + Send,
{
    fn run<'c>(&'c mut self, transaction: Transaction<'c>) -> BoxFuture<'c, bool> {
        Box::pin(async move {
            let Some(work) = self.work.take() else {
                return false;
            };
            let outcome = work(transaction).await;
            let kept = outcome.is_ok();
            self.outcome = Some(outcome);
            kept
        })
    }

    fn answer(self: Box<Self>, committed: Result<()>) {
        let answer = match (self.outcome, committed) {
            (Some(Err(own)), _) => Err(own),
            (_, Err(shared)) => Err(shared),
            (Some(Ok(value)), Ok(())) => Ok(value),
            (None, Ok(())) => Err(Error::Closed),
        };
        // Whoever asked may have gone away; what was committed stays.
        let _ = self.reply.send(answer);
    }
}

/// The task's own things.
struct Writing {
    db: SqliteConnection,
    options: Arc<Options>,
    changed: watch::Sender<u64>,
}

impl Writing {
    async fn run(mut self, mut waiting: mpsc::Receiver<Box<dyn Request>>, stop: CancellationToken) {
        let mut group = Vec::with_capacity(MAX_GROUP);
        loop {
            let taken = tokio::select! {
                biased;
                () = stop.cancelled(), if !waiting.is_closed() => {
                    waiting.close();
                    continue;
                }
                taken = waiting.recv_many(&mut group, MAX_GROUP) => taken,
            };
            if taken == 0 {
                break;
            }
            let committed = self.commit(&mut group).await;
            match &committed {
                Ok(()) => self.changed.send_modify(|commits| *commits += 1),
                Err(error) => {
                    tracing::warn!(requests = taken, code = error.code(), %error, "no commit");
                }
            }
            for request in group.drain(..) {
                request.answer(committed.clone());
            }
            if !waiting.is_empty() {
                tokio::time::sleep(GAP).await;
            }
        }
        if let Err(error) = self.db.close().await {
            tracing::warn!(%error, "the writing connection did not close cleanly");
        }
    }

    async fn commit(&mut self, group: &mut [Box<dyn Request>]) -> Result<()> {
        let committed = self.transact(group).await;
        if committed.is_err() {
            // Fails when SQLite has rolled back already (a full disk), or nothing was begun.
            let _ = self.execute("ROLLBACK").await;
        }
        committed
    }

    async fn transact(&mut self, group: &mut [Box<dyn Request>]) -> Result<()> {
        self.execute("BEGIN IMMEDIATE").await?;
        for request in group {
            self.execute("SAVEPOINT request").await?;
            let transaction = Transaction {
                now: (self.options.clock)(),
                db: &mut self.db,
                options: &self.options,
            };
            if !request.run(transaction).await {
                // A full disk makes SQLite roll back the whole transaction; there is no savepoint
                // then, this fails, and with it the group, before a later statement could commit
                // by itself.
                self.execute("ROLLBACK TO request").await?;
            }
            self.execute("RELEASE request").await?;
        }
        self.execute("COMMIT").await
    }

    async fn execute(&mut self, statement: &'static str) -> Result<()> {
        sqlx::query(statement).execute(&mut self.db).await?;
        Ok(())
    }
}
