//! Who runs a job: claims, renewals, and how an attempt ends without a result.
//!
//! Every write of a worker names its attempt and must find it running; otherwise it gets `Stale`
//! and writes nothing. A lease that has run out still holds until somebody reaps it: it is the
//! attempt that protects the job, the lease only tells when to stop waiting.

use std::collections::BTreeSet;
use std::time::Duration;

use serde::Deserialize;

use super::jobs::job_of;
use super::outcome::{Fence, Outcome};
use super::row::{Columns, integer, to_json};
use crate::jobs::store::Store;
use crate::jobs::store::Transaction;
use crate::jobs::store::sql::{query, scalar};
use crate::jobs::{
    Claim, Error, FailureReason, Job, JobId, Lease, NewEvent, Problem, Requeue, Result,
};

impl Store {
    /// Takes the job whose turn it is, for `lease_ms` milliseconds, and writes `job.started`
    /// or `job.attempt_started`. Rows that an earlier attempt wrote after its last checkpoint are
    /// erased: this attempt writes them again.
    pub async fn claim(&self, worker: &str, lease_ms: i64) -> Result<Option<Claim>> {
        // Looking at an empty queue does not take the write lock from others.
        if self.oldest_queued().await?.is_none() {
            return Ok(None);
        }
        let worker = worker.to_owned();
        self.write(move |mut tx| {
            Box::pin(async move {
                let Some((id, turn)) = tx.next_in_queue().await? else {
                    return Ok(None);
                };
                tx.take_turn(&id, turn).await?;
                let row = query(
                    "UPDATE jobs SET status = 'running', attempt = attempt + 1, worker = ?1,
                         lease_until = ?2 + ?3, started_at = COALESCE(started_at, ?2),
                         phase = NULL, progress = 0, eta_seconds = NULL, loss = NULL,
                         counted_at = ?2, events = events + 1
                     WHERE id = ?4 RETURNING *",
                )
                .bind(&worker)
                .bind(tx.now)
                .bind(lease_ms)
                .bind(id.as_str())
                .fetch_one(&mut tx.db)
                .await?;
                let mut job = job_of(&row)?;
                let event = if job.attempt == 1 {
                    NewEvent::Started { worker }
                } else {
                    tx.forget_after_checkpoint(&job.id).await?;
                    let reason = tx.requeue_reason(&job.id).await?;
                    job = tx.load_job(&job.id).await?;
                    NewEvent::AttemptStarted { worker, reason }
                };
                let number = Columns::new("jobs", &row).get("events")?;
                let of = (&job.id, job.tenant.as_str());
                tx.insert_event(of, (number, job.attempt), &event).await?;
                let worked_ms = Columns::new("jobs", &row).count("worked_ms")?;
                Ok(Some(Claim {
                    attempt: job.attempt,
                    worked: Duration::from_millis(worked_ms),
                    job,
                }))
            })
        })
        .await
    }

    /// Holds the job for another `lease_ms` milliseconds from now, notes how long all its attempts
    /// have worked by now, and asks whether it shall end.
    pub async fn renew(&self, claim: &Claim, lease_ms: i64, worked: Duration) -> Result<Lease> {
        let (id, attempt) = (claim.job.id.clone(), claim.attempt);
        let worked_ms = integer(worked.as_millis() as u64);
        self.write(move |mut tx| {
            Box::pin(async move {
                tx.count_work(Fence::running(&id, attempt)).await?;
                let cancel_requested: Option<i64> = scalar(
                    "UPDATE jobs SET lease_until = ?3, worked_ms = MAX(worked_ms, ?4),
                         counted_at = ?5
                     WHERE id = ?1 AND attempt = ?2 AND status = 'running'
                     RETURNING cancel_requested",
                )
                .bind(id.as_str())
                .bind(attempt)
                .bind(tx.now + lease_ms)
                .bind(worked_ms)
                .bind(tx.now)
                .fetch_optional(&mut tx.db)
                .await?;
                Ok(cancel_requested.map_or(Lease::Lost, |asked| Lease::Held {
                    cancel_requested: asked != 0,
                }))
            })
        })
        .await
    }

