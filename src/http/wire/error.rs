//! What goes wrong, as a client sees it: RFC 9457 problems, and the one table of codes.
//!
//! Only this file knows status codes. The rooms below have codes of their own, which are found in
//! the table by name; what is not there is `internal`, logged once, and told without its insides.

use axum::Json;
use axum::http::header::{CONTENT_TYPE, RETRY_AFTER};
use axum::http::{HeaderName, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use serde_json::{Map, Value, json};

use crate::folder::Shortage;
use crate::intake;
use crate::jobs::{self, Fault, Tombstone};
use crate::reconstruction::cloud;
use crate::reconstruction::settings;

pub use super::catalogue::{CATALOGUE, Code, Entry};

/// Namespace of the `type` of a problem; its code follows.
const TYPE: &str = "urn:meshway:problem:";

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
        let deleted_at = crate::http::wire::time::rfc3339(tombstone.deleted_at);
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
    pub(in crate::http) fn respond(self, request_id: Option<&str>) -> Response {
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
pub(in crate::http) fn problem_of(problem: &jobs::Problem) -> Value {
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

impl From<Shortage> for ApiError {
    fn from(shortage: Shortage) -> Self {
        match shortage {
            Shortage::Reserve { .. } => Self::new(Code::InsufficientStorage, shortage.to_string()),
            Shortage::Unknown(error) => Self::internal(error),
        }
    }
}

impl From<intake::Error> for ApiError {
    fn from(error: intake::Error) -> Self {
        let code = match &error {
            intake::Error::Cloud(error) => Code::from_name(error.code()),
            intake::Error::Refused { code, .. } => Code::from_name(code),
            intake::Error::TooSlow => Code::BodyTooLarge,
            intake::Error::OutOfMemory => Code::TooManyPoints,
            intake::Error::Failed(error) => return Self::internal(error),
        };
        Self::new(code, error.to_string())
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
    fn every_code_of_the_readers_is_known() {
        let errors = [
            cloud::Error::Empty,
            cloud::Error::TooFewPoints {
                found: 1,
                needed: 2,
            },
            cloud::Error::TooManyPoints { limit: 1 },
            cloud::Error::Degenerate("x"),
            cloud::Error::NotFinite {
                dropped: 1,
                total: 2,
            },
            cloud::Error::TooLarge {
                value: 1.0,
                limit: 0.5,
            },
            cloud::Error::Truncated {
                what: String::new(),
                declared: 2,
                found: 1,
            },
            cloud::Error::Header {
                line: 1,
                detail: String::new(),
            },
            cloud::Error::Row {
                line: 1,
                detail: String::new(),
            },
            cloud::Error::NoCoordinates(String::new()),
            cloud::Error::NormalsInvalid(String::new()),
            cloud::Error::UnsupportedFormat(String::new()),
            cloud::Error::Compression(String::new()),
            cloud::Error::ExpandsTooFar { limit: 1 },
        ];
        for error in errors {
            assert_ne!(
                Code::from_name(error.code()),
                Code::Internal,
                "{}",
                error.code()
            );
        }
    }

    #[test]
    fn a_defect_shows_nothing_of_its_insides() {
        let problem = ApiError::internal("secret").document(Some("r1"));
        assert!(!problem.to_string().contains("secret"));
        assert_eq!(problem["request_id"], "r1");
    }
}
