//! What goes wrong, as a client sees it: RFC 9457 problems, and the one table of codes.
//!
//! Only this file knows status codes. The rooms below have codes of their own, which are found in
//! the table by name; what is not there is `internal`, logged once, and told without its insides.

use axum::Json;
use axum::http::header::{CONTENT_TYPE, RETRY_AFTER};
use axum::http::{HeaderName, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use serde_json::{Map, Value, json};

use crate::jobs::{self, Fault, Tombstone};
use crate::reconstruction::cloud;
use crate::reconstruction::settings;

/// Namespace of the `type` of a problem; its code follows.
const TYPE: &str = "urn:meshway:problem:";

/// Writes the codes and the table that says what each means.
macro_rules! catalogue {
    ($($code:ident $name:literal $status:literal $retryable:literal $title:literal;)*) => {
        /// Stable name of a problem.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum Code {
            $(#[doc = $title] $code,)*
        }

        /// All problems: what `openapi.yaml` must list.
        pub const CATALOGUE: &[Entry] = &[
            $(Entry { code: Code::$code, name: $name, status: $status, retryable: $retryable, title: $title },)*
        ];
    };
}

/// A row of the [`CATALOGUE`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// The code.
    pub code: Code,
    /// Its `snake_case` name in JSON.
    pub name: &'static str,
    /// HTTP status; for a job's own failures the one its `error` carries.
    pub status: u16,
    /// Whether the same request can succeed later.
    pub retryable: bool,
    /// What it means, the same for every occurrence.
    pub title: &'static str,
}

catalogue! {
    MalformedJson "malformed_json" 400 false "The body is not JSON.";
    MalformedMultipart "malformed_multipart" 400 false "The body is not a usable multipart form.";
    BadHeader "bad_header" 400 false "A header cannot be understood.";
    BadCursor "bad_cursor" 400 false "The cursor is none of ours.";
    BodyBrokenOff "body_broken_off" 400 true "The body broke off.";
    CrossOriginRefused "cross_origin_refused" 403 false "A page of another site sent the request.";
    NotFound "not_found" 404 false "There is nothing here.";
    MethodNotAllowed "method_not_allowed" 405 false "This method is not for this resource.";
    NotAcceptable "not_acceptable" 406 false "None of the accepted media types can be given.";
    UploadTimeout "upload_timeout" 408 true "The upload stood still for too long.";
    ResultNotReady "result_not_ready" 409 true "The job has not ended.";
    ModelUnreadable "model_unreadable" 409 false "The network cannot be read by this version.";
    CloudInUse "cloud_in_use" 409 true "A job that has not ended needs the cloud.";
    IdempotencyInFlight "idempotency_in_flight" 409 true "The first request with this key is being worked on.";
    Gone "gone" 410 false "It was erased.";
    PreconditionFailed "precondition_failed" 412 false "It is not the version that is asked for.";
    BodyTooLarge "body_too_large" 413 false "The body is larger than allowed.";
    TooManyPoints "too_many_points" 413 false "The cloud has more points than allowed.";
    UnsupportedFormat "unsupported_format" 415 false "The format is not supported.";
    UnsupportedEncoding "unsupported_encoding" 415 false "The encoding is not supported or damaged.";
    RangeNotSatisfiable "range_not_satisfiable" 416 false "The range lies outside of the content.";
    HostNotAllowed "host_not_allowed" 421 false "The service does not answer to this host.";
    RequestInvalid "request_invalid" 422 false "A parameter or a field is refused.";
    IdempotencyMismatch "idempotency_mismatch" 422 false "The key was used for another request.";
    CloudMissing "cloud_missing" 422 false "The cloud that is named does not exist.";
    CloudEmpty "cloud_empty" 422 false "The cloud has no points.";
    CloudTooFewPoints "cloud_too_few_points" 422 false "The cloud has too few points.";
    CloudDegenerate "cloud_degenerate" 422 false "The points span no volume.";
    CloudFilled "cloud_filled" 422 false "The points fill a solid volume; those of its surface are needed.";
    SlicesUnusable "slices_unusable" 422 false "No surface can be made from the slices.";
    CloudNotFinite "cloud_not_finite" 422 false "No point has finite coordinates.";
    CloudTooLarge "cloud_too_large" 422 false "Coordinates are too large.";
    CloudTruncated "cloud_truncated" 422 false "The file ends before what it declares.";
    CloudHeader "cloud_header" 422 false "The header of the file cannot be understood.";
    CloudRow "cloud_row" 422 false "A row of the file cannot be understood.";
    CloudNoCoordinates "cloud_no_coordinates" 422 false "The file has no coordinates.";
    OrientationMissing "orientation_missing" 422 false "The file does not say how it lies in the patient.";
    SourceMissing "source_missing" 422 false "The file holds several parts, and none is chosen.";
    SourceUnknown "source_unknown" 422 false "The part that is chosen is not in the file.";
    NormalsInvalid "normals_invalid" 422 false "The normals cannot be used.";
    SettingsInvalid "settings_invalid" 422 false "Settings are unknown, mistyped or out of bounds.";
    SettingsConflict "settings_conflict" 422 false "Settings contradict each other or the cloud.";
    GridTooLarge "grid_too_large" 422 false "The grid needs more memory than allowed.";
    TrainingTooLarge "training_too_large" 422 false "The training needs more memory than allowed.";
    RateLimited "rate_limited" 429 true "Too many requests.";
    Quota "quota" 429 true "The quota is used up.";
    Internal "internal" 500 true "The service failed.";
    QueueFull "queue_full" 503 true "As many jobs as allowed wait already.";
    Draining "draining" 503 true "The service is about to stop.";
    NotReady "not_ready" 503 true "The service is not ready.";
    DatabaseBusy "database_busy" 503 true "The database is busy.";
    InsufficientStorage "insufficient_storage" 507 true "The disk is nearly full.";
    TrainingDiverged "training_diverged" 422 false "Training diverged.";
    NoSurface "no_surface" 422 false "The trained field has no surface.";
    MeshTooLarge "mesh_too_large" 422 false "The mesh would be larger than allowed.";
    OutOfMemory "out_of_memory" 500 false "The worker needed more memory than allowed.";
    TimeLimit "time_limit" 422 false "The job took longer than allowed.";
    WorkerCrashed "worker_crashed" 500 true "The worker died in every attempt.";
}