    /// Ends the job with an error that another attempt would meet again.
    ///
    /// # Errors
    /// `Stale` if the claim is over.
    pub async fn fail(&self, claim: &Claim, problem: Problem) -> Result<()> {
        self.end(claim, Outcome::Failed(problem)).await
    }

    /// Ends the job as a client asked for.
    ///
    /// # Errors
    /// `Stale` if the claim is over.
    pub async fn cancelled(&self, claim: &Claim) -> Result<()> {
        self.end(claim, Outcome::Cancelled).await
    }

    /// Gives the job back into the queue without a failed attempt; one that shall end is cancelled
    /// instead.
    ///
    /// # Errors
    /// `Stale` if the claim is over.
    pub async fn release(&self, claim: &Claim) -> Result<()> {
        let (id, attempt) = (claim.job.id.clone(), claim.attempt);
        self.write(move |mut tx| {
            Box::pin(async move {
                let outcome = if tx.held(&id, attempt).await?.cancel_requested {
                    Outcome::Cancelled
                } else {
                    Outcome::Requeued(Requeue::Released)
                };
                tx.leave(Fence::running(&id, attempt), outcome).await
            })
        })
        .await
    }

    /// Counts a failed attempt: the job waits again, fails if it was the last one, or is cancelled
    /// if that was asked. The answer is the job afterwards.
    ///
    /// # Errors
    /// `Stale` if that attempt does not run.
    pub async fn attempt_failed(
        &self,
        id: &JobId,
        attempt: i64,
        reason: FailureReason,
    ) -> Result<Job> {
        let id = id.clone();
        self.write(move |mut tx| {
            Box::pin(async move {
                tx.attempt_failed(&id, attempt, &reason).await?;
                tx.load_job(&id).await
            })
        })
        .await
    }

    /// Counts a failed attempt for every running job whose lease has run out, and names them. Jobs
    /// of the workers in `spared` are left alone: whoever sees them at work needs no lease.
    pub async fn reap_expired(&self, spared: BTreeSet<String>) -> Result<Vec<JobId>> {
        // As in `claim`: the usual case takes no lock.
        let expired: bool = scalar(
            "SELECT EXISTS (SELECT 1 FROM jobs WHERE status = 'running' AND lease_until < ?1)",
        )
        .bind(self.now())
        .fetch_one(self.readers())
        .await?;
        if !expired {
            return Ok(Vec::new());
        }
        self.write(move |mut tx| {
            Box::pin(async move {
                let rows = query(
                    "SELECT id, attempt, worker FROM jobs
                     WHERE status = 'running' AND lease_until < ?1 ORDER BY created_at, id",
                )
                .bind(tx.now)
                .fetch_all(&mut tx.db)
                .await?;
                let mut reaped = Vec::with_capacity(rows.len());
                for row in &rows {
                    let columns = Columns::new("jobs", row);
                    if spared.contains(columns.get::<&str>("worker")?) {
                        continue;
                    }
                    let id: JobId = columns.parsed("id")?;
                    tx.attempt_failed(&id, columns.get("attempt")?, &FailureReason::LeaseExpired)
                        .await?;
                    reaped.push(id);
                }
                Ok(reaped)
            })
        })
        .await
    }

