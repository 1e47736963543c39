//! A job, and what one would cost.

use std::collections::BTreeMap;

use serde::Serialize;

use super::{Problem, Time};
use crate::config::Ttl;
use crate::jobs::assessment::Assessment;
use crate::jobs::{self, BatchId, CloudId, JobId, Status};
use crate::reconstruction::medical::Choice;
use crate::reconstruction::plan::Cost;
use crate::reconstruction::{Phase, Preset, Settings};

/// A job.
#[derive(Debug, Serialize)]
pub(in crate::http) struct Job<'a> {
    id: &'a JobId,
    status: Status,
    phase: Option<Phase>,
    progress: f64,
    eta_seconds: Option<f64>,
    queue_position: Option<u64>,
    attempt: i64,
    failures: i64,
    cancel_requested: bool,
    cloud_id: &'a CloudId,
    preset: Preset,
    settings: &'a Settings,
    labels: &'a BTreeMap<String, String>,
    source: Option<&'a Choice>,
    derived_from: Option<&'a JobId>,
    batch_id: Option<&'a BatchId>,
    priority: i64,
    evaluations: u64,
    loss: Option<f64>,
    last_event_id: i64,
    created_at: Time,
    started_at: Option<Time>,
    finished_at: Option<Time>,
    ttl: Option<String>,
    expires_at: Option<Time>,
    hold: bool,
    error: Option<Problem>,
    #[serde(flatten)]
    assessment: Assessment,
    links: Links,
}

/// Where a waiting job stands.
#[derive(Debug, Clone, Copy)]
pub(in crate::http) struct Place {
    /// 1 for the next one.
    pub(in crate::http) queue_position: u64,
    /// Estimated seconds to its end.
    pub(in crate::http) eta_seconds: f64,
}

#[derive(Debug, Serialize)]
struct Links {
    #[serde(rename = "self")]
    own: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    cloud: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    batch: Option<String>,
    cancel: String,
    retry: String,
    events: String,
    metrics: String,
    gradients: String,
    snapshots: String,
    mesh: String,
    report: String,
    model: String,
    field: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    mask: Option<String>,
}

impl<'a> Job<'a> {
    /// The job; its place in the queue is not a column and is given where it is known.
    pub(in crate::http) fn new(job: &'a jobs::Job, place: Option<Place>) -> Self {
        Self {
            id: &job.id,
            status: job.status,
            phase: job.phase,
            progress: job.progress,
            eta_seconds: place.map(|place| place.eta_seconds).or(job.eta_seconds),
            queue_position: place.map(|place| place.queue_position),
            attempt: job.attempt,
            failures: job.failures,
            cancel_requested: job.cancel_requested,
            cloud_id: &job.cloud_id,
            preset: job.preset,
            settings: &job.settings,
            labels: &job.labels,
            source: job.source.as_ref(),
            derived_from: job.derived_from.as_ref(),
            batch_id: job.batch_id.as_ref(),
            priority: job.priority,
            evaluations: job.evaluations,
            loss: job.loss,
            last_event_id: job.events,
            created_at: Time(job.created_at),
            started_at: job.started_at.map(Time),
            finished_at: job.finished_at.map(Time),
            ttl: ttl(job),
            expires_at: job.expires_at.map(Time),
            hold: job.hold,
            error: job.error.as_ref().map(Problem::from),
            assessment: Assessment::of(job.report.as_ref()),
            links: Links::of(job),
        }
    }
}

impl Links {
    fn of(job: &jobs::Job) -> Self {
        let own = format!("/v1/jobs/{}", job.id);
        let below = |name: &str| format!("{own}/{name}");
        let cloud = || format!("/v1/clouds/{}", job.cloud_id);
        Self {
            cloud: (!job.cloud_erased).then(cloud),
            batch: job.batch_id.as_ref().map(|id| format!("/v1/batches/{id}")),
            cancel: below("cancel"),
            retry: below("retry"),
            events: below("events"),
            metrics: below("metrics"),
            gradients: below("gradients"),
            snapshots: below("snapshots"),
            mesh: below("mesh"),
            report: below("report"),
            model: below("model"),
            field: below("field"),
            mask: has_grid(job).then(|| below("mask.nii.gz")),
            own,
        }
    }
}

/// How long it is kept after its end, as a client may say it; none: for ever.
fn ttl(job: &jobs::Job) -> Option<String> {
    if job.keep.once {
        return Some("download".to_owned());
    }
    let ttl = job.keep.ms.and_then(Ttl::of_ms);
    ttl.map(|ttl| ttl.to_string())
}

/// Jobs and clouds that were erased together.
#[derive(Debug, Default, Serialize)]
pub(in crate::http) struct Erased {
    /// Jobs that were erased.
    pub(in crate::http) jobs: u64,
    /// Clouds that were erased.
    pub(in crate::http) clouds: u64,
    /// Jobs that stay because they are held.
    pub(in crate::http) held: u64,
}

/// Jobs that were asked to end together.
#[derive(Debug, Default, Serialize)]
pub(in crate::http) struct Cancelled {
    /// How many.
    pub(in crate::http) jobs: u64,
}

/// Whether its cloud came from a label map, so that its mesh can be one.
fn has_grid(job: &jobs::Job) -> bool {
    let report = job.report.as_ref();
    report.is_some_and(|report| report["grid"].is_object())
}

/// What a job would be and cost.
#[derive(Debug, Serialize)]
pub(in crate::http) struct DryRun<'a> {
    /// Says that there is no job.
    pub(in crate::http) dry_run: bool,
    /// The cloud that the request names.
    pub(in crate::http) cloud_id: Option<&'a CloudId>,
    /// Preset that the settings start from.
    pub(in crate::http) preset: Preset,
    /// Complete settings.
    pub(in crate::http) settings: &'a Settings,
    /// What the job would cost.
    pub(in crate::http) estimate: Cost,
}
