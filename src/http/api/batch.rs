//! A batch of jobs.

use std::collections::BTreeMap;

use serde::Serialize;

use super::Time;
use crate::jobs::{self, BatchId, CloudId, JobId, Status};
use crate::reconstruction::Preset;
use crate::reconstruction::medical::Choice;
use crate::reconstruction::report::Verdict;

/// A batch.
#[derive(Debug, Serialize)]
pub(in crate::http) struct Batch<'a> {
    id: &'a BatchId,
    status: &'static str,
    progress: f64,
    total: u64,
    counts: BTreeMap<&'static str, u64>,
    preset: Option<Preset>,
    labels: Option<&'a BTreeMap<String, String>>,
    created_at: Time,
    #[serde(skip_serializing_if = "Option::is_none")]
    jobs: Option<Vec<BatchJob<'a>>>,
    links: Links,
}

#[derive(Debug, Serialize)]
struct BatchJob<'a> {
    id: &'a JobId,
    cloud_id: &'a CloudId,
    source: Option<&'a Choice>,
    status: Status,
    progress: f64,
    verdict: Option<Verdict>,
    error: Option<&'a str>,
    link: String,
}

#[derive(Debug, Serialize)]
struct Links {
    #[serde(rename = "self")]
    own: String,
    cancel: String,
    events: String,
    jobs: String,
}

impl<'a> Batch<'a> {
    /// The batch with its jobs.
    pub(in crate::http) fn whole(batch: &'a jobs::Batch) -> Self {
        Self {
            jobs: Some(batch.jobs.iter().map(BatchJob::from).collect()),
            ..Self::listed(batch)
        }
    }

    /// The batch as lists show it.
    pub(in crate::http) fn listed(batch: &'a jobs::Batch) -> Self {
        let own = format!("/v1/batches/{}", batch.id);
        let first = batch.jobs.first();
        Self {
            id: &batch.id,
            status: batch.status(),
            progress: batch.progress,
            total: batch.made,
            counts: counts(batch),
            preset: first.map(|job| job.preset),
            labels: first.map(|job| &job.labels),
            created_at: Time(batch.created_at),
            jobs: None,
            links: Links {
                cancel: format!("{own}/cancel"),
                events: format!("{own}/events"),
                jobs: format!("/v1/jobs?batch_id={}", batch.id),
                own,
            },
        }
    }
}

impl<'a> From<&'a jobs::BatchJob> for BatchJob<'a> {
    fn from(job: &'a jobs::BatchJob) -> Self {
        Self {
            id: &job.id,
            cloud_id: &job.cloud_id,
            source: job.source.as_ref(),
            status: job.status,
            progress: job.progress,
            verdict: job.verdict,
            error: job.error.as_deref(),
            link: format!("/v1/jobs/{}", job.id),
        }
    }
}

/// Number of jobs in each state, and of those that were erased.
fn counts(batch: &jobs::Batch) -> BTreeMap<&'static str, u64> {
    let in_state = |status: Status| batch.jobs.iter().filter(|job| job.status == status).count();
    let mut counts: BTreeMap<_, _> = Status::ALL
        .map(|status| (status.name(), in_state(status) as u64))
        .into();
    counts.insert("erased", batch.made - batch.jobs.len() as u64);
    counts
}
