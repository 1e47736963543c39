//! The one place where a job leaves a state: status, columns and event change together.

use serde_json::Value;

use super::row::to_json;
use crate::jobs::store::Transaction;
use crate::jobs::store::sql::query;
use crate::jobs::{Error, Job, JobId, NewEvent, Problem, Requeue, Result, Status};

/// Which job is meant, in which attempt and state: the fence of a change.
#[derive(Clone, Copy)]
pub(in crate::jobs::store) struct Fence<'a> {
    pub(in crate::jobs::store) id: &'a JobId,
    pub(in crate::jobs::store) attempt: i64,
    pub(in crate::jobs::store) status: Status,
}

impl<'a> Fence<'a> {
    /// The job as it was read in this transaction.
    pub(in crate::jobs::store) fn of(job: &'a Job) -> Self {
        Self {
            id: &job.id,
            attempt: job.attempt,
            status: job.status,
        }
    }

    /// The running attempt.
    pub(in crate::jobs::store) fn running(id: &'a JobId, attempt: i64) -> Self {
        Self {
            id,
            attempt,
            status: Status::Running,
        }
    }
}

/// What a job becomes, other than running (that is a claim).
pub(in crate::jobs::store) enum Outcome {
    /// Back into the queue, with why.
    Requeued(Requeue),
    /// Its report, and its last event.
    Succeeded { report: Value, event: NewEvent },
    /// Why.
    Failed(Problem),
    /// A client wanted it.
    Cancelled,
}

impl Outcome {
    fn status(&self) -> Status {
        match self {
            Self::Requeued(_) => Status::Queued,
            Self::Succeeded { .. } => Status::Succeeded,
            Self::Failed(_) => Status::Failed,
            Self::Cancelled => Status::Cancelled,
        }
    }
}

impl Transaction<'_> {
    /// Moves a job on and writes the event of it.
    ///
    /// # Errors
    /// `Stale` if the job is not in the state and attempt of the fence, or may not go that way.
    pub(in crate::jobs::store) async fn leave(
        &mut self,
        fence: Fence<'_>,
        outcome: Outcome,
    ) -> Result<()> {
        let status = outcome.status();
        if !fence.status.may_become(status) {
            return Err(Error::Stale);
        }
        let (error, report) = match &outcome {
            Outcome::Failed(problem) => (Some(to_json(problem)), None),
            Outcome::Succeeded { report, .. } => (None, Some(to_json(report))),
            Outcome::Requeued(_) | Outcome::Cancelled => (None, None),
        };
        self.count_work(fence).await?;
        let changed = query(
            "UPDATE jobs SET status = ?4, finished_at = ?5, error = ?6, report = ?7,
                 worker = NULL, lease_until = NULL, counted_at = NULL, eta_seconds = NULL,
                 expires_at = ?5 + keep_ms,
                 progress = CASE ?4 WHEN 'succeeded' THEN 1.0 ELSE progress END
             WHERE id = ?1 AND attempt = ?2 AND status = ?3",
        )
        .bind(fence.id.as_str())
        .bind(fence.attempt)
        .bind(fence.status.name())
        .bind(status.name())
        .bind(status.is_final().then_some(self.now))
        .bind(error)
        .bind(report)
        .execute(&mut self.db)
        .await?;
        if changed.rows_affected() != 1 {
            return Err(Error::Stale);
        }
        if fence.status == Status::Running {
            self.bury_shares(fence.id).await?;
        }
        if status.is_final() {
            self.bury_checkpoint(fence.id).await?;
        }
        if matches!(outcome, Outcome::Requeued(Requeue::Released)) {
            self.give_turn_back(fence.id).await?;
        }
        let event = match outcome {
            Outcome::Requeued(reason) => NewEvent::Queued {
                position: self.queue_position(fence.id).await?,
                reason: Some(reason),
            },
            Outcome::Succeeded { event, .. } => event,
            Outcome::Failed(error) => NewEvent::Failed { error },
            Outcome::Cancelled => NewEvent::Cancelled {},
        };
        self.append_event(fence.id, &event).await
    }
}
