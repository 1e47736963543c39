//! Around every request: an id, a span, one line of log, the metrics, and no panic that leaves.

use std::panic::AssertUnwindSafe;
use std::time::Instant;

use axum::body::Body;
use axum::extract::{MatchedPath, Request, State};
use axum::http::header::RANGE;
use axum::http::{HeaderName, HeaderValue, Method};
use axum::middleware::Next;
use axum::response::Response;
use futures_util::FutureExt;
use tracing::Instrument;

use crate::http::AppState;
use crate::http::door::places::Peer;
use crate::http::wire::error::{ApiError, Code};

const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// Longest id that is taken over from a client.
const MAX_ID_LENGTH: usize = 128;

/// The id of a request: the client's if it is plain text, else a new one.
#[derive(Debug, Clone)]
pub(in crate::http) struct RequestId(pub(in crate::http) String);

impl RequestId {
    fn of(request: &Request) -> Self {
        let plain = |id: &&str| {
            (1..=MAX_ID_LENGTH).contains(&id.len()) && id.bytes().all(|b| b.is_ascii_graphic())
        };
        let given = request.headers().get(REQUEST_ID);
        let given = given.and_then(|id| id.to_str().ok()).filter(plain);
        Self(given.map_or_else(|| uuid::Uuid::now_v7().simple().to_string(), str::to_owned))
    }
}

/// The layer. Neither names of files nor bodies are logged, and no query: labels may be in it.
pub(in crate::http) async fn observe(
    State(app): State<AppState>,
    mut request: Request,
    next: Next,
) -> Response {
    let started = Instant::now();
    let id = RequestId::of(&request);
    request.extensions_mut().insert(id.clone());
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
    // Without its query: labels may be in that.
    let path = request.uri().path();
    let path = if route == "unmatched" { "" } else { path }.to_owned();
    let peer = request.extensions().get::<Peer>().map(|peer| peer.0);
    let span = tracing::info_span!(
        "request",
        http.request.id = id.0,
        http.method = method,
        http.route = route,
        url.path = path,
        client.address = peer.map(tracing::field::display),
        trace.parent = traceparent.and_then(|parent| parent.to_str().ok()),
    );
    let handled = AssertUnwindSafe(next.run(request))
        .catch_unwind()
        .instrument(span.clone())
        .await;
    let _entered = span.enter();
    let mut response = handled.unwrap_or_else(|panic| {
        let message = panic
            .downcast_ref::<&str>()
            .copied()
            .or_else(|| panic.downcast_ref::<String>().map(String::as_str))
            .unwrap_or("no message");
        axum::response::IntoResponse::into_response(ApiError::internal(format_args!(
            "a handler panicked: {message}"
        )))
    });
    if let Some(error) = response.extensions_mut().remove::<ApiError>() {
        if error.code() == Code::DatabaseBusy {
            app.gauges.database_busy();
        }
        response = complete(response, error, &id, method);
    }
    if let Ok(value) = HeaderValue::from_str(&id.0) {
        response.headers_mut().insert(REQUEST_ID, value);
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

/// The problem again, now with the request's id; headers that were added since stay.
fn complete(response: Response, error: ApiError, id: &RequestId, method: &str) -> Response {
    let (parts, _) = response.into_parts();
    let mut again = error.respond(Some(&id.0));
    again.extensions_mut().remove::<ApiError>();
    for (name, value) in &parts.headers {
        if !again.headers().contains_key(name) {
            again.headers_mut().insert(name, value.clone());
        }
    }
    if method == "HEAD" {
        *again.body_mut() = Body::empty();
    }
    again
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
