//! One attempt at a job: the claim that a worker holds, what it may write, how it can end.

use std::fmt::Write as _;
use std::time::Duration;

use bytes::Bytes;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::event::NewEvent;
use super::{Job, JobId};
use crate::reconstruction::Phase;
use crate::reconstruction::report::Verdict;
use crate::reconstruction::training::{GradientHistogram, Metrics};

/// The right to write about a job, until the lease ends or the job does.
#[derive(Debug, Clone, PartialEq)]
pub struct Claim {
    /// The job as it was when it was claimed.
    pub job: Job,
    /// Number of this attempt: every write of the worker names it.
    pub attempt: i64,
    /// How long earlier attempts worked.
    pub worked: Duration,
}

impl Claim {
    /// The job that is held.
    pub fn job_id(&self) -> &JobId {
        &self.job.id
    }
}

/// What a renewal found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lease {
    /// The job is still held.
    Held {
        /// Whether a client wants it to end.
        cancel_requested: bool,
    },
    /// The job ended, was erased, or runs in another attempt: stop the work, write nothing.
    Lost,
}

/// What a worker tells while it works; all of it is written in one transaction, or nothing.
/// `None` leaves a column as it is.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Record {
    /// Stage that has begun.
    pub phase: Option<Phase>,
    /// Share of the whole work that is done, 0 to 1.
    pub progress: Option<f64>,
    /// Estimated seconds to the end.
    pub eta_seconds: Option<f64>,
    /// Evaluations of loss and gradient so far.
    pub evaluations: Option<u64>,
    /// Last training loss.
    pub loss: Option<f64>,
    /// Events, oldest first.
    pub events: Vec<NewEvent>,
    /// Accepted iterations; one whose evaluation is there already is left out.
    pub metrics: Vec<Metrics>,
    /// Gradient histograms; one whose evaluation is there already is left out.
    pub gradients: Vec<GradientHistogram>,
}

/// An encoded mesh on its way into the store.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NewMesh {
    pub(super) vertices: u64,
    pub(super) triangles: u64,
    pub(super) data: Bytes,
    pub(super) sha256: String,
    pub(super) verdict: Option<Verdict>,
}

impl NewMesh {
    /// A mesh of so many vertices and triangles in its canonical encoding, binary PLY.
    ///
    /// Hashes the bytes, in the caller's thread.
    pub fn new(vertices: u64, triangles: u64, data: Vec<u8>) -> Self {
        Self {
            vertices,
            triangles,
            sha256: sha256_hex(&data),
            data: data.into(),
            verdict: None,
        }
    }

    /// The same with how far it can be relied on; of a result its report tells that.
    #[must_use]
    pub fn judged(self, verdict: Verdict) -> Self {
        Self {
            verdict: Some(verdict),
            ..self
        }
    }
}

/// SHA-256 in lower-case hexadecimal digits.
pub(super) fn sha256_hex(data: &[u8]) -> String {
    let mut digits = String::with_capacity(64);
    for byte in Sha256::digest(data) {
        write!(digits, "{byte:02x}").expect("a String takes everything");
    }
    digits
}

/// Everything that makes a job a success; written in one transaction, or not at all.
#[derive(Debug, Clone, PartialEq)]
pub struct Success {
    /// The result.
    pub mesh: NewMesh,
    /// The quality report: a JSON object.
    pub report: Value,
    /// The trained network (safetensors with its settings).
    pub model: Vec<u8>,
    /// What was not recorded before.
    pub last: Record,
}

/// Why an attempt failed through no fault of the input; the job is tried again, or fails with
/// [`FailureReason::problem`] when this was the last attempt or another one is sure to fail too.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "code", rename_all = "snake_case")]
pub enum FailureReason {
    /// The worker process ended.
    WorkerCrashed {
        /// Signal that ended it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        signal: Option<i32>,
        /// Status that it exited with.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        exit_code: Option<i32>,
    },
    /// The worker was ended because it used too much memory.
    OutOfMemory {
        /// Most bytes that a worker may hold.
        limit_bytes: u64,
    },
    /// The worker did not renew its lease in time.
    LeaseExpired,
    /// The worker did not answer a request to stop.
    Unresponsive,
    /// The reconstruction failed by a defect of ours.
    Internal {
        /// What was seen.
        detail: String,
    },
}

impl FailureReason {
    /// Stable `snake_case` name.
    pub fn code(&self) -> &'static str {
        match self {
            Self::WorkerCrashed { .. } => "worker_crashed",
            Self::OutOfMemory { .. } => "out_of_memory",
            Self::LeaseExpired => "lease_expired",
            Self::Unresponsive => "unresponsive",
            Self::Internal { .. } => "internal",
        }
    }

    /// Whether another attempt would fail the same way: the same job needs the same memory.
    pub fn is_sure(&self) -> bool {
        matches!(self, Self::OutOfMemory { .. })
    }

    /// The problem of a job whose last attempt failed for this reason.
    pub fn problem(&self, failures: i64) -> Problem {
        let (code, what) = match self {
            Self::WorkerCrashed { signal, exit_code } => (
                "worker_crashed",
                match (signal, exit_code) {
                    (Some(signal), _) => format!("the worker was ended by signal {signal}"),
                    (None, Some(code)) => format!("the worker exited with status {code}"),
                    (None, None) => "the worker ended".to_owned(),
                },
            ),
            Self::OutOfMemory { limit_bytes } => (
                "out_of_memory",
                format!(
                    "the worker needed more than {} MiB of memory; lower surface.resolution, \
                     network.width, training.history or the budgets of sampling, or give workers \
                     more with --worker-memory-mib",
                    limit_bytes >> 20
                ),
            ),
            Self::LeaseExpired => (
                "worker_crashed",
                "the worker did not renew its lease".to_owned(),
            ),
            Self::Unresponsive => ("worker_crashed", "the worker did not answer".to_owned()),
            // What was seen is for the log; a client learns that it is not its fault.
            Self::Internal { .. } => ("internal", "the reconstruction failed".to_owned()),
        };
        let plural = if failures == 1 { "" } else { "s" };
        Problem {
            code: code.to_owned(),
            detail: format!("{what}; {failures} attempt{plural} failed"),
            retryable: !self.is_sure(),
            errors: Vec::new(),
        }
    }
}

/// Why a job failed: a problem of the API without what only HTTP knows.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Problem {
    /// Stable `snake_case` name.
    pub code: String,
    /// One or two sentences for the user.
    pub detail: String,
    /// Whether the same job can succeed another time.
    pub retryable: bool,
    /// The places of the settings that are at fault, if they are.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub errors: Vec<Fault>,
}

impl Problem {
    /// A problem that another attempt would not solve.
    pub fn new(code: impl Into<String>, detail: impl Into<String>) -> Self {
        Self {
            code: code.into(),
            detail: detail.into(),
            retryable: false,
            errors: Vec::new(),
        }
    }
}

/// One place that is at fault.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fault {
    /// JSON pointer (RFC 6901) of the place.
    pub pointer: String,
    /// What is wrong, and what is allowed.
    pub detail: String,
}
