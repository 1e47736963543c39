//! A job: what it is, the states of its life, and the legal ways between them.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::attempt::{FailureReason, Problem};
use super::{BatchId, CloudId, JobId};
use crate::identity::Tenant;
use crate::reconstruction::medical::Choice;
use crate::reconstruction::report::Verdict;
use crate::reconstruction::{Phase, Preset, Settings};

/// Where a job stands.
///
/// ```text
/// queued --claim--> running --succeed--> succeeded
///   |  <--release,     |  |--fail,
///   |   failed attempt-|  |  third failed attempt--> failed
///   |                  `--cancel-------------------> cancelled
///   `--cancel--------------------------------------> cancelled
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// Waits for a worker.
    Queued,
    /// A worker holds it by a lease.
    Running,
    /// Has a mesh and a report.
    Succeeded,
    /// Has an error.
    Failed,
    /// Was cancelled.
    Cancelled,
}

impl Status {
    /// All of them, in the order of a job's life.
    pub const ALL: [Self; 5] = [
        Self::Queued,
        Self::Running,
        Self::Succeeded,
        Self::Failed,
        Self::Cancelled,
    ];

    /// Its name in the database, in JSON and in metrics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Succeeded => "succeeded",
            Self::Failed => "failed",
            Self::Cancelled => "cancelled",
        }
    }

    /// The status of the given name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|status| status.name() == name)
    }

    /// Whether nothing can follow.
    pub fn is_final(self) -> bool {
        matches!(self, Self::Succeeded | Self::Failed | Self::Cancelled)
    }

    /// Whether `next` may follow: the arrows of the picture above.
    pub fn may_become(self, next: Self) -> bool {
        match self {
            Self::Queued => matches!(next, Self::Running | Self::Cancelled),
            Self::Running => next != Self::Running,
            Self::Succeeded | Self::Failed | Self::Cancelled => false,
        }
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A job as its row has it. Times are milliseconds since the epoch.
#[derive(Debug, Clone, PartialEq)]
pub struct Job {
    /// Its name.
    pub id: JobId,
    /// Whose it is.
    pub tenant: Tenant,
    /// The cloud it reconstructs; a job that has ended may outlive its cloud.
    pub cloud_id: CloudId,
    /// Whether it has outlived its cloud.
    pub cloud_erased: bool,
    /// Where it stands.
    pub status: Status,
    /// Stage of the present or last attempt; none before the first one reports it.
    pub phase: Option<Phase>,
    /// Preset that the settings started from.
    pub preset: Preset,
    /// Complete settings.
    pub settings: Settings,
    /// The client's own marks.
    pub labels: BTreeMap<String, String>,
    /// Which part of the cloud's file it is about, where that has several.
    pub source: Option<Choice>,
    /// The job of which this is a retry.
    pub derived_from: Option<JobId>,
    /// The batch that it was made in.
    pub batch_id: Option<BatchId>,
    /// Those of a tenant with a higher one go first.
    pub priority: i64,
    /// When it was submitted.
    pub created_at: i64,
    /// When its first attempt began.
    pub started_at: Option<i64>,
    /// When it reached its final state.
    pub finished_at: Option<i64>,
    /// How long it is kept after its end.
    pub keep: Keep,
    /// When it is erased; none before its end, and where it is kept for ever.
    pub expires_at: Option<i64>,
    /// Whether it must not be erased.
    pub hold: bool,
    /// Number of the present or last attempt, 0 before the first: the fence of every write.
    pub attempt: i64,
    /// Failed attempts. A release does not count.
    pub failures: i64,
    /// Why the last failed attempt failed.
    pub failure_reason: Option<FailureReason>,
    /// Who holds it while it runs.
    pub worker: Option<String>,
    /// Until when it is held while it runs.
    pub lease_until: Option<i64>,
    /// Whether a client wants it to end.
    pub cancel_requested: bool,
    /// Share of the work that is done, 0 to 1.
    pub progress: f64,
    /// Estimated seconds to the end of a running job.
    pub eta_seconds: Option<f64>,
    /// Evaluations of loss and gradient so far.
    pub evaluations: u64,
    /// Last training loss.
    pub loss: Option<f64>,
    /// Why it failed, if it did.
    pub error: Option<Problem>,
    /// The quality report, if it succeeded.
    pub report: Option<Value>,
    /// Id of its newest event; ids start at 1 and have no gap.
    pub events: i64,
    /// Number of its metric rows.
    pub metrics: i64,
}

/// What a client asks for.
#[derive(Debug, Clone, PartialEq)]
pub struct NewJob {
    /// The cloud to reconstruct.
    pub cloud_id: CloudId,
    /// Preset that the settings started from.
    pub preset: Preset,
    /// Complete settings.
    pub settings: Settings,
    /// The client's own marks.
    pub labels: BTreeMap<String, String>,
    /// Which part of the cloud's file it is about, where that has several.
    pub source: Option<Choice>,
    /// The job of which this is a retry.
    pub derived_from: Option<JobId>,
    /// Those of the tenant with a higher one go first.
    pub priority: i64,
    /// Estimated work in seconds, by which tenants take turns.
    pub cost_seconds: f64,
    /// How long it is kept after its end.
    pub keep: Keep,
}

/// Where a waiting job stands, in the queue that all tenants share.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// 1 for the next one.
    pub position: u64,
    /// Estimated work before it, in milliseconds: of the jobs that are next, and what is left of those
    /// that run.
    pub before_ms: u64,
    /// Its own.
    pub cost_ms: u64,
}

