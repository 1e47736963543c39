//! One attempt at a job, from its claim to its end.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use tokio::sync::{mpsc, oneshot};
use tokio::time::MissedTickBehavior;
use tokio_util::task::AbortOnDropHandle;

use super::control::{Control, Stop};
use super::desk::{Clerk, Desk};
use super::insist::Insist;
use super::progress::Pending;
use super::puts::{Content, Puts};
use super::sink::{Message, Sink};
use super::work::{Assignment, Failure, cloud_missing, encode};
use super::{End, Worker, lease};
use crate::jobs::{
    Claim, Cloud, Error, FailureReason, LocalFile, Lookup, NewMesh, Problem, Record, Result,
    Success,
};
use crate::reconstruction::in_pool;

/// Time between two writes of progress: four a second are what a stream shows.
const FLUSH: Duration = Duration::from_millis(250);
/// Messages that may wait between the thread and the async side.
const CHANNEL: usize = 256;

/// The result of the thread.
struct Finished {
    mesh: NewMesh,
    report: serde_json::Value,
    model: Vec<u8>,
}

type Outcome = std::result::Result<Finished, Failure>;

/// An attempt under way.
pub(super) struct Attempt<'a> {
    worker: &'a Worker,
    control: Arc<Control>,
    pending: Pending,
    insist: Insist,
    puts: Puts,
    desk: Arc<Desk>,
    _clerk: AbortOnDropHandle<()>,
    claim: Claim,
}

impl<'a> Attempt<'a> {
    pub(super) fn new(worker: &'a Worker, claim: Claim) -> Self {
        let control = Arc::new(Control::default());
        let insist = Insist {
            store: worker.store.clone(),
            claim: claim.clone(),
            control: Arc::clone(&control),
            stopping: worker.signals.stopping.clone(),
            grace: worker.options.grace,
            told: Arc::new(AtomicBool::new(false)),
        };
        let (desk, orders) = Desk::new();
        let clerk = Clerk {
            store: worker.store.clone(),
            claim: claim.clone(),
            desk: Arc::clone(&desk),
            slots: worker.options.slots,
        };
        Self {
            worker,
            control,
            desk,
            _clerk: AbortOnDropHandle::new(tokio::spawn(clerk.serve(orders))),
            pending: Pending::new(worker.options.metrics_limit - claim.job.metrics),
            puts: Puts::new(insist.clone()),
            insist,
            claim,
        }
    }

    /// Runs the attempt to its end. Errors of the store are logged: the next attempt repeats what
    /// could not be written, once the lease has expired.
    pub(super) async fn run(mut self) -> End {
        tracing::info!(job = %self.claim.job_id(), attempt = self.claim.attempt, "a job was claimed");
        (self.worker.signals.committed)(self.claim.job_id());
        let _lease = AbortOnDropHandle::new(tokio::spawn(lease::hold(
            self.worker.store.clone(),
            self.claim.clone(),
            Arc::clone(&self.control),
            self.worker.signals.wake.clone(),
        )));
        let outcome = match self.start().await {
            Ok((messages, outcome)) => {
                if self.listen(messages).await == End::Hung {
                    self.settle(Err(Failure::Stopped)).await;
                    return End::Hung;
                }
                // A thread that panicked sends no result.
                outcome
                    .await
                    .unwrap_or_else(|_| Err(Failure::internal("the computation panicked")))
            }
            Err(failure) => Err(failure),
        };
        self.settle(outcome).await;
        End::Stopped
    }

    /// Starts the thread. Returns its messages, and its result after the last of them.
    async fn start(
        &self,
    ) -> std::result::Result<(mpsc::Receiver<Message>, oneshot::Receiver<Outcome>), Failure> {
        let job = &self.claim.job;
        let store = &self.worker.store;
        let records = store.of(&job.tenant);
        let (cloud, file) = self.cloud().await?;
        let checkpoint = self.insist.content(|| records.checkpoint(&job.id)).await;
        let checkpoint = checkpoint.map_err(|error| self.failure(&error))?;
        let assignment = Assignment {
            file: file.unnamed(),
            cloud,
            settings: job.settings.clone(),
            source: job.source.clone(),
        };
        let (sender, messages) = mpsc::channel(CHANNEL);
        let (reply, outcome) = oneshot::channel();
        let control = Arc::clone(&self.control);
        let interval = self.worker.options.checkpoint_interval;
        let work = Arc::clone(&self.worker.work);
        let desk = Arc::clone(&self.desk);
        std::thread::Builder::new()
            .name("reconstruct".to_owned())
            .spawn(move || {
                let outcome = in_pool(move || {
                    let data = checkpoint.map(|checkpoint| checkpoint.data);
                    let sink = Sink::new(sender, control, data, interval, desk);
                    let product = work(&assignment, &sink);
                    // One that was fetched is removed before its surface is encoded.
                    drop(assignment);
                    let product = product?;
                    Ok(Finished {
                        mesh: encode(&product.mesh).map_err(Failure::internal)?,
                        report: product.report,
                        model: product.model,
                    })
                });
                // Nobody receives it when the attempt was given up.
                drop(reply.send(outcome));
            })
            .map_err(Failure::internal)?;
        Ok((messages, outcome))
    }

