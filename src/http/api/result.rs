//! What comes out of a job.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::{Map, Value};

use super::Time;
use crate::jobs::{JobId, Status, Verdict};

/// A list about a job.
#[derive(Debug, Serialize)]
pub(in crate::http) struct JobItems<'a, T> {
    /// The job.
    pub(in crate::http) job_id: &'a JobId,
    /// The items.
    pub(in crate::http) items: Vec<T>,
}

/// A mesh from during the training.
#[derive(Debug, Serialize)]
pub(in crate::http) struct Snapshot<'a> {
    /// Evaluation at which it was taken.
    pub(in crate::http) evaluation: u64,
    /// Number of vertices.
    pub(in crate::http) vertices: u64,
    /// Number of triangles.
    pub(in crate::http) triangles: u64,
    /// Size as binary PLY.
    pub(in crate::http) bytes: u64,
    /// Hash of the binary PLY.
    pub(in crate::http) sha256: &'a str,
    /// When it was written.
    pub(in crate::http) created_at: Time,
    /// How far it can be trusted.
    pub(in crate::http) verdict: Option<Verdict>,
    /// Where it is, by format.
    pub(in crate::http) links: BTreeMap<&'static str, String>,
}

/// The training series, a list a column.
#[derive(Debug, Serialize)]
pub(in crate::http) struct Series<'a> {
    /// The job.
    pub(in crate::http) job_id: &'a JobId,
    /// Whether more may come.
    pub(in crate::http) status: Status,
    /// Rows before thinning.
    pub(in crate::http) rows: usize,
    /// The last row that is shown.
    pub(in crate::http) last_evaluation: Option<u64>,
    /// Values by column.
    pub(in crate::http) series: Map<String, Value>,
}

/// The fits of blocks, a list a quantity, as the report has them.
#[derive(Debug, Serialize)]
pub(in crate::http) struct Blocks<'a> {
    /// The job.
    pub(in crate::http) job_id: &'a JobId,
    /// Whether more may come.
    pub(in crate::http) status: Status,
    /// Number of blocks.
    pub(in crate::http) blocks: u64,
    /// Values by quantity.
    pub(in crate::http) series: Value,
}