    /// Cuts leases that end later than `lease_ms` milliseconds from now, which no renewal gives: the
    /// clock was set back since, and a job whose worker is gone would wait for it.
    pub async fn cut_leases(&self, lease_ms: i64) -> Result<u64> {
        let ahead: bool = scalar(
            "SELECT EXISTS (SELECT 1 FROM jobs WHERE status = 'running' AND lease_until > ?1)",
        )
        .bind(self.now() + lease_ms)
        .fetch_one(self.readers())
        .await?;
        if !ahead {
            return Ok(0);
        }
        self.write(move |mut tx| {
            Box::pin(async move {
                let cut = query(
                    "UPDATE jobs SET lease_until = ?1
                     WHERE status = 'running' AND lease_until > ?1",
                )
                .bind(tx.now + lease_ms)
                .execute(&mut tx.db)
                .await?;
                Ok(cut.rows_affected())
            })
        })
        .await
    }

    /// The running job that a worker of this name holds: what is to be settled when it dies.
    pub async fn held_by(&self, worker: &str) -> Result<Option<Job>> {
        let row = query("SELECT * FROM jobs WHERE status = 'running' AND worker = ?1")
            .bind(worker)
            .fetch_optional(self.readers())
            .await?;
        row.as_ref().map(job_of).transpose()
    }

    /// Whether the claim is still good: asked before large content is written for it.
    ///
    /// # Errors
    /// `Stale` if it is not.
    pub(in crate::jobs::store) async fn check_held(&self, claim: &Claim) -> Result<()> {
        let held: bool = scalar(
            "SELECT EXISTS (SELECT 1 FROM jobs
                            WHERE id = ?1 AND attempt = ?2 AND status = 'running')",
        )
        .bind(claim.job.id.as_str())
        .bind(claim.attempt)
        .fetch_one(self.readers())
        .await?;
        if held { Ok(()) } else { Err(Error::Stale) }
    }

    async fn end(&self, claim: &Claim, outcome: Outcome) -> Result<()> {
        let (id, attempt) = (claim.job.id.clone(), claim.attempt);
        self.write(move |mut tx| {
            Box::pin(async move { tx.leave(Fence::running(&id, attempt), outcome).await })
        })
        .await
    }
}

impl Transaction<'_> {
    /// Why a job that waits again does so. Not its `failure_reason`: a release is no failure.
    async fn requeue_reason(&mut self, id: &JobId) -> Result<Option<Requeue>> {
        /// The part of the event that is looked at.
        #[derive(Deserialize)]
        struct Queued {
            reason: Option<Requeue>,
        }
        let row = query(
            "SELECT data FROM events WHERE job_id = ?1 AND event = 'job.queued'
             ORDER BY id DESC LIMIT 1",
        )
        .bind(id.as_str())
        .fetch_one(&mut self.db)
        .await?;
        let queued: Queued = Columns::new("events", &row).json("data")?;
        Ok(queued.reason)
    }

    /// The job, if that attempt runs.
    ///
    /// # Errors
    /// `Stale` if it does not.
    pub(in crate::jobs::store) async fn held(&mut self, id: &JobId, attempt: i64) -> Result<Job> {
        let row = query("SELECT * FROM jobs WHERE id = ?1 AND attempt = ?2 AND status = 'running'")
            .bind(id.as_str())
            .bind(attempt)
            .fetch_optional(&mut self.db)
            .await?
            .ok_or(Error::Stale)?;
        job_of(&row)
    }

    async fn attempt_failed(
        &mut self,
        id: &JobId,
        attempt: i64,
        reason: &FailureReason,
    ) -> Result<()> {
        let job = self.held(id, attempt).await?;
        let failures = job.failures + 1;
        query("UPDATE jobs SET failures = ?2, failure_reason = ?3 WHERE id = ?1")
            .bind(id.as_str())
            .bind(failures)
            .bind(to_json(reason))
            .execute(&mut self.db)
            .await?;
        let outcome = if job.cancel_requested {
            Outcome::Cancelled
        } else if failures >= self.options.max_failures || reason.is_sure() {
            Outcome::Failed(reason.problem(failures))
        } else {
            Outcome::Requeued(Requeue::Failed(reason.clone()))
        };
        self.leave(Fence::running(id, attempt), outcome).await
    }
}
