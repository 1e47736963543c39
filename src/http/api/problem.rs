//! What went wrong (RFC 9457).

use serde::Serialize;
use serde_json::{Map, Value};

use crate::jobs::Fault;

/// A problem; what each code means stands in the catalogue.
#[derive(Debug, Serialize)]
pub(in crate::http) struct Problem {
    /// Its code, in a namespace of ours.
    #[serde(rename = "type")]
    pub(in crate::http) kind: String,
    /// What the code means.
    pub(in crate::http) title: &'static str,
    /// HTTP status.
    pub(in crate::http) status: u16,
    /// What happened this time.
    pub(in crate::http) detail: String,
    /// Stable name.
    pub(in crate::http) code: &'static str,
    /// Whether the same request can succeed later.
    pub(in crate::http) retryable: bool,
    /// All places that are at fault.
    pub(in crate::http) errors: Vec<Fault>,
    /// What some codes tell besides.
    #[serde(flatten)]
    pub(in crate::http) members: Map<String, Value>,
    /// The request; none in the error of a job.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::http) request_id: Option<String>,
}
