//! A job as JSON, and the headers that go with it.

use axum::Json;
use axum::http::header::{ETAG, LOCATION, RETRY_AFTER};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use super::download::{hex, none_match};
use super::error::{ApiError, Result, problem_of};
use super::time::rfc3339;
use crate::jobs::{Job, assessment};

/// Header that says which preference was honoured (RFC 7240).
pub(super) const PREFERENCE_APPLIED: HeaderName = HeaderName::from_static("preference-applied");

/// The job; its place in the queue is not a column and is given where it is known.
pub(super) fn represent(job: &Job, queue_position: Option<u64>) -> Value {
    let url = url(job);
    let time = |time: Option<i64>| time.map(rfc3339);
    let mut document = json!({
        "id": job.id,
        "status": job.status,
        "phase": job.phase,
        "progress": job.progress,
        "eta_seconds": job.eta_seconds,
        "queue_position": queue_position,
        "attempt": job.attempt,
        "failures": job.failures,
        "cancel_requested": job.cancel_requested,
        "cloud_id": job.cloud_id,
        "preset": job.preset,
        "settings": job.settings,
        "labels": job.labels,
        "source": job.source,
        "derived_from": job.derived_from,
        "evaluations": job.evaluations,
        "loss": job.loss,
        "last_event_id": job.events,
        "created_at": rfc3339(job.created_at),
        "started_at": time(job.started_at),
        "finished_at": time(job.finished_at),
        "error": job.error.as_ref().map(problem_of),
        "links": {
            "self": url,
            "cancel": format!("{url}/cancel"),
            "retry": format!("{url}/retry"),
            "events": format!("{url}/events"),
            "metrics": format!("{url}/metrics"),
            "gradients": format!("{url}/gradients"),
            "snapshots": format!("{url}/snapshots"),
            "mesh": format!("{url}/mesh"),
            "report": format!("{url}/report"),
            "model": format!("{url}/model"),
            "field": format!("{url}/field"),
        },
    });
    if let Some(document) = document.as_object_mut() {
        document.extend(assessment::members(job.report.as_ref()));
    }
    if job
        .report
        .as_ref()
        .is_some_and(|report| report["grid"].is_object())
    {
        document["links"]["mask"] = format!("{url}/mask.nii.gz").into();
    }
    if !job.cloud_erased {
        document["links"]["cloud"] = format!("/v1/clouds/{}", job.cloud_id).into();
    }
    document
}

/// Address of a job.
pub(super) fn url(job: &Job) -> String {
    format!("/v1/jobs/{}", job.id)
}

/// The answer that shows a job, with `Location`, `ETag` and, until it ends, `Retry-After`.
pub(super) fn answer(status: StatusCode, job: &Job, queue_position: Option<u64>) -> Response {
    let body = represent(job, queue_position);
    let tag = etag(&body);
    let mut response = (status, Json(body)).into_response();
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
pub(super) fn poll(
    request: &HeaderMap,
    job: &Job,
    queue_position: Option<u64>,
) -> Result<Response> {
    let mut response = answer(StatusCode::OK, job, queue_position);
    response.headers_mut().remove(LOCATION);
    let tag = response.headers().get(ETAG).cloned();
    let tag = tag.ok_or_else(|| ApiError::internal("a job has no ETag"))?;
    if none_match(request, tag.to_str().unwrap_or_default()) {
        *response.status_mut() = StatusCode::NOT_MODIFIED;
        *response.body_mut() = axum::body::Body::empty();
        response
            .headers_mut()
            .remove(axum::http::header::CONTENT_TYPE);
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
fn etag(body: &Value) -> String {
    let hash = Sha256::digest(body.to_string().as_bytes());
    format!("W/\"{}\"", hex(&hash[..16]))
}