impl Place {
    /// Estimated seconds to the end of the job with so many workers, in tenths.
    pub fn eta_seconds(&self, workers: u64) -> f64 {
        ((self.before_ms / workers.max(1) + self.cost_ms) as f64 / 100.0).round() / 10.0
    }
}

/// How long something is kept.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Keep {
    /// In milliseconds; none: for ever.
    pub ms: Option<i64>,
    /// Whether a job goes as soon as its mesh was fetched whole.
    pub once: bool,
}

/// A change of how long something is kept, or of when a job has its turn; `None` leaves it as it is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct KeepChange {
    /// For how long.
    pub keep: Option<Keep>,
    /// Whether it must not be erased.
    pub hold: Option<bool>,
    /// Of a job, while it waits.
    pub priority: Option<i64>,
}

/// Which jobs a list shows; `None` asks for no restriction.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct JobFilter {
    /// Only jobs in this state.
    pub status: Option<Status>,
    /// Only jobs of this cloud.
    pub cloud_id: Option<CloudId>,
    /// Only jobs of this batch.
    pub batch_id: Option<BatchId>,
    /// Only jobs that carry this label with this value, as they are written with a colon between
    /// them: a label may have colons, too.
    pub label: Option<(String, String)>,
    /// Only jobs whose report gives this verdict on their mesh.
    pub verdict: Option<Verdict>,
    /// Only jobs submitted later than this, in milliseconds since the epoch.
    pub created_after: Option<i64>,
}

/// What is known about a job id.
#[derive(Debug, Clone, PartialEq)]
pub enum Lookup {
    /// It is here.
    Found(Box<Job>),
    /// It was here and was erased.
    Gone(Tombstone),
    /// It never was here.
    Missing,
}

impl Lookup {
    /// The job, if it is here.
    pub fn found(self) -> Option<Job> {
        match self {
            Self::Found(job) => Some(*job),
            Self::Gone(_) | Self::Missing => None,
        }
    }
}

/// What stays of an erased job or cloud.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tombstone {
    /// When it was erased, in milliseconds since the epoch.
    pub deleted_at: i64,
    /// Why: the name of a [`Reason`].
    pub reason: String,
}

/// Why something was erased.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reason {
    /// A client wanted it.
    Deleted,
    /// Its time was over.
    Expired,
    /// What was known of it and what was there did not agree any more.
    Lost,
}

impl Reason {
    /// Its name in the database and in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Deleted => "deleted",
            Self::Expired => "expired",
            Self::Lost => "lost",
        }
    }
}

/// Number of jobs in each state.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Counts(BTreeMap<Status, u64>);

impl Counts {
    /// Number of jobs in the given state.
    pub fn get(&self, status: Status) -> u64 {
        self.0.get(&status).copied().unwrap_or(0)
    }
}

impl FromIterator<(Status, u64)> for Counts {
    fn from_iter<I: IntoIterator<Item = (Status, u64)>>(counts: I) -> Self {
        Self(counts.into_iter().collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_ways_of_the_picture_are_legal() {
        use Status::{Cancelled, Failed, Queued, Running, Succeeded};
        let legal = [
            (Queued, Running),
            (Queued, Cancelled),
            (Running, Queued),
            (Running, Succeeded),
            (Running, Failed),
            (Running, Cancelled),
        ];
        for from in Status::ALL {
            for to in Status::ALL {
                assert_eq!(
                    from.may_become(to),
                    legal.contains(&(from, to)),
                    "{from} {to}"
                );
            }
        }
    }

    #[test]
    fn names_are_those_of_json() {
        for status in Status::ALL {
            assert_eq!(serde_json::to_value(status).unwrap(), status.name());
            assert_eq!(Status::from_name(status.name()), Some(status));
        }
    }
}
