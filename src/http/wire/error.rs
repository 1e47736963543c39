//! Errors as clients see them: RFC 9457 problems.
//!
//! Only this file and the catalogue know status codes. The rooms below have codes of their own, which
//! the catalogue contains by name. A code that it does not contain becomes `internal`: it is
//! logged once, and the client learns no details.

use axum::Json;
use axum::http::header::{CONTENT_TYPE, RETRY_AFTER};
use axum::http::{HeaderName, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use serde_json::{Map, Value};

use crate::folder::Shortage;
use crate::http::api;
use crate::http::wire::quota;
use crate::http::wire::request_id;
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
            // The contract promises `Retry-After` for these statuses.
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

    /// Something that was erased.
    pub fn gone(what: &str, tombstone: &Tombstone) -> Self {
        let deleted_at = api::Time(tombstone.deleted_at);
        Self::new(
            Code::Gone,
            format!(
                "the {what} was erased at {deleted_at} ({})",
                tombstone.reason
            ),
        )
        .with("deleted_at", deleted_at.to_string().into())
        .with("reason", tombstone.reason.as_str().into())
    }

    /// Why something of this kind is not here, from what stays of it: it was erased, or never was.
    pub fn absent(what: &str, stays: jobs::Result<Option<Tombstone>>) -> Self {
        match stays {
            Ok(Some(tombstone)) => Self::gone(what, &tombstone),
            Ok(None) => Self::not_found(what),
            Err(error) => error.into(),
        }
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

    /// The same with something more to say.
    #[must_use]
    pub fn and(mut self, more: &str) -> Self {
        self.detail.push_str("; ");
        self.detail.push_str(more);
        self
    }

    /// The same with a further member.
    #[must_use]
    pub fn with(mut self, name: &str, value: Value) -> Self {
        self.members.insert(name.to_owned(), value);
        self
    }

    /// The same about one of several clouds, which it names by its place, from 1.
    #[must_use]
    pub fn of_cloud(mut self, place: usize) -> Self {
        self.detail = format!("cloud {place}: {}", self.detail);
        self.with("cloud", place.into())
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

    /// What is kept of it.
    pub fn kept(&self) -> jobs::Problem {
        jobs::Problem {
            retryable: self.code.entry().retryable,
            errors: self.errors.clone(),
            ..jobs::Problem::new(self.code.entry().name, self.detail.clone())
        }
    }

    /// Its code.
    pub fn code(&self) -> Code {
        self.code
    }

    /// The body of the problem, as for the request of this id.
    pub(in crate::http) fn body(self, request_id: Option<String>) -> api::Problem {
        let entry = self.code.entry();
        api::Problem {
            kind: format!("{TYPE}{}", entry.name),
            title: entry.title,
            status: entry.status,
            detail: self.detail,
            code: entry.name,
            retryable: entry.retryable,
            errors: self.errors,
            members: self.members,
            request_id,
        }
    }
}

impl IntoResponse for ApiError {
    fn into_response(mut self) -> Response {
        let status = StatusCode::from_u16(self.code.entry().status)
            .unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let (code, retry_after) = (self.code, self.retry_after);
        let own_headers = std::mem::take(&mut self.headers);
        let body = self.body(request_id::current());
        let mut response = (status, Json(body)).into_response();
        let headers = response.headers_mut();
        headers.insert(
            CONTENT_TYPE,
            HeaderValue::from_static("application/problem+json"),
        );
        if let Some(seconds) = retry_after {
            headers.insert(RETRY_AFTER, HeaderValue::from(seconds));
        }
        headers.extend(own_headers);
        // Says to the layers around that this is a problem, and which.
        response.extensions_mut().insert(code);
        response
    }
}

impl From<&jobs::Problem> for api::Problem {
    fn from(problem: &jobs::Problem) -> Self {
        Self {
            retryable: problem.retryable,
            ..ApiError::from(problem).body(None)
        }
    }
}

impl From<&jobs::Problem> for ApiError {
    fn from(problem: &jobs::Problem) -> Self {
        Self {
            errors: problem.errors.clone(),
            ..Self::new(Code::from_name(&problem.code), problem.detail.clone())
        }
    }
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
            jobs::Error::Quota {
                policy,
                retry_seconds,
            } => quota::used_up(*policy, *retry_seconds),
            jobs::Error::Held | jobs::Error::Busy | jobs::Error::Closed => {
                Self::new(Code::from_name(error.code()), error.to_string())
            }
            jobs::Error::ContentUnavailable(_) => {
                tracing::warn!(error.message = %error, "a request needs the object store");
                Self::new(
                    Code::StorageUnavailable,
                    "the object store with the bytes of clouds and meshes does not answer",
                )
                .retry_after(10)
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
            intake::Error::DiskFull => Code::InsufficientStorage,
            intake::Error::OutOfMemory => Code::CloudNeedsMemory,
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
        let problem = ApiError::internal("secret").body(Some("r1".to_owned()));
        let written = serde_json::to_string(&problem).unwrap();
        assert!(!written.contains("secret"));
        assert!(written.contains(r#""request_id":"r1""#), "{written}");
    }
}
