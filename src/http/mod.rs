//! The HTTP API: what a client sees of the service.
//!
//! [`operations`] is the whole API as one table; a test compares it with `openapi.yaml`. Each
//! resource has a file. Handlers know neither SQL nor tensors: they read rows through
//! [`crate::jobs`] and write JSON. Every error leaves as a problem of [`error`].

mod api;
mod door;
mod follow;
mod resources;
mod state;
mod system;
mod telemetry;
mod upload;
mod wire;

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
use crate::identity::Scope;
use door::{base, keys, observe, origin, tags};
use resources::{
    batches, clouds, events, field, jobs, meshes, retention, series, session, trust, uploads,
    webhooks,
};
use tower::util::option_layer;
use tower_http::compression::CompressionLayer;
use tower_http::compression::predicate::{Predicate, SizeAbove};
use tower_http::cors::{AllowHeaders, CorsLayer};
use wire::error::{ApiError, Code};

pub use door::server::{serve, serve_tls};
pub use door::tls::{Tls, TlsError, TlsFiles};
pub use follow::follow;
pub use state::{App, AppState};
pub use system::docs::OPENAPI;
pub use system::workers::tell_of_workers;
pub use telemetry::Telemetry;
pub use wire::error;

/// How often it is looked for what has expired.
const SWEEP_EVERY: Duration = Duration::from_mins(1);

/// How long a browser may cache the answer to a preflight request.
const PREFLIGHT: Duration = Duration::from_mins(10);

/// Response headers that such a page may read.
const EXPOSED: [&str; 21] = [
    "content-disposition",
    "content-range",
    "etag",
    "idempotency-replayed",
    "link",
    "location",
    "meshway-origin",
    "meshway-verdict",
    "preference-applied",
    "ratelimit",
    "ratelimit-policy",
    "retry-after",
    "tus-resumable",
    "upload-complete",
    "upload-defer-length",
    "upload-expires",
    "upload-length",
    "upload-limit",
    "upload-offset",
    "www-authenticate",
    "x-request-id",
];

/// Least bytes of an answer that is compressed.
const LEAST_COMPRESSED: u64 = 1_024;

/// Bytes that a form may have beyond its file: names, boundaries, the `job` part.
const FORM_OVERHEAD: usize = 1 << 20;

/// One row of the API: a method, a path, what it needs, and who answers.
struct Operation {
    method: Method,
    path: &'static str,
    scope: Option<Scope>,
    handler: MethodRouter<AppState>,
}

/// What an operation needs that anybody may ask for.
const OPEN: Option<Scope> = None;
const READ: Option<Scope> = Some(Scope::Read);
const WRITE: Option<Scope> = Some(Scope::Write);
const DELETE: Option<Scope> = Some(Scope::Delete);
const AUDIT: Option<Scope> = Some(Scope::Audit);
const ADMIN: Option<Scope> = Some(Scope::Admin);

/// Clouds and jobs: what is put in.
fn intake() -> Vec<Operation> {
    vec![
        post("/v1/clouds", WRITE, clouds::create),
        get("/v1/clouds", READ, clouds::list),
        get("/v1/clouds/{id}", READ, clouds::show),
        patch("/v1/clouds/{id}", DELETE, clouds::keep),
        delete("/v1/clouds/{id}", DELETE, clouds::erase),
        get("/v1/clouds/{id}/content", READ, clouds::content),
        get("/v1/clouds/{id}/points", READ, clouds::points::subset),
        options("/v1/uploads", OPEN, uploads::options),
        post("/v1/uploads", WRITE, uploads::create),
        get("/v1/uploads/{id}", WRITE, uploads::show),
        patch("/v1/uploads/{id}", WRITE, uploads::append),
        delete("/v1/uploads/{id}", WRITE, uploads::erase),
        post("/v1/jobs", WRITE, jobs::create),
        get("/v1/jobs", READ, jobs::list),
        delete("/v1/jobs", DELETE, jobs::erase::of_label),
        post("/v1/jobs/cancel", WRITE, jobs::cancel::of_label),
        get("/v1/jobs/{id}", READ, jobs::show),
        patch("/v1/jobs/{id}", DELETE, jobs::keep),
        delete("/v1/jobs/{id}", DELETE, jobs::erase::one),
        post("/v1/jobs/{id}/cancel", WRITE, jobs::cancel),
        post("/v1/jobs/{id}/retry", WRITE, jobs::retry),
        post("/v1/batches", WRITE, batches::create),
        get("/v1/batches", READ, batches::list),
        get("/v1/batches/{id}", READ, batches::show),
        delete("/v1/batches/{id}", DELETE, batches::erase),
        post("/v1/batches/{id}/cancel", WRITE, batches::cancel),
    ]
}