impl Code {
    /// What the table says of it.
    pub fn entry(self) -> Entry {
        // The table is written in the order of the variants.
        CATALOGUE[self as usize]
    }

    /// The code of this name; `Internal` for a name that is not in the table.
    pub fn from_name(name: &str) -> Self {
        let entry = CATALOGUE.iter().find(|entry| entry.name == name);
        entry.map_or(Self::Internal, |entry| entry.code)
    }
}

/// A problem on its way to the client.
#[derive(Debug, Clone)]
pub struct ApiError {
    code: Code,
    detail: String,
    errors: Vec<Fault>,
    retry_after: Option<u32>,
    members: Map<String, Value>,
    headers: Vec<(HeaderName, HeaderValue)>,
}

/// Result of the room.
pub type Result<T> = std::result::Result<T, ApiError>;

impl ApiError {
    /// A problem; `detail` is one or two sentences about this occurrence.
    pub fn new(code: Code, detail: impl Into<String>) -> Self {
        let entry = code.entry();
        Self {
            code,
            detail: detail.into(),
            errors: Vec::new(),
            // The contract: 429 and 503 say when to come again, and so do waits for an end.
            retry_after: (entry.retryable && matches!(entry.status, 409 | 429 | 503 | 507))
                .then_some(if entry.status == 507 { 60 } else { 1 }),
            members: Map::new(),
            headers: Vec::new(),
        }
    }

    /// Nothing of the kind is here.
    pub fn not_found(what: &str) -> Self {
        Self::new(Code::NotFound, format!("there is no such {what}"))
    }

    /// A defect of ours: `error` is logged, and the client learns the request's id only.
    pub fn internal(error: impl std::fmt::Display) -> Self {
        tracing::error!(error.message = %error, "a request failed");
        Self::new(
            Code::Internal,
            "the service failed; its log tells more under this request_id",
        )
    }

    /// What stays of something erased.
    pub fn gone(what: &str, tombstone: &Tombstone) -> Self {
        let deleted_at = super::time::rfc3339(tombstone.deleted_at);
        Self::new(
            Code::Gone,
            format!(
                "the {what} was erased at {deleted_at} ({})",
                tombstone.reason
            ),
        )
        .with("deleted_at", json!(deleted_at))
        .with("reason", json!(tombstone.reason))
    }

    /// Refused parameters or fields, all of them.
    pub fn faults(code: Code, faults: Vec<Fault>) -> Self {
        let detail = faults
            .iter()
            .map(|fault| format!("{}: {}", fault.pointer, fault.detail))
            .collect::<Vec<_>>()
            .join("; ");
        Self {
            errors: faults,
            ..Self::new(code, detail)
        }
    }

    /// One refused parameter or field.
    pub fn fault(code: Code, pointer: &str, detail: impl Into<String>) -> Self {
        Self::faults(
            code,
            vec![Fault {
                pointer: pointer.to_owned(),
                detail: detail.into(),
            }],
        )
    }

    /// The same with a further member.
    #[must_use]
    pub fn with(mut self, name: &str, value: Value) -> Self {
        self.members.insert(name.to_owned(), value);
        self
    }

    /// The same with a header.
    #[must_use]
    pub fn with_header(mut self, name: HeaderName, value: HeaderValue) -> Self {
        self.headers.push((name, value));
        self
    }

    /// The same with a time to come again, in seconds.
    #[must_use]
    pub fn retry_after(mut self, seconds: u32) -> Self {
        self.retry_after = Some(seconds);
        self
    }

    /// Its code.
    pub fn code(&self) -> Code {
        self.code
    }

