//! The outermost layer: request id, log span and line, metrics, and panics turned into problems.

use std::any::Any;
use std::panic::AssertUnwindSafe;
use std::time::Instant;

use axum::body::Body;
use axum::extract::{MatchedPath, Request, State};
use axum::http::header::{RANGE, STRICT_TRANSPORT_SECURITY};
use axum::http::{HeaderValue, Method};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use futures_util::FutureExt;
use tracing::Instrument;

use crate::http::AppState;
use crate::http::door::client::Client;
use crate::http::wire::error::{ApiError, Code};
use crate::http::wire::request_id::{self, REQUEST_ID};

/// What browsers are told over TLS: to come over it alone, for a year.
const HSTS: &str = "max-age=31536000";

/// The layer. It logs no file names, no bodies and no queries, which may contain labels.
pub(in crate::http) async fn observe(
    State(app): State<AppState>,
    mut request: Request,
    next: Next,
) -> Response {
    let started = Instant::now();
    let id = request_id::of(&request);
    let method = known(request.method());
    if method == "HEAD" {
        // Ranges are for GET (RFC 9110 section 14.2).
        request.headers_mut().remove(RANGE);
    }
    let route = request
        .extensions()
        .get::<MatchedPath>()
        .map_or("unmatched", MatchedPath::as_str)
        .to_owned();
    let traceparent = request.headers().get("traceparent");
    // The query is left out because it may contain labels.
    let path = request.uri().path();
    let path = if route == "unmatched" { "" } else { path }.to_owned();
    let client = request.extensions().get::<Client>().map(|client| client.0);
    let span = tracing::info_span!(
        "request",
        http.request.id = id,
        http.method = method,
        http.route = route,
        url.path = path,
        client.address = client.map(tracing::field::display),
        trace.parent = traceparent.and_then(|parent| parent.to_str().ok()),
    );
    let handled = async {
        let answered = AssertUnwindSafe(next.run(request)).catch_unwind().await;
        answered.unwrap_or_else(|panic| panicked(&*panic))
    };
    let handled = request_id::within(id.clone(), handled);
    let mut response = handled.instrument(span.clone()).await;
    let _entered = span.enter();
    if let Some(code) = response.extensions_mut().remove::<Code>() {
        if code == Code::DatabaseBusy {
            app.gauges.database_busy();
        }
        if method == "HEAD" {
            *response.body_mut() = Body::empty();
        }
    }
    if let Ok(value) = HeaderValue::from_str(&id) {
        response.headers_mut().insert(REQUEST_ID, value);
    }
    if app.config.tls_cert.is_some() {
        let headers = response.headers_mut();
        headers.insert(STRICT_TRANSPORT_SECURITY, HeaderValue::from_static(HSTS));
    }
    let status = response.status().as_u16();
    let seconds = started.elapsed().as_secs_f64();
    app.telemetry.answered(method, &route, status, seconds);
    // Probes come every few seconds and would hide the rest.
    if matches!(path.as_str(), "/livez" | "/readyz" | "/metrics") {
        tracing::debug!(http.status = status, duration_seconds = seconds, "answered");
    } else {
        tracing::info!(http.status = status, duration_seconds = seconds, "answered");
    }
    response
}

/// The answer of a handler that panicked.
fn panicked(panic: &(dyn Any + Send)) -> Response {
    let message = panic
        .downcast_ref::<&str>()
        .copied()
        .or_else(|| panic.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("no message");
    ApiError::internal(format_args!("a handler panicked: {message}")).into_response()
}

/// Methods are labels of a metric: a client must not be able to invent series.
fn known(method: &Method) -> &'static str {
    match *method {
        Method::GET => "GET",
        Method::HEAD => "HEAD",
        Method::POST => "POST",
        Method::DELETE => "DELETE",
        Method::PUT => "PUT",
        Method::PATCH => "PATCH",
        Method::OPTIONS => "OPTIONS",
        _ => "other",
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;
    use tokio_util::sync::CancellationToken;
    use tower::ServiceExt;

    use super::*;
    use crate::config::Config;
    use crate::http::App;
    use crate::jobs::Workers;
    use crate::jobs::{Options, Store};

    #[derive(Parser)]
    struct Flags {
        #[command(flatten)]
        config: Config,
    }

    async fn breaks() -> axum::http::StatusCode {
        panic!("secret")
    }

    #[tokio::test]
    async fn a_panic_becomes_a_problem_that_tells_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path(), Options::default())
            .await
            .unwrap();
        let (_, workers) = tokio::sync::watch::channel(Workers::default());
        let config = Flags::parse_from(["t"]).config;
        let app = App::new(
            store,
            config,
            workers,
            CancellationToken::new(),
            "meshway".into(),
        );
        let router = axum::Router::new()
            .route("/", axum::routing::get(breaks))
            .layer(axum::middleware::from_fn_with_state(app, observe));
        let request = Request::get("/").body(Body::empty()).unwrap();
        let response = router.oneshot(request).await.unwrap();
        assert_eq!(response.status(), 500);
        let id = response.headers()[REQUEST_ID].clone();
        let body = axum::body::to_bytes(response.into_body(), 10_000)
            .await
            .unwrap();
        let problem: serde_json::Value = serde_json::from_slice(&body).unwrap();
        assert_eq!(problem["code"], "internal");
        assert_eq!(problem["request_id"], id.to_str().unwrap());
        assert!(!problem.to_string().contains("secret"));
    }
}