/// Events, series, meshes and the system: what comes out.
fn results() -> Vec<Operation> {
    vec![
        get("/v1/events", READ, events::of_all),
        get("/v1/jobs/{id}/events", READ, events::of_job),
        get("/v1/batches/{id}/events", READ, events::of_batch),
        get("/v1/jobs/{id}/metrics", READ, series::metrics),
        get("/v1/jobs/{id}/gradients", READ, series::gradients),
        get("/v1/jobs/{id}/mesh", READ, meshes::negotiated),
        get("/v1/jobs/{id}/mesh.{format}", READ, meshes::result),
        get("/v1/jobs/{id}/mask.nii.gz", READ, meshes::mask),
        get("/v1/jobs/{id}/snapshots", READ, meshes::snapshots),
        get("/v1/jobs/{id}/snapshots/{file}", READ, meshes::snapshot),
        get("/v1/jobs/{id}/report", READ, meshes::report),
        get("/v1/jobs/{id}/model", READ, meshes::model),
        post("/v1/jobs/{id}/field", READ, field::evaluate),
        get("/v1/presets", READ, system::presets),
        get("/v1/limits", READ, system::limits),
        get("/v1/version", READ, system::version),
        get("/v1/keys", ADMIN, trust::keys),
        post("/v1/keys", ADMIN, trust::create_key),
        delete("/v1/keys/{id}", ADMIN, trust::delete_key),
        get("/v1/audit", AUDIT, trust::audit),
        get("/v1/webhooks", ADMIN, webhooks::list),
        post("/v1/webhooks", ADMIN, webhooks::create),
        get("/v1/webhooks/{id}", ADMIN, webhooks::show),
        patch("/v1/webhooks/{id}", ADMIN, webhooks::change),
        delete("/v1/webhooks/{id}", ADMIN, webhooks::erase),
        post("/v1/webhooks/{id}/secret", ADMIN, webhooks::renew_secret),
        post("/v1/webhooks/{id}/test", ADMIN, webhooks::test),
        get("/v1/webhooks/{id}/deliveries", ADMIN, webhooks::deliveries),
        get("/v1/deliveries/{id}", ADMIN, webhooks::delivery),
        post("/v1/deliveries/{id}/redeliver", ADMIN, webhooks::redeliver),
        get("/v1/session", READ, session::show),
        post("/v1/session", READ, session::sign_in),
        delete("/v1/session", OPEN, session::sign_out),
        get("/livez", OPEN, system::livez),
        get("/readyz", OPEN, system::readyz),
        get("/metrics", ADMIN, system::metrics),
        get("/openapi.yaml", OPEN, system::openapi),
        get("/docs", OPEN, system::reference),
        get("/assets/{file}", OPEN, system::web::asset),
        get("/", OPEN, system::web::start),
    ]
}

/// Methods, paths and scopes of all operations, in the order of the table; those without a scope are
/// open to all.
pub fn operations() -> Vec<(String, &'static str, Option<Scope>)> {
    let all = intake().into_iter().chain(results());
    all.map(|row| (row.method.to_string(), row.path, row.scope))
        .collect()
}

/// The API over a state, ready to be served or called by a test.
pub fn router(state: AppState) -> Router {
    let config = state.config.clone();
    let cors = option_layer(cors(&config));
    let compression = CompressionLayer::new().compress_when(text());
    let router = handlers(state.clone())
        .layer(middleware::from_fn_with_state(
            state.clone(),
            base::addresses,
        ))
        .layer(middleware::from_fn(tags::tag))
        .layer(compression)
        .layer(middleware::map_response(tags::weaken))
        .layer(middleware::from_fn_with_state(state.clone(), origin::guard))
        .layer(cors)
        .layer(middleware::from_fn_with_state(state, observe::observe));
    base::mounted(&config, router)
}