    /// The cloud, and a file with its bytes.
    async fn cloud(&self) -> std::result::Result<(Cloud, LocalFile), Failure> {
        let (store, job) = (&self.worker.store, &self.claim.job);
        let records = store.of(&job.tenant);
        let mut sought: Option<Cloud> = None;
        loop {
            let cloud = self.insist.rows(|| records.cloud(&job.cloud_id)).await;
            let cloud = cloud.map_err(Failure::internal)?;
            let cloud = cloud.ok_or_else(|| Failure::internal("the cloud is not there"))?;
            // The same bytes may have been uploaded anew meanwhile, as another object.
            if sought.is_some_and(|sought| sought.object == cloud.object) {
                return Err(cloud_missing());
            }
            let file = self.insist.content(|| store.cloud_file(&cloud)).await;
            if let Some(file) = file.map_err(|error| self.failure(&error))? {
                return Ok((cloud, file));
            }
            sought = Some(cloud);
        }
    }

    /// What an error of the store means before the computation starts.
    fn failure(&self, error: &Error) -> Failure {
        match self.control.reason() {
            Some(_) if matches!(error, Error::ContentUnavailable(_)) => Failure::Stopped,
            _ => Failure::internal(error),
        }
    }

    /// Writes what the thread sends, until it ends or ignores a request to stop for too long.
    async fn listen(&mut self, mut messages: mpsc::Receiver<Message>) -> End {
        let control = Arc::clone(&self.control);
        let options = &self.worker.options;
        let insist = self.insist.clone();
        let overdue = insist.overdue();
        let limit = control.has_worked(options.time_limit.saturating_sub(self.claim.worked));
        tokio::pin!(overdue, limit);
        let mut flush = tokio::time::interval(FLUSH);
        flush.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                message = messages.recv(), if self.puts.has_room() => {
                    let Some(message) = message else { break };
                    self.take(message).await;
                }
                put = self.puts.next() => self.written(put),
                _ = flush.tick() => self.flush().await,
                () = &mut limit, if control.reason().is_none() => control.stop(Stop::TimeLimit),
                () = &mut overdue => {
                    let job = self.claim.job_id();
                    match control.reason() {
                        // It is planned, and loses no more than the time since the last checkpoint.
                        Some(Stop::Release) => {
                            tracing::info!(%job, "the computation is left; its job is given back");
                        }
                        Some(reason) if reason.is_for_good() => {
                            tracing::info!(%job, "the computation is left; nobody wants it any more");
                        }
                        _ => {
                            tracing::error!(%job, "the computation does not stop; the process ends itself");
                        }
                    }
                    return End::Hung;
                }
            }
        }
        self.finish_puts().await;
        End::Stopped
    }

    /// Waits for the content under way, as long as the attempt may take.
    async fn finish_puts(&mut self) {
        let insist = self.insist.clone();
        let overdue = insist.overdue();
        tokio::pin!(overdue);
        while !self.puts.is_empty() {
            tokio::select! {
                put = self.puts.next() => self.written(put),
                () = &mut overdue => return,
            }
        }
    }

    async fn take(&mut self, message: Message) {
        match message {
            Message::Phase(phase) => {
                self.pending.phase(phase);
                self.flush().await;
            }
            Message::Progress(share) => self.pending.progress(share),
            Message::Metrics(metrics) => self.pending.metrics(metrics),
            Message::Gradients(histogram) => self.pending.gradients(histogram),
            Message::Warning(warning) => self.pending.warning(&warning),
            Message::Snapshot { evaluation, mesh } => {
                self.puts.push(Content::Snapshot(evaluation, mesh));
            }
            Message::Checkpoint { evaluation, data } => {
                // The rows up to the checkpoint first: an attempt that continues from it keeps them.
                self.flush().await;
                self.puts.push(Content::Checkpoint(evaluation, data.into()));
            }
        }
    }

    async fn flush(&mut self) {
        let Some(record) = self.pending.take() else {
            return;
        };
        let (store, claim) = (&self.worker.store, &self.claim);
        let result = self
            .insist
            .rows(|| store.record(claim, record.clone()))
            .await;
        self.written(result);
    }

    /// Announces written rows, or stops the attempt if it can write no more.
    fn written(&self, result: Result<()>) {
        match result {
            Ok(()) => (self.worker.signals.committed)(self.claim.job_id()),
            Err(error) => {
                if !matches!(error, Error::Stale) {
                    let job = self.claim.job_id();
                    tracing::error!(%job, error.message = %error, "rows were not written");
                }
                self.control.stop(Stop::Lost);
            }
        }
    }

    /// Ends the attempt in the database.
    async fn settle(&mut self, outcome: Outcome) {
        let stop = self.control.reason();
        if stop == Some(Stop::Lost) {
            return self.lost().await;
        }
        let last = self.pending.take().unwrap_or_default();
        let result = match (outcome, stop) {
            (Ok(finished), _) => match self.succeed(finished, last).await {
                Err(error @ Error::ContentUnavailable(_)) => {
                    let (failure, stop) = (self.failure(&error), self.control.reason());
                    self.end(failure, stop).await
                }
                result => result,
            },
            (Err(failure), stop) => {
                if last != Record::default() {
                    let (store, claim) = (&self.worker.store, &self.claim);
                    let result = self.insist.rows(|| store.record(claim, last.clone())).await;
                    self.written(result);
                }
                self.end(failure, stop).await
            }
        };
        let (job, attempt) = (self.claim.job_id(), self.claim.attempt);
        match &result {
            Ok(()) => tracing::info!(%job, attempt, ?stop, "an attempt ended"),
            Err(error) => {
                tracing::error!(%job, attempt, error.message = %error, "an attempt did not end well");
            }
        }
        (self.worker.signals.committed)(job);
    }

    /// Logs why nothing more is written.
    async fn lost(&self) {
        let (job, attempt) = (self.claim.job_id(), self.claim.attempt);
        let records = self.worker.store.of(&self.claim.job.tenant);
        if let Ok(Lookup::Gone(_)) = records.job(job).await {
            tracing::info!(%job, attempt, "the job was erased");
        } else {
            tracing::warn!(%job, attempt, "the job was lost");
        }
    }

    async fn succeed(&self, finished: Finished, last: Record) -> Result<()> {
        let success = Success {
            mesh: finished.mesh,
            report: finished.report,
            model: finished.model,
            last,
        };
        let (store, claim) = (&self.worker.store, &self.claim);
        let succeed = || store.succeed(claim, success.clone());
        self.insist.content(succeed).await
    }

    async fn end(&self, failure: Failure, stop: Option<Stop>) -> Result<()> {
        let (store, claim) = (&self.worker.store, &self.claim);
        let failed = |reason: FailureReason| async move {
            let id = claim.job_id();
            let job = self
                .insist
                .rows(|| store.attempt_failed(id, claim.attempt, reason.clone()))
                .await?;
            tracing::warn!(job = %id, ?reason, failures = job.failures, "an attempt failed");
            Ok(())
        };
        match (failure, stop) {
            (_, Some(Stop::Cancel)) => self.insist.rows(|| store.cancelled(claim)).await,
            (_, Some(Stop::TimeLimit)) => {
                let seconds = self.worker.options.time_limit.as_secs();
                let detail = format!("the job took longer than {seconds} seconds");
                let problem = Problem::new("time_limit", detail);
                self.insist
                    .rows(|| store.fail(claim, problem.clone()))
                    .await
            }
            (Failure::Stopped, Some(Stop::Release)) => {
                self.insist.rows(|| store.release(claim)).await
            }
            (Failure::Final(problem), _) => {
                self.insist
                    .rows(|| store.fail(claim, problem.clone()))
                    .await
            }
            (Failure::Transient(reason), _) => failed(reason).await,
            (Failure::Stopped, _) => {
                failed(FailureReason::Internal {
                    detail: "the computation stopped unasked".to_owned(),
                })
                .await
            }
        }
    }
}
