//! The one writer of a process: a task that owns the only connection that may write, and commits in
//! groups.
//!
//! A request is a closure over the open transaction. The task takes all requests that wait, runs
//! each in a savepoint of its own, commits once, and only then answers: an answer means that the
//! disk has it. A request that fails is rolled back alone; a commit that fails fails all of them.
//!
//! How a transaction is begun and ended is the matter of the database: of its [`Session`].

use std::future::Future;
use std::sync::Arc;
use std::time::Duration;

use futures_util::future::BoxFuture;
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

/// A connection that writes, and how a transaction begins and ends on it. While one is open nobody
/// else writes the database.
pub(in crate::jobs::store) trait Session: Send + 'static {
    /// What the statements of a transaction run on.
    type Db<'c>: Send;

    fn db(&mut self) -> Self::Db<'_>;

    /// Begins a transaction, waiting for those of others, but no longer than that.
    fn begin(&mut self, patience: Duration) -> impl Future<Output = Result<()>> + Send;

    /// Runs a statement about a savepoint.
    fn run(&mut self, statement: &'static str) -> impl Future<Output = Result<()>> + Send;

    fn commit(&mut self) -> impl Future<Output = Result<()>> + Send;

    /// Leaves a transaction that failed, wherever it is: after this another one can begin.
    fn roll_back(&mut self) -> impl Future<Output = ()> + Send;

    fn close(self) -> impl Future<Output = Result<()>> + Send;
}

/// An open write transaction, and what its statements need besides.
pub(in crate::jobs::store) struct Transaction<'c, S: Session> {
    /// What statements run on.
    pub(in crate::jobs::store) db: S::Db<'c>,
    /// Milliseconds since the epoch when the request was begun, not when it was queued: a lease
    /// that is given after a wait has its full length.
    pub(in crate::jobs::store) now: i64,
    /// Limits of the store.
    pub(in crate::jobs::store) options: &'c Options,
}

/// Hands requests to the writing task.
pub(in crate::jobs::store) struct Writer<S> {
    requests: mpsc::Sender<Box<dyn Request<S>>>,
    stop: CancellationToken,
    tasks: TaskTracker,
}

impl<S: Session> Writer<S> {
    /// Starts the task; `changed` counts the commits.
    pub(in crate::jobs::store) fn start(
        session: S,
        options: Arc<Options>,
        changed: watch::Sender<u64>,
    ) -> Self {
        let (requests, waiting) = mpsc::channel(QUEUE);
        let stop = CancellationToken::new();
        let tasks = TaskTracker::new();
        let writing = Writing {
            session,
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
        F: for<'c> FnOnce(Transaction<'c, S>) -> BoxFuture<'c, Result<T>> + Send + 'static,
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

    /// Refuses new requests, finishes those that wait, and closes the connection.
    pub(in crate::jobs::store) async fn close(&self) {
        self.stop.cancel();
        self.tasks.wait().await;
    }
}

/// A request without the type of its answer.
trait Request<S: Session>: Send {
    /// Runs the work; whether it is to be kept.
    fn run<'c>(&'c mut self, transaction: Transaction<'c, S>) -> BoxFuture<'c, bool>;

    /// Answers, knowing how the commit went.
    fn answer(self: Box<Self>, committed: Result<()>);
}

struct Pending<T, F> {
    work: Option<F>,
    outcome: Option<Result<T>>,
    reply: oneshot::Sender<Result<T>>,
}

impl<S, T, F> Request<S> for Pending<T, F>
where
    S: Session,
    T: Send,
    F: for<'c> FnOnce(Transaction<'c, S>) -> BoxFuture<'c, Result<T>> + Send,
{
    fn run<'c>(&'c mut self, transaction: Transaction<'c, S>) -> BoxFuture<'c, bool> {
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
struct Writing<S> {
    session: S,
    options: Arc<Options>,
    changed: watch::Sender<u64>,
}

impl<S: Session> Writing<S> {
    async fn run(
        mut self,
        mut waiting: mpsc::Receiver<Box<dyn Request<S>>>,
        stop: CancellationToken,
    ) {
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
                Ok(true) => self.changed.send_modify(|commits| *commits += 1),
                Ok(false) => {}
                Err(error) => {
                    tracing::warn!(requests = taken, code = error.code(), %error, "no commit");
                }
            }
            for request in group.drain(..) {
                request.answer(committed.clone().map(drop));
            }
            if !waiting.is_empty() {
                tokio::time::sleep(GAP).await;
            }
        }
        if let Err(error) = self.session.close().await {
            tracing::warn!(%error, "the writing connection did not close cleanly");
        }
    }

    /// Whether anything was written.
    async fn commit(&mut self, group: &mut [Box<dyn Request<S>>]) -> Result<bool> {
        let committed = self.transact(group).await;
        if committed.is_err() {
            self.session.roll_back().await;
        }
        committed
    }

    async fn transact(&mut self, group: &mut [Box<dyn Request<S>>]) -> Result<bool> {
        self.session.begin(self.options.busy_timeout).await?;
        if let [request] = group {
            // One that is alone needs no savepoint: its failure is the transaction's.
            let transaction = Transaction {
                now: self.options.now(),
                db: self.session.db(),
                options: &self.options,
            };
            if request.run(transaction).await {
                self.session.commit().await?;
                return Ok(true);
            }
            self.session.roll_back().await;
            return Ok(false);
        }
        self.session.run("SAVEPOINT request").await?;
        for request in group {
            let transaction = Transaction {
                now: self.options.now(),
                db: self.session.db(),
                options: &self.options,
            };
            if !request.run(transaction).await {
                // A full disk makes SQLite roll back the whole transaction, and a connection that is
                // lost ends it; there is no savepoint then, this fails, and with it the group, before
                // a later statement could commit by itself.
                self.session.run("ROLLBACK TO request").await?;
            }
            self.session
                .run("RELEASE request; SAVEPOINT request")
                .await?;
        }
        self.session.commit().await?;
        Ok(true)
    }
}
