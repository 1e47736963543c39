//! The service itself.

use std::collections::BTreeMap;

use serde::Serialize;

use super::Time;
use crate::config::Ttl;
use crate::reconstruction::Settings;

/// A preset.
#[derive(Debug, Serialize)]
pub(in crate::http) struct PresetItem {
    /// Its name.
    pub(in crate::http) name: &'static str,
    /// Whether it is taken where none is named.
    pub(in crate::http) default: bool,
    /// All its settings.
    pub(in crate::http) settings: Settings,
}

/// What the service allows.
#[derive(Debug, Serialize)]
pub(in crate::http) struct Limits {
    /// Connections at the same time.
    pub(in crate::http) connections: u32,
    /// Bytes of the header of a request.
    pub(in crate::http) header_bytes: usize,
    /// Seconds that a header may take to come.
    pub(in crate::http) header_seconds: u32,
    /// Bytes of an upload.
    pub(in crate::http) body_bytes: u64,
    /// Seconds that an upload may pause.
    pub(in crate::http) upload_idle_seconds: u32,
    /// Least bytes a second of an upload.
    pub(in crate::http) upload_bytes_per_second: u64,
    /// Seconds that a client may leave an answer unread.
    pub(in crate::http) download_idle_seconds: u32,
    /// Bytes that one received byte may become.
    pub(in crate::http) decompression_ratio: u64,
    /// Bytes of the header of a file.
    pub(in crate::http) cloud_header_bytes: usize,
    /// Points of a cloud.
    pub(in crate::http) points: u64,
    /// Least points of a cloud.
    pub(in crate::http) least_points: usize,
    /// Triangles of a mesh.
    pub(in crate::http) mesh_triangles: usize,
    /// Bytes of a JSON body.
    pub(in crate::http) settings_bytes: usize,
    /// Labels of a job.
    pub(in crate::http) labels: usize,
    /// Characters of the key and of the value of a label.
    pub(in crate::http) label_characters: usize,
    /// Priorities of a job.
    pub(in crate::http) priority: Range,
    /// Evaluations in a list of chosen ones.
    pub(in crate::http) chosen_evaluations: usize,
    /// Memory of a grid.
    pub(in crate::http) grid_bytes: Option<u64>,
    /// Memory of a training.
    pub(in crate::http) training_bytes: Option<u64>,
    /// Memory of a worker.
    pub(in crate::http) worker_memory_bytes: Option<u64>,
    /// Jobs of a batch.
    pub(in crate::http) batch_jobs: usize,
    /// Jobs that may wait.
    pub(in crate::http) queued_jobs: u32,
    /// Seconds of a job.
    pub(in crate::http) job_seconds: u32,
    /// Seconds of `Prefer: wait`.
    pub(in crate::http) wait_seconds: u64,
    /// Characters of an `Idempotency-Key`.
    pub(in crate::http) idempotency_key_characters: usize,
    /// Seconds that an answer is kept under its key.
    pub(in crate::http) idempotency_seconds: i64,
    /// Seconds that an upload is kept without bytes.
    pub(in crate::http) upload_keep_seconds: i64,
    /// Uploads of a tenant that are not complete.
    pub(in crate::http) open_uploads: u32,
    /// Items of a page.
    pub(in crate::http) page_items: u32,
    /// Events of a page.
    pub(in crate::http) event_page_items: u32,
    /// Events of a job.
    pub(in crate::http) events_per_job: u32,
    /// Rows of the training series of a job.
    pub(in crate::http) metrics_per_job: u32,
    /// Event streams at the same time.
    pub(in crate::http) event_streams: u32,
    /// Event streams of one client.
    pub(in crate::http) event_streams_per_client: u32,
    /// Bytes of a request for values of a field.
    pub(in crate::http) field_bytes: usize,
    /// Points of such a request.
    pub(in crate::http) field_points: usize,
    /// How long a cloud is kept, where its client asks for no other time.
    pub(in crate::http) cloud_ttl: Option<Ttl>,
    /// The same of a job, after its end.
    pub(in crate::http) job_ttl: Option<Ttl>,
    /// Days that the audit trail is kept.
    pub(in crate::http) audit_days: u32,
    /// Space of the disk that is kept free.
    pub(in crate::http) disk_reserve_bytes: u64,
    /// Bounds of the settings, by their pointers.
    pub(in crate::http) settings: BTreeMap<&'static str, Range>,
}

/// Bounds of a number, both allowed.
#[derive(Debug, Serialize)]
pub(in crate::http) struct Range {
    /// The smallest.
    pub(in crate::http) minimum: f64,
    /// The largest.
    pub(in crate::http) maximum: f64,
}

/// What the service is.
#[derive(Debug, Serialize)]
pub(in crate::http) struct Version {
    /// Version of the program.
    pub(in crate::http) version: &'static str,
    /// Version of the API.
    pub(in crate::http) api: &'static str,
    /// When it was started.
    pub(in crate::http) started_at: Time,
}

/// The process answers.
#[derive(Debug, Serialize)]
pub(in crate::http) struct Live {
    /// `ok`.
    pub(in crate::http) status: &'static str,
}

/// New work would be taken and done.
#[derive(Debug, Serialize)]
pub(in crate::http) struct Ready {
    /// `ready`.
    pub(in crate::http) status: &'static str,
    /// Every check.
    pub(in crate::http) checks: BTreeMap<&'static str, Check>,
}

/// One check.
#[derive(Debug, Serialize)]
pub(in crate::http) struct Check {
    /// Whether all is well.
    pub(in crate::http) ok: bool,
    /// What is not.
    pub(in crate::http) detail: Option<String>,
}
