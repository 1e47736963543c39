//! Jobs that were asked for together, with one preset, one set of settings and one set of labels.

use std::collections::BTreeMap;

use super::{BatchId, CloudId, JobId, Status};
use crate::reconstruction::Preset;
use crate::reconstruction::medical::Choice;
use crate::reconstruction::report::Verdict;

/// A batch, which goes with the last of its jobs. Times are milliseconds since the epoch.
#[derive(Debug, Clone, PartialEq)]
pub struct Batch {
    /// Its name.
    pub id: BatchId,
    /// Number of jobs that it had at first.
    pub made: u64,
    /// Share of the work that is done, 0 to 1; it never goes back.
    pub progress: f64,
    /// When it was submitted.
    pub created_at: i64,
    /// The jobs that are here, in the order in which they were asked for.
    pub jobs: Vec<BatchJob>,
}

impl Batch {
    /// Whether all its jobs have ended.
    pub fn is_final(&self) -> bool {
        self.jobs.iter().all(|job| job.status.is_final())
    }

    /// Where it stands: `queued` before its first job begins, `ended` after its last one.
    pub fn status(&self) -> &'static str {
        let waits = |job: &BatchJob| job.status == Status::Queued;
        if self.is_final() {
            "ended"
        } else if self.jobs.len() as u64 == self.made && self.jobs.iter().all(waits) {
            "queued"
        } else {
            "running"
        }
    }
}

/// What a batch tells of a job.
#[derive(Debug, Clone, PartialEq)]
pub struct BatchJob {
    /// Its name.
    pub id: JobId,
    /// The cloud it reconstructs.
    pub cloud_id: CloudId,
    /// Which part of the cloud's file it is about, where that has several.
    pub source: Option<Choice>,
    /// Preset that the settings started from.
    pub preset: Preset,
    /// The client's own marks.
    pub labels: BTreeMap<String, String>,
    /// Where it stands.
    pub status: Status,
    /// Share of its work that is done, 0 to 1.
    pub progress: f64,
    /// What its report says of its mesh, if it succeeded.
    pub verdict: Option<Verdict>,
    /// Code of why it failed, if it did.
    pub error: Option<String>,
}

/// Which events a job of a batch has, by their places among the events of all jobs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Track {
    /// The job.
    pub job: JobId,
    /// Its first event.
    pub first: i64,
    /// Its newest one.
    pub last: i64,
    /// Whether none can follow.
    pub ended: bool,
}
