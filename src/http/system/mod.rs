//! Presets, limits, version, health, metrics and documents.

pub(in crate::http) mod docs;
pub(in crate::http) mod web;
pub(in crate::http) mod workers;

use std::time::Duration;

use axum::Json;
use axum::extract::State;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::http::{HeaderMap, HeaderName, HeaderValue};
use axum::response::{Html, IntoResponse, Response};
use serde_json::json;

use crate::http::AppState;
use crate::http::api;
use crate::http::door::head;
use crate::http::resources::events;
use crate::http::resources::field;
use crate::http::resources::jobs::request::{MAX_LABEL_LENGTH, MAX_LABELS, PRIORITIES};
use crate::http::resources::{batches, uploads};
use crate::http::telemetry::Telemetry;
use crate::http::upload::bodies::{JSON_LIMIT, LEAST_RATE};
use crate::http::wire::accept::preferred;
use crate::http::wire::error::{ApiError, Code, Result};
use crate::http::wire::extract::{MAX_WAIT_SECONDS, NoQuery};
use crate::http::wire::idempotency;
use crate::http::wire::page;
use crate::intake::MAX_EXPANSION;
use crate::reconstruction::Preset;
use crate::reconstruction::cloud::{MAX_HEADER_BYTES, MIN_POINTS};
use crate::reconstruction::settings::{BOUNDS, Bound, MAX_CHOSEN_EVALUATIONS};
use crate::reconstruction::surface::MAX_TRIANGLES;

/// Time after which the database counts as not writable. Probes give up after some seconds.
const PATIENCE: Duration = Duration::from_secs(2);

/// GET /v1/presets
pub(in crate::http) async fn presets(_: NoQuery) -> Response {
    let item = |preset: Preset| api::PresetItem {
        name: preset.name(),
        default: preset == Preset::default(),
        settings: preset.settings(),
    };
    let items = Preset::ALL.into_iter().map(item).collect();
    Json(api::Items { items }).into_response()
}

/// GET /v1/limits: each from the place that enforces it.
pub(in crate::http) async fn limits(State(app): State<AppState>, _: NoQuery) -> Response {
    let config = &app.config;
    let range = |bound: &Bound| {
        let range = api::Range {
            minimum: bound.min,
            maximum: bound.max,
        };
        (bound.pointer, range)
    };
    Json(api::Limits {
        connections: config.max_connections,
        header_bytes: head::MAX_BYTES,
        header_seconds: config.header_timeout_seconds,
        body_bytes: config.body_limit_bytes(),
        upload_idle_seconds: config.upload_timeout_seconds,
        upload_bytes_per_second: LEAST_RATE,
        download_idle_seconds: config.download_timeout_seconds,
        decompression_ratio: MAX_EXPANSION,
        cloud_header_bytes: MAX_HEADER_BYTES,
        points: config.max_points,
        least_points: MIN_POINTS,
        mesh_triangles: MAX_TRIANGLES,
        settings_bytes: JSON_LIMIT,
        labels: MAX_LABELS,
        label_characters: MAX_LABEL_LENGTH,
        priority: api::Range {
            minimum: *PRIORITIES.start() as f64,
            maximum: *PRIORITIES.end() as f64,
        },
        chosen_evaluations: MAX_CHOSEN_EVALUATIONS,
        grid_bytes: config.work.job_memory_bytes(),
        training_bytes: config.work.job_memory_bytes(),
        worker_memory_bytes: config.work.memory_bytes(),
        queued_jobs: config.queue_limit,
        job_seconds: config.work.job_time_limit_seconds,
        wait_seconds: MAX_WAIT_SECONDS,
        idempotency_key_characters: idempotency::MAX_KEY_LENGTH,
        idempotency_seconds: idempotency::KEPT_MS / 1_000,
        upload_keep_seconds: config.upload_keep_ms() / 1_000,
        batch_jobs: batches::request::MOST_JOBS,
        open_uploads: uploads::MOST_OPEN,
        page_items: page::MAX_LIMIT,
        event_page_items: events::MAX_LIMIT,
        events_per_job: config.work.max_events,
        metrics_per_job: config.work.max_metrics,
        event_streams: config.max_streams,
        event_streams_per_client: config.streams_per_client(),
        field_bytes: field::MAX_BODY_BYTES,
        field_points: field::MAX_POINTS,
        cloud_ttl: config.cloud_ttl,
        job_ttl: config.job_ttl,
        audit_days: config.audit_keep_days,
        disk_reserve_bytes: app
            .disk
            .space()
            .map_or(0, |s| app.disk.reserve_bytes(s.total_bytes)),
        settings: BOUNDS.iter().map(range).collect(),
    })
    .into_response()
}

