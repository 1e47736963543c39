//! Answers that show a job, with the headers that go with it.

use axum::http::header::{CONTENT_TYPE, ETAG, LOCATION, RETRY_AFTER};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use sha2::{Digest, Sha256};

use crate::http::api;
use crate::http::wire::download::{hex, none_match};
use crate::http::wire::error::{ApiError, Result};
use crate::jobs::Job;

/// Header that says which preference was honoured (RFC 7240).
pub(in crate::http) const PREFERENCE_APPLIED: HeaderName =
    HeaderName::from_static("preference-applied");

/// Address of a job.
pub(in crate::http) fn url(job: &Job) -> String {
    format!("/v1/jobs/{}", job.id)
}

/// The job as JSON.
pub(in crate::http) fn body(job: &Job, place: Option<api::Place>) -> Vec<u8> {
    let body = serde_json::to_vec(&api::Job::new(job, place));
    body.expect("its keys are strings")
}

/// The answer that shows a job, with `Location`, `ETag` and, until it ends, `Retry-After`.
pub(in crate::http) fn answer(
    status: StatusCode,
    job: &Job,
    place: Option<api::Place>,
) -> Response {
    let body = body(job, place);
    let tag = etag(&body);
    let json = [(CONTENT_TYPE, HeaderValue::from_static("application/json"))];
    let mut response = (status, json, body).into_response();
    let headers = response.headers_mut();
    for (name, value) in [(ETAG, tag), (LOCATION, url(job))] {
        if let Ok(value) = HeaderValue::try_from(value) {
            headers.insert(name, value);
        }
    }
    if !job.status.is_final() {
        headers.insert(RETRY_AFTER, HeaderValue::from(retry_after(job)));
    }
    response
}

/// The answer to a poll: 304 when the client has seen this state.
///
/// # Errors
/// None of the client's making.
pub(in crate::http) fn poll(
    request: &HeaderMap,
    job: &Job,
    place: Option<api::Place>,
) -> Result<Response> {
    let mut response = answer(StatusCode::OK, job, place);
    response.headers_mut().remove(LOCATION);
    let tag = response.headers().get(ETAG).cloned();
    let tag = tag.ok_or_else(|| ApiError::internal("a job has no ETag"))?;
    if none_match(request, tag.to_str().unwrap_or_default()) {
        *response.status_mut() = StatusCode::NOT_MODIFIED;
        *response.body_mut() = axum::body::Body::empty();
        response.headers_mut().remove(CONTENT_TYPE);
        response
            .headers_mut()
            .remove(axum::http::header::CONTENT_LENGTH);
    }
    Ok(response)
}

/// Seconds after which it is worth to look again: a second for short jobs, more for long ones.
fn retry_after(job: &Job) -> u32 {
    let quarter = job.eta_seconds.unwrap_or(0.0) / 4.0;
    quarter.clamp(1.0, 30.0).ceil() as u32
}

/// Weak: the same state may be written in other bytes by another version.
fn etag(body: &[u8]) -> String {
    let hash = Sha256::digest(body);
    format!("W/\"{}\"", hex(&hash[..16]))
}
