//! Events, and what a stream says of itself.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::Value;

use super::{Batch, Job};
use crate::jobs::EventKind;

/// An event of a page.
#[derive(Debug, Serialize)]
pub(in crate::http) struct EventItem {
    /// Its place among the events of the job, or of all.
    pub(in crate::http) id: i64,
    /// Its kind.
    pub(in crate::http) event: EventKind,
    /// What it carries, as it was written when it happened, and its links.
    pub(in crate::http) data: Value,
}

/// A page of events, oldest first.
#[derive(Debug, Serialize)]
pub(in crate::http) struct EventPage {
    /// The events.
    pub(in crate::http) items: Vec<EventItem>,
    /// What the next page is asked for after; none where there may be no more.
    pub(in crate::http) next_after: Option<i64>,
}

/// The state of a job, for a stream that cannot continue where it was asked to.
#[derive(Debug, Serialize)]
pub(in crate::http) struct JobReset<'a> {
    /// The oldest event that can be had.
    pub(in crate::http) oldest: i64,
    /// The newest event.
    pub(in crate::http) newest: i64,
    /// The job.
    pub(in crate::http) job: Job<'a>,
}

/// The state of all jobs, for a stream that cannot continue where it was asked to.
#[derive(Debug, Serialize)]
pub(in crate::http) struct AllReset {
    /// The oldest event that can be had.
    pub(in crate::http) oldest: i64,
    /// The newest event.
    pub(in crate::http) newest: i64,
    /// Number of jobs by status.
    pub(in crate::http) jobs: BTreeMap<&'static str, u64>,
}

/// The state of a batch, for a stream that cannot continue where it was asked to.
#[derive(Debug, Serialize)]
pub(in crate::http) struct BatchReset<'a> {
    /// The oldest event that can be had.
    pub(in crate::http) oldest: i64,
    /// The newest event.
    pub(in crate::http) newest: i64,
    /// The batch.
    pub(in crate::http) batch: Batch<'a>,
}

/// Where the results of a job are.
#[derive(Debug, Serialize)]
pub(in crate::http) struct SucceededLinks {
    /// The mesh.
    pub(in crate::http) mesh: String,
    /// The report.
    pub(in crate::http) report: String,
    /// The network.
    pub(in crate::http) model: String,
}
