//! What happens to a job: the kinds of events, and what each carries.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::assessment::Assessment;
use super::attempt::{FailureReason, Problem};
use super::id::JobId;
use crate::identity::Tenant;
use crate::reconstruction::report::Verdict;
use crate::reconstruction::training::Metrics;
use crate::reconstruction::{Phase, Warning};

/// Kind of an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum EventKind {
    /// The job waits for a worker.
    Queued,
    /// Its first attempt began.
    Started,
    /// A further attempt began.
    AttemptStarted,
    /// A stage began.
    Phase,
    /// How far the work is.
    Progress,
    /// Something the user should know.
    Warning,
    /// The newest row of the training series.
    Metrics,
    /// A surface during training.
    Snapshot,
    /// The job has a result.
    Succeeded,
    /// The job failed.
    Failed,
    /// The job was cancelled.
    Cancelled,
}

impl EventKind {
    /// All of them.
    pub const ALL: [Self; 11] = [
        Self::Queued,
        Self::Started,
        Self::AttemptStarted,
        Self::Phase,
        Self::Progress,
        Self::Warning,
        Self::Metrics,
        Self::Snapshot,
        Self::Succeeded,
        Self::Failed,
        Self::Cancelled,
    ];

    /// Its name in the database and on streams.
    pub fn name(self) -> &'static str {
        match self {
            Self::Queued => "job.queued",
            Self::Started => "job.started",
            Self::AttemptStarted => "job.attempt_started",
            Self::Phase => "job.phase",
            Self::Progress => "job.progress",
            Self::Warning => "job.warning",
            Self::Metrics => "training.metrics",
            Self::Snapshot => "job.snapshot",
            Self::Succeeded => "job.succeeded",
            Self::Failed => "job.failed",
            Self::Cancelled => "job.cancelled",
        }
    }

    /// The kind of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// Whether no event of the job can follow.
    pub fn is_last(self) -> bool {
        matches!(self, Self::Succeeded | Self::Failed | Self::Cancelled)
    }

    /// Whether it comes again and again while a job runs: it is left out of a job with very many
    /// events.
    pub fn repeats(self) -> bool {
        matches!(self, Self::Progress | Self::Metrics)
    }
}

impl Serialize for EventKind {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

/// Something that happened to a job.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// Place among the events of all jobs; grows, with gaps.
    pub seq: i64,
    /// Whose job it is.
    pub tenant: Tenant,
    /// The job.
    pub job_id: JobId,
    /// Place among the events of the job: 1, 2, 3, … without a gap.
    pub id: i64,
    /// Kind.
    pub kind: EventKind,
    /// When it was written, in milliseconds since the epoch.
    pub time: i64,
    /// Attempt during or after which it happened; 0 before the first.
    pub attempt: i64,
    /// What a [`NewEvent`] of the kind carried when it was written, perhaps by an earlier version.
    pub data: Value,
}

/// An event that is to be written; the store gives it its id, time and attempt.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum NewEvent {
    /// The job waits for a worker.
    Queued {
        /// Its place in the queue.
        position: Option<u64>,
        /// Why it waits again.
        #[serde(skip_serializing_if = "Option::is_none")]
        reason: Option<Requeue>,
    },
    /// Its first attempt began.
    Started {
        /// Who works.
        worker: String,
    },
    /// A further attempt began.
    AttemptStarted {
        /// Who works.
        worker: String,
        /// Why the job had to wait again.
        reason: Option<Requeue>,
    },
    /// A stage began.
    Phase {
        /// The stage.
        phase: Phase,
    },
    /// How far the work is.
    Progress {
        /// Share of the whole work that is done, 0 to 1.
        fraction: f64,
        /// Estimated seconds to the end.
        eta_seconds: Option<f64>,
    },
    /// Something the user should know.
    Warning(Warning),
    /// The newest row of the training series.
    Metrics(Metrics),
    /// A surface during training.
    Snapshot {
        /// Evaluation at which it was taken.
        evaluation: u64,
        /// Number of vertices.
        vertices: u64,
        /// Number of triangles.
        triangles: u64,
        /// Size of the canonical encoding.
        bytes: u64,
        /// How far it can be trusted.
        verdict: Option<Verdict>,
    },
    /// The job has a result.
    Succeeded {
        /// What its report says in short.
        #[serde(flatten)]
        assessment: Assessment,
        /// Number of vertices.
        vertices: u64,
        /// Number of triangles.
        triangles: u64,
        /// Size of the canonical encoding.
        bytes: u64,
    },
    /// The job failed.
    Failed {
        /// Why.
        error: Problem,
    },
    /// The job was cancelled.
    Cancelled {},
}

impl NewEvent {
    /// Its kind.
    pub fn kind(&self) -> EventKind {
        match self {
            Self::Queued { .. } => EventKind::Queued,
            Self::Started { .. } => EventKind::Started,
            Self::AttemptStarted { .. } => EventKind::AttemptStarted,
            Self::Phase { .. } => EventKind::Phase,
            Self::Progress { .. } => EventKind::Progress,
            Self::Warning(_) => EventKind::Warning,
            Self::Metrics(_) => EventKind::Metrics,
            Self::Snapshot { .. } => EventKind::Snapshot,
            Self::Succeeded { .. } => EventKind::Succeeded,
            Self::Failed { .. } => EventKind::Failed,
            Self::Cancelled {} => EventKind::Cancelled,
        }
    }
}

/// Why a job waits again. A release is no failure.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "code", rename_all = "snake_case")]
pub enum Requeue {
    /// Its worker was asked to end and gave it back.
    Released,
    /// Its attempt failed.
    #[serde(untagged)]
    Failed(FailureReason),
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn kinds_have_names_of_their_own() {
        for kind in EventKind::ALL {
            assert_eq!(EventKind::from_name(kind.name()), Some(kind));
        }
        assert_eq!(EventKind::from_name("job.dance"), None);
    }

    #[test]
    fn why_a_job_waits_again_is_an_object_with_a_code() {
        let crash = FailureReason::WorkerCrashed {
            signal: Some(9),
            exit_code: None,
        };
        for (reason, written) in [
            (Requeue::Released, json!({"code": "released"})),
            (
                Requeue::Failed(crash),
                json!({"code": "worker_crashed", "signal": 9}),
            ),
            (
                Requeue::Failed(FailureReason::LeaseExpired),
                json!({"code": "lease_expired"}),
            ),
        ] {
            assert_eq!(json!(reason), written);
            assert_eq!(serde_json::from_value::<Requeue>(written).unwrap(), reason);
        }
    }

    #[test]
    fn a_first_wait_has_no_reason() {
        let first = NewEvent::Queued {
            position: Some(3),
            reason: None,
        };
        assert_eq!(json!(first), json!({"position": 3}));
        assert_eq!(json!(NewEvent::Cancelled {}), json!({}));
    }
}
