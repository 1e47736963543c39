//! Whose events are told: those of one job, of a batch, or of all jobs of a tenant.

use std::collections::HashSet;

use crate::jobs::{BatchId, Event, JobId, Records, Result};

/// Whose events are told.
pub(super) enum Of {
    /// Of all jobs of the tenant.
    All,
    /// Of one job.
    Job(JobId),
    /// Of the jobs of a batch.
    Batch(Members),
}

/// The jobs of a batch.
pub(super) struct Members {
    id: BatchId,
    all: HashSet<JobId>,
    /// Those that have something to tell yet: the stream ends when there are none.
    open: HashSet<JobId>,
}

/// What an event that was committed is to a stream.
pub(super) enum Heard {
    /// The next one.
    Next,
    /// One after a gap: rows must be read.
    Gap,
    /// Of no concern, or known.
    Nothing,
}

impl Of {
    /// Of a batch with these jobs, of which some are open.
    pub(super) fn batch(id: BatchId, all: HashSet<JobId>, open: HashSet<JobId>) -> Self {
        Self::Batch(Members { id, all, open })
    }

    /// The id of an event: among those of its job, or among all.
    pub(super) fn number(&self, event: &Event) -> i64 {
        match self {
            Self::Job(_) => event.id,
            Self::All | Self::Batch(_) => event.seq,
        }
    }

    /// Where these events are.
    pub(super) fn path(&self) -> String {
        match self {
            Self::All => "/v1/events".to_owned(),
            Self::Job(id) => format!("/v1/jobs/{id}/events"),
            Self::Batch(members) => format!("/v1/batches/{}/events", members.id),
        }
    }

    /// The events after one, oldest first.
    pub(super) async fn rows(
        &self,
        records: Records<'_>,
        after: i64,
        limit: u32,
    ) -> Result<Vec<Event>> {
        match self {
            Self::All => records.all_events_after(after, limit).await,
            Self::Job(id) => records.events_after(id, after, limit).await,
            Self::Batch(members) => records.batch_events_after(&members.id, after, limit).await,
        }
    }

    /// What an event of the tenant is to a stream that has told the one of the given id.
    pub(super) fn hear(&self, event: &Event, last: i64) -> Heard {
        let is_member = match self {
            Self::All => true,
            Self::Job(job) => *job == event.job_id,
            Self::Batch(members) => members.all.contains(&event.job_id),
        };
        match self {
            _ if !is_member || self.number(event) <= last => Heard::Nothing,
            // Ids of events of one job have no gap.
            Self::Job(_) if event.id > last + 1 => Heard::Gap,
            _ => Heard::Next,
        }
    }

    /// Takes note of an event that was told. Whether none can follow.
    pub(super) fn told(&mut self, event: &Event) -> bool {
        event.kind.is_last() && self.loses(&event.job_id)
    }

    /// Takes note that a job has nothing more to tell. Whether none has.
    pub(super) fn loses(&mut self, job: &JobId) -> bool {
        match self {
            Self::All => false,
            Self::Job(own) => own == job,
            Self::Batch(members) => members.open.remove(job) && members.open.is_empty(),
        }
    }

    /// Looks which jobs are here still: a stream that lagged behind may not have heard that some were
    /// erased. Whether none is left.
    pub(super) async fn is_gone(&mut self, records: Records<'_>) -> Result<bool> {
        Ok(match self {
            Self::All => false,
            Self::Job(job) => records.job(job).await?.found().is_none(),
            Self::Batch(members) => {
                let tracks = records.batch_tracks(&members.id).await?;
                members
                    .open
                    .retain(|job| tracks.iter().any(|track| track.job == *job));
                members.open.is_empty()
            }
        })
    }
}
