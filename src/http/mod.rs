//! The door: what a client sees of the service.
//!
//! [`operations`] is the whole API as one table, held against `openapi.yaml` by a test; a resource
//! has a file. Handlers know neither SQL nor tensors: they read rows through [`crate::jobs`] and
//! write JSON. Everything that can go wrong leaves as a problem of `error`.

mod accept;
mod bodies;
mod cloud_files;
mod clouds;
mod disk;
mod docs;
mod download;
pub mod error;
mod events;
mod extract;
mod feed;
mod field;
mod gauges;
mod idempotency;
pub mod inspect;
mod job_json;
mod job_request;
mod jobs;
mod mesh_cache;
mod meshes;
mod observe;
mod origin;
pub mod own_files;
mod page;
mod places;
mod rendition;
mod results;
mod server;
mod spool;
mod state;
mod system;
mod telemetry;
mod time;
mod training;
mod upload;
mod wait;

use std::time::Duration;

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::handler::Handler;
use axum::http::Method;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, Uri, header};
use axum::middleware;
use axum::response::{IntoResponse, Response};
use axum::routing::{MethodFilter, MethodRouter, on};

use crate::config::Config;
use error::{ApiError, Code};
use tower::util::option_layer;
use tower_http::compression::CompressionLayer;
use tower_http::compression::predicate::{Predicate, SizeAbove};
use tower_http::cors::{AllowHeaders, CorsLayer};

pub use disk::{Disk, Space};
pub use docs::OPENAPI;
pub use server::serve;
pub use state::{App, AppState};

pub use telemetry::Telemetry;

/// How long a browser may remember what a page of another origin may ask.
const PREFLIGHT: Duration = Duration::from_mins(10);

/// What such a page may read of the header of an answer.
const EXPOSED: [&str; 10] = [
    "content-disposition",
    "content-range",
    "etag",
    "idempotency-replayed",
    "link",
    "location",
    "meshway-verdict",
    "preference-applied",
    "retry-after",
    "x-request-id",
];

/// Least bytes of an answer that is compressed.
const LEAST_COMPRESSED: u64 = 1_024;

/// Bytes that a form may have beyond its file: names, boundaries, the `job` part.
const FORM_OVERHEAD: usize = 1 << 20;

/// One row of the API: a method, a path, and who answers.
struct Operation {
    method: Method,
    path: &'static str,
    handler: MethodRouter<AppState>,
}

/// Clouds and jobs: what is put in.
fn intake() -> Vec<Operation> {
    vec![
        post("/v1/clouds", clouds::create),
        get("/v1/clouds", clouds::list),
        get("/v1/clouds/{id}", clouds::show),
        delete("/v1/clouds/{id}", clouds::erase),
        get("/v1/clouds/{id}/content", clouds::content),
        post("/v1/jobs", jobs::create),
        get("/v1/jobs", jobs::list),
        get("/v1/jobs/{id}", jobs::show),
        delete("/v1/jobs/{id}", jobs::erase),
        post("/v1/jobs/{id}/cancel", jobs::cancel),
        post("/v1/jobs/{id}/retry", jobs::retry),
    ]
}

/// Events, series, meshes and the system: what comes out.
fn results() -> Vec<Operation> {
    vec![
        get("/v1/events", events::of_all),
        get("/v1/jobs/{id}/events", events::of_job),
        get("/v1/jobs/{id}/metrics", training::metrics),
        get("/v1/jobs/{id}/gradients", training::gradients),
        get("/v1/jobs/{id}/mesh", meshes::negotiated),
        get("/v1/jobs/{id}/mesh.{format}", meshes::result),
        get("/v1/jobs/{id}/mask.nii.gz", meshes::mask),
        get("/v1/jobs/{id}/snapshots", meshes::snapshots),
        get("/v1/jobs/{id}/snapshots/{file}", meshes::snapshot),
        get("/v1/jobs/{id}/report", meshes::report),
        get("/v1/jobs/{id}/model", meshes::model),
        post("/v1/jobs/{id}/field", field::evaluate),
        get("/v1/presets", system::presets),
        get("/v1/limits", system::limits),
        get("/v1/version", system::version),
        get("/livez", system::livez),
        get("/readyz", system::readyz),
        get("/metrics", system::metrics),
        get("/openapi.yaml", system::openapi),
        get("/docs", system::reference),
        get("/", system::start),
    ]
}