/// GET /v1/version
pub(in crate::http) async fn version(State(app): State<AppState>, _: NoQuery) -> Response {
    Json(api::Version {
        version: env!("CARGO_PKG_VERSION"),
        api: "v1",
        started_at: api::Time(app.started_at),
    })
    .into_response()
}

/// GET /livez: the process answers.
pub(in crate::http) async fn livez() -> Response {
    uncached(Json(api::Live { status: "ok" }).into_response())
}

/// GET /readyz: new work would be taken and done.
pub(in crate::http) async fn readyz(State(app): State<AppState>) -> Response {
    let checks = checks(&app).await;
    let failed: Vec<&str> = checks
        .iter()
        .filter(|(_, found)| found.is_err())
        .map(|(name, _)| *name)
        .collect();
    let detail = format!("not ready: {}", failed.join(", "));
    let is_ready = failed.is_empty();
    let checks = checks.into_iter().map(|(name, found)| {
        let check = api::Check {
            ok: found.is_ok(),
            detail: found.err(),
        };
        (name, check)
    });
    let ready = api::Ready {
        status: "ready",
        checks: checks.collect(),
    };
    if is_ready {
        return uncached(Json(ready).into_response());
    }
    let problem = ApiError::new(Code::NotReady, detail).with("checks", json!(ready.checks));
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
    let disk = app.disk.check(0).map_err(|shortage| shortage.to_string());
    let workers = *app.workers.borrow();
    // Without any of its own, others work, and may be started only when there is something to do.
    let workers = match workers.busy + workers.idle {
        0 if app.config.workers > 0 => Err("no worker runs".to_owned()),
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
pub(in crate::http) async fn metrics(
    State(app): State<AppState>,
    headers: HeaderMap,
) -> Result<Response> {
    app.gauges.refresh(&app).await?;
    scraped(&app.telemetry, &headers)
}

/// What Prometheus asks for, in the format that it asks for.
fn scraped(telemetry: &Telemetry, headers: &HeaderMap) -> Result<Response> {
    telemetry.refresh();
    let mut text = String::new();
    let registry = telemetry.registry.lock();
    let registry = registry.unwrap_or_else(std::sync::PoisonError::into_inner);
    prometheus_client::encoding::text::encode(&mut text, &registry).map_err(ApiError::internal)?;
    let offers = [
        ("application/openmetrics-text", true),
        ("text/plain", false),
    ];
    let open = preferred(headers, &offers).unwrap_or(true);
    let media_type = HeaderValue::from_static(if open {
        "application/openmetrics-text; version=1.0.0; charset=utf-8"
    } else {
        text = plain_metrics(&text);
        "text/plain; version=0.0.4; charset=utf-8"
    });
    Ok(uncached(
        ([(CONTENT_TYPE, media_type)], text).into_response(),
    ))
}

/// Converts `OpenMetrics` to the older Prometheus text format. There, the names of counters and infos
/// have their suffix in comments too, and there is no type `info`, no unit and no end mark.
fn plain_metrics(open: &str) -> String {
    let mut plain = String::with_capacity(open.len());
    let mut help = None;
    for line in open.lines() {
        let words: Vec<&str> = line.splitn(4, ' ').collect();
        match words.as_slice() {
            // Comes before TYPE, which decides on the ending.
            ["#", "HELP", name, text] => help = Some((*name, *text)),
            ["#", "TYPE", name, kind] => {
                let (ending, kind) = match *kind {
                    "counter" => ("_total", "counter"),
                    "info" => ("_info", "gauge"),
                    kind => ("", kind),
                };
                if let Some((_, text)) = help.take().filter(|(of, _)| of == name) {
                    plain.extend(["# HELP ", name, ending, " ", text, "\n"]);
                }
                plain.extend(["# TYPE ", name, ending, " ", kind, "\n"]);
            }
            ["#", ..] => {}
            _ => {
                plain += line;
                plain.push('\n');
            }
        }
    }
    plain
}

/// GET /openapi.yaml
pub(in crate::http) async fn openapi() -> Response {
    let media_type = HeaderValue::from_static("application/yaml");
    ([(CONTENT_TYPE, media_type)], docs::OPENAPI).into_response()
}

/// GET /docs
pub(in crate::http) async fn reference() -> Response {
    page(docs::reference())
}

/// Our pages load nothing from elsewhere and run no scripts.
pub(super) fn page(html: &'static str) -> Response {
    let policy = HeaderValue::from_static("default-src 'none'; style-src 'unsafe-inline'");
    let name = HeaderName::from_static("content-security-policy");
    ([(name, policy)], Html(html)).into_response()
}

fn uncached(mut response: Response) -> Response {
    let no_store = HeaderValue::from_static("no-store");
    response.headers_mut().insert(CACHE_CONTROL, no_store);
    response
}