/// CORS headers for the origins that the operator allows. Without any, there are no such headers.
fn cors(config: &Config) -> Option<CorsLayer> {
    let origins: Vec<HeaderValue> = config
        .origins()
        .filter_map(|origin| HeaderValue::from_str(origin).ok())
        .collect();
    let layer = CorsLayer::new()
        .allow_methods([
            Method::GET,
            Method::HEAD,
            Method::POST,
            Method::PATCH,
            Method::DELETE,
        ])
        .allow_headers(AllowHeaders::mirror_request())
        .expose_headers(EXPOSED.map(HeaderName::from_static))
        .max_age(PREFLIGHT);
    (!origins.is_empty()).then(|| layer.allow_origin(origins))
}

/// Which answers are compressed: text of some length. Meshes and clouds are not, because their
/// ranges and tags refer to the bytes as they are.
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

/// The routes without the layers around them.
fn handlers(state: AppState) -> Router {
    let routes = intake().into_iter().chain(results());
    // Our own code limits bodies where it reads them; this limit is for forms, which axum reads.
    let form_limit = state.config.body_limit_bytes() as usize + FORM_OVERHEAD;
    routes
        .fold(Router::new(), |router, row| {
            let handler = match row.scope {
                Some(scope) => {
                    let needed = (AppState::clone(&state), scope);
                    row.handler
                        .route_layer(middleware::from_fn_with_state(needed, keys::admit))
                }
                None => row.handler,
            };
            router.route(row.path, handler)
        })
        .fallback(nothing_here)
        .method_not_allowed_fallback(wrong_method)
        .layer(DefaultBodyLimit::max(form_limit))
        .with_state(state)
}

/// Finishes what the last server left, and erases what has expired.
///
/// # Errors
/// Those of the store; what was not done is done by the next call.
pub async fn sweep(app: &AppState) -> error::Result<()> {
    uploads::settle::sweep(app).await?;
    retention::sweep(app).await
}

/// [`sweep`] again and again. Never ends.
pub async fn keep_sweeping(app: AppState) {
    loop {
        if let Err(error) = sweep(&app).await {
            let code = error.code().entry().name;
            tracing::warn!(code, "what has expired was not erased");
        }
        tokio::time::sleep(SWEEP_EVERY).await;
    }
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

fn get<H: Handler<T, AppState>, T: 'static>(
    path: &'static str,
    scope: Option<Scope>,
    handler: H,
) -> Operation {
    operation((Method::GET, MethodFilter::GET), path, scope, handler)
}

fn post<H: Handler<T, AppState>, T: 'static>(
    path: &'static str,
    scope: Option<Scope>,
    handler: H,
) -> Operation {
    operation((Method::POST, MethodFilter::POST), path, scope, handler)
}

fn patch<H: Handler<T, AppState>, T: 'static>(
    path: &'static str,
    scope: Option<Scope>,
    handler: H,
) -> Operation {
    operation((Method::PATCH, MethodFilter::PATCH), path, scope, handler)
}

fn options<H: Handler<T, AppState>, T: 'static>(
    path: &'static str,
    scope: Option<Scope>,
    handler: H,
) -> Operation {
    operation(
        (Method::OPTIONS, MethodFilter::OPTIONS),
        path,
        scope,
        handler,
    )
}

fn delete<H: Handler<T, AppState>, T: 'static>(
    path: &'static str,
    scope: Option<Scope>,
    handler: H,
) -> Operation {
    operation((Method::DELETE, MethodFilter::DELETE), path, scope, handler)
}

fn operation<H: Handler<T, AppState>, T: 'static>(
    (method, filter): (Method, MethodFilter),
    path: &'static str,
    scope: Option<Scope>,
    handler: H,
) -> Operation {
    Operation {
        method,
        path,
        scope,
        handler: on(filter, handler),
    }
}