    /// The problem document; without a request it has no `request_id`.
    pub fn document(&self, request_id: Option<&str>) -> Value {
        let entry = self.code.entry();
        let mut document = json!({
            "type": format!("{TYPE}{}", entry.name),
            "title": entry.title,
            "status": entry.status,
            "detail": self.detail,
            "code": entry.name,
            "retryable": entry.retryable,
            "errors": self.errors,
        });
        if let Some(object) = document.as_object_mut() {
            object.extend(self.members.clone());
            if let Some(id) = request_id {
                object.insert("request_id".to_owned(), json!(id));
            }
        }
        document
    }

    /// The response for the request of the given id.
    pub(super) fn respond(self, request_id: Option<&str>) -> Response {
        let status = StatusCode::from_u16(self.code.entry().status)
            .unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let mut response = (status, Json(self.document(request_id))).into_response();
        let headers = response.headers_mut();
        headers.insert(
            CONTENT_TYPE,
            HeaderValue::from_static("application/problem+json"),
        );
        if let Some(seconds) = self.retry_after {
            headers.insert(RETRY_AFTER, HeaderValue::from(seconds));
        }
        headers.extend(self.headers.iter().cloned());
        // The layer that knows the request's id writes the body again.
        response.extensions_mut().insert(self);
        response
    }
}

impl IntoResponse for ApiError {
    fn into_response(self) -> Response {
        self.respond(None)
    }
}

/// The `error` of a failed job: the shape of every other problem.
pub(super) fn problem_of(problem: &jobs::Problem) -> Value {
    let code = Code::from_name(&problem.code);
    let mut document = ApiError {
        errors: problem.errors.clone(),
        ..ApiError::new(code, problem.detail.clone())
    }
    .document(None);
    document["retryable"] = json!(problem.retryable);
    document
}

impl From<jobs::Error> for ApiError {
    fn from(error: jobs::Error) -> Self {
        match &error {
            jobs::Error::CloudMissing(_) => {
                Self::fault(Code::CloudMissing, "/cloud_id", error.to_string())
            }
            jobs::Error::QueueFull { .. } => {
                Self::new(Code::QueueFull, error.to_string()).retry_after(10)
            }
            jobs::Error::Busy | jobs::Error::Closed => {
                Self::new(Code::from_name(error.code()), error.to_string())
            }
            jobs::Error::Full(_) => {
                tracing::error!(error.message = %error, "the disk refused a write");
                Self::new(
                    Code::InsufficientStorage,
                    "the disk is full or cannot be written",
                )
            }
            _ => Self::internal(error),
        }
    }
}

impl From<cloud::Error> for ApiError {
    fn from(error: cloud::Error) -> Self {
        Self::new(Code::from_name(error.code()), error.to_string())
    }
}

impl From<&settings::Error> for ApiError {
    fn from(error: &settings::Error) -> Self {
        let fault = |violation: &settings::Violation| Fault {
            pointer: format!("/settings{}", violation.pointer),
            detail: violation.detail.clone(),
        };
        Self::faults(
            Code::from_name(error.code()),
            error.violations().iter().map(fault).collect(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_in_the_order_of_its_codes() {
        for entry in CATALOGUE {
            assert_eq!(entry.code.entry(), *entry);
            assert_eq!(Code::from_name(entry.name), entry.code);
            assert!(StatusCode::from_u16(entry.status).is_ok());
        }
        assert_eq!(Code::from_name("unheard_of"), Code::Internal);
    }

    #[test]
    fn every_code_of_the_readers_is_known() {
        let text = String::new;
        let errors = [
            cloud::Error::Empty,
            cloud::Error::TooFewPoints {
                found: 1,
                needed: 2,
            },
            cloud::Error::TooManyPoints { limit: 1 },
            cloud::Error::Degenerate("x"),
            cloud::Error::Slices(text()),
            cloud::Error::NotFinite {
                dropped: 1,
                total: 2,
            },
            cloud::Error::TooLarge {
                value: 1.0,
                limit: 0.5,
            },
            cloud::Error::Truncated {
                what: text(),
                declared: 2,
                found: 1,
            },
            cloud::Error::NoCoordinates(text()),
            cloud::Error::NormalsInvalid(text()),
            cloud::Error::UnsupportedFormat(text()),
            cloud::Error::OrientationMissing(text()),
            cloud::Error::SourceMissing(text()),
            cloud::Error::SourceUnknown(text()),
            cloud::Error::Compression(text()),
            cloud::Error::ExpandsTooFar { limit: 1 },
        ];
        let (line, detail) = (1, text());
        let header = cloud::Error::Header { line, detail };
        let row = cloud::Error::Row {
            line,
            detail: text(),
        };
        for error in errors.into_iter().chain([header, row]) {
            assert_ne!(Code::from_name(error.code()), Code::Internal, "{error:?}");
        }
    }

    #[test]
    fn a_defect_shows_nothing_of_its_insides() {
        let problem = ApiError::internal("secret").document(Some("r1"));
        assert!(!problem.to_string().contains("secret"));
        assert_eq!(problem["request_id"], "r1");
    }
}