/// Methods and paths of all operations, in the order of the table.
pub fn operations() -> Vec<(String, &'static str)> {
    let all = intake().into_iter().chain(results());
    all.map(|row| (row.method.to_string(), row.path)).collect()
}

/// The API over a state, ready to be served or called by a test.
pub fn router(state: AppState) -> Router {
    let cors = option_layer(cors(&state.config));
    let compression = CompressionLayer::new().compress_when(text());
    handlers(state.clone())
        .layer(compression)
        .layer(middleware::from_fn_with_state(state.clone(), origin::guard))
        .layer(cors)
        .layer(middleware::from_fn_with_state(state, observe::observe))
}

/// Pages of the origins that the operator names may read the answers; without any there is no
/// header of CORS at all.
fn cors(config: &Config) -> Option<CorsLayer> {
    let origins: Vec<HeaderValue> = config
        .origins()
        .filter_map(|origin| HeaderValue::from_str(origin).ok())
        .collect();
    let layer = CorsLayer::new()
        .allow_methods([Method::GET, Method::HEAD, Method::POST, Method::DELETE])
        .allow_headers(AllowHeaders::mirror_request())
        .expose_headers(EXPOSED.map(HeaderName::from_static))
        .max_age(PREFLIGHT);
    (!origins.is_empty()).then(|| layer.allow_origin(origins))
}

/// What is compressed: text that is worth it. Meshes and clouds are not: their ranges and tags are
/// those of their bytes.
fn text() -> impl Predicate {
    SizeAbove::new(LEAST_COMPRESSED).and(
        |_: StatusCode, _: axum::http::Version, headers: &HeaderMap, _: &axum::http::Extensions| {
            let kind = headers.get(header::CONTENT_TYPE);
            let kind = kind.and_then(|kind| kind.to_str().ok()).unwrap_or_default();
            let essence = kind.split(';').next().unwrap_or_default();
            matches!(
                essence,
                "application/json"
                    | "application/yaml"
                    | "application/x-ndjson"
                    | "text/csv"
                    | "text/html"
                    | "text/plain"
                    | "application/openmetrics-text"
            )
        },
    )
}

/// The same without what is around every request.
fn handlers(state: AppState) -> Router {
    let routes = intake().into_iter().chain(results());
    // Bodies are held to their limits where they are read; this one is for forms, which axum reads.
    let form_limit = state.config.body_limit_bytes() as usize + FORM_OVERHEAD;
    routes
        .fold(Router::new(), |router, row| {
            router.route(row.path, row.handler)
        })
        .fallback(nothing_here)
        .method_not_allowed_fallback(wrong_method)
        .layer(DefaultBodyLimit::max(form_limit))
        .with_state(state)
}

async fn nothing_here(uri: Uri) -> ApiError {
    let length = uri.path().len().min(200);
    let path = uri.path().get(..length).unwrap_or_default();
    ApiError::new(
        Code::NotFound,
        format!("there is nothing at {path}; /openapi.yaml lists what there is"),
    )
}

async fn wrong_method(method: Method) -> Response {
    if method == Method::OPTIONS {
        return StatusCode::NO_CONTENT.into_response();
    }
    let detail = format!("{method} is not for this resource; Allow lists what is");
    ApiError::new(Code::MethodNotAllowed, detail).into_response()
}

fn get<H: Handler<T, AppState>, T: 'static>(path: &'static str, handler: H) -> Operation {
    operation(Method::GET, MethodFilter::GET, path, handler)
}

fn post<H: Handler<T, AppState>, T: 'static>(path: &'static str, handler: H) -> Operation {
    operation(Method::POST, MethodFilter::POST, path, handler)
}

fn delete<H: Handler<T, AppState>, T: 'static>(path: &'static str, handler: H) -> Operation {
    operation(Method::DELETE, MethodFilter::DELETE, path, handler)
}

fn operation<H: Handler<T, AppState>, T: 'static>(
    method: Method,
    filter: MethodFilter,
    path: &'static str,
    handler: H,
) -> Operation {
    Operation {
        method,
        path,
        handler: on(filter, handler),
    }
}
