//! What may be asked for, and how the service is.

use std::time::Duration;

use axum::Json;
use axum::extract::State;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::http::{HeaderName, HeaderValue};
use axum::response::{Html, IntoResponse, Response};
use serde_json::{Map, Value, json};

use super::error::{ApiError, Code, Result};
use super::extract::Query;
use super::time::rfc3339;
use super::{AppState, docs, field};
use crate::reconstruction::Preset;
use crate::reconstruction::settings::BOUNDS;

/// Time after which the database counts as not writable: probes give up after some seconds.
const PATIENCE: Duration = Duration::from_secs(2);

/// GET /v1/presets
pub(super) async fn presets(query: Query) -> Result<Response> {
    query.finish()?;
    let items: Vec<Value> = Preset::ALL
        .iter()
        .map(|preset| {
            json!({
                "name": preset.name(),
                "default": *preset == Preset::default(),
                "settings": preset.settings(),
            })
        })
        .collect();
    Ok(Json(json!({ "items": items })).into_response())
}

/// GET /v1/limits
pub(super) async fn limits(State(app): State<AppState>, query: Query) -> Result<Response> {
    query.finish()?;
    let config = &app.config;
    let bounds: Map<String, Value> = BOUNDS
        .iter()
        .map(|bound| {
            let range = json!({"minimum": bound.min, "maximum": bound.max});
            (bound.pointer.to_owned(), range)
        })
        .collect();
    Ok(Json(json!({
        "body_bytes": config.body_limit_bytes(),
        "points": config.max_points,
        "queued_jobs": config.queue_limit,
        "job_seconds": config.job_time_limit_seconds,
        "events_per_job": config.max_events,
        "metrics_per_job": config.max_metrics,
        "event_streams": config.max_streams,
        "connections": config.max_connections,
        "upload_idle_seconds": config.upload_timeout_seconds,
        "field_points": field::MAX_POINTS,
        "disk_reserve_bytes": app.disk.space().map_or(0, |s| app.disk.reserve_bytes(s.total_bytes)),
        "worker_memory_bytes": config.worker_memory_bytes(),
        "settings": bounds,
    }))
    .into_response())
}

/// GET /v1/version
pub(super) async fn version(State(app): State<AppState>, query: Query) -> Result<Response> {
    query.finish()?;
    Ok(Json(json!({
        "version": env!("CARGO_PKG_VERSION"),
        "api": "v1",
        "started_at": rfc3339(app.started_at),
    }))
    .into_response())
}

/// GET /livez: the process answers.
pub(super) async fn livez() -> Response {
    uncached(Json(json!({"status": "ok"})).into_response())
}

/// GET /readyz: new work would be taken and done.
pub(super) async fn readyz(State(app): State<AppState>) -> Response {
    let checks = checks(&app).await;
    let failed: Vec<&str> = checks
        .iter()
        .filter(|(_, found)| found.is_err())
        .map(|(name, _)| *name)
        .collect();
    let members: Map<String, Value> = checks
        .iter()
        .map(|(name, found)| {
            let detail = found.as_ref().err();
            let found = json!({"ok": found.is_ok(), "detail": detail});
            ((*name).to_owned(), found)
        })
        .collect();
    if failed.is_empty() {
        return uncached(Json(json!({"status": "ready", "checks": members})).into_response());
    }
    let detail = format!("not ready: {}", failed.join(", "));
    let problem = ApiError::new(Code::NotReady, detail).with("checks", Value::Object(members));
    uncached(problem.into_response())
}

/// Every check, with what is wrong.
async fn checks(app: &AppState) -> [(&'static str, std::result::Result<(), String>); 4] {
    let written = tokio::time::timeout(PATIENCE, app.store.check_writable()).await;
    let database = match written {
        Ok(Ok(())) => Ok(()),
        Ok(Err(error)) => Err(error.code().to_owned()),
        Err(_) => Err(format!("no answer in {} s", PATIENCE.as_secs())),
    };
    let disk = app.disk.check(0).map_err(|error| {
        let document = error.document(None);
        document["detail"].as_str().unwrap_or_default().to_owned()
    });
    let workers = *app.workers.borrow();
    let workers = match workers.busy + workers.idle {
        0 => Err("no worker runs".to_owned()),
        _ => Ok(()),
    };
    let draining = if app.shutdown.is_cancelled() {
        Err("the service is about to stop".to_owned())
    } else {
        Ok(())
    };
    [
        ("database", database),
        ("disk", disk),
        ("workers", workers),
        ("not_draining", draining),
    ]
}

/// GET /metrics
pub(super) async fn metrics(State(app): State<AppState>) -> Result<Response> {
    app.gauges.refresh(&app).await?;
    let mut text = String::new();
    let registry = app.telemetry.registry.lock();
    let registry = registry.unwrap_or_else(std::sync::PoisonError::into_inner);
    prometheus_client::encoding::text::encode(&mut text, &registry).map_err(ApiError::internal)?;
    let media_type = "application/openmetrics-text; version=1.0.0; charset=utf-8";
    let media_type = HeaderValue::from_static(media_type);
    Ok(uncached(
        ([(CONTENT_TYPE, media_type)], text).into_response(),
    ))
}

/// GET /openapi.yaml
pub(super) async fn openapi() -> Response {
    let media_type = HeaderValue::from_static("application/yaml");
    ([(CONTENT_TYPE, media_type)], docs::OPENAPI).into_response()
}

/// GET /docs
pub(super) async fn reference() -> Response {
    page(docs::reference())
}

/// GET /
pub(super) async fn start() -> Response {
    page(docs::start())
}

/// Pages of ours load nothing from elsewhere and run nothing.
fn page(html: &'static str) -> Response {
    let policy = HeaderValue::from_static("default-src 'none'; style-src 'unsafe-inline'");
    let name = HeaderName::from_static("content-security-policy");
    ([(name, policy)], Html(html)).into_response()
}

fn uncached(mut response: Response) -> Response {
    let no_store = HeaderValue::from_static("no-store");
    response.headers_mut().insert(CACHE_CONTROL, no_store);
    response
}
