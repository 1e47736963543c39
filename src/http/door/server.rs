//! The accept loop. Not `axum::serve`: that gives a silent client no timeout.

use std::convert::Infallible;
use std::io;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::http::header::CONNECTION;
use axum::http::{HeaderValue, Request};
use axum::response::{IntoResponse, Response};
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use tokio::net::TcpListener;
use tokio_io_timeout::TimeoutStream;
use tokio_util::sync::CancellationToken;
use tower::ServiceExt;

use crate::http::door::places::{Peer, Place, Places, Watched};
use crate::http::wire::error::{ApiError, Code};
use crate::http::wire::idempotency;
use crate::http::{AppState, router};

/// Time that requests under way have to end after the port was closed.
const DRAIN: Duration = Duration::from_secs(10);

/// Pause after a failed accept, such as for want of file descriptors: without it the loop spins.
const PAUSE: Duration = Duration::from_millis(100);

/// Time that a probe has for its request's header where all other places are taken.
const PROBE_PATIENCE: Duration = Duration::from_secs(2);

/// What is answered there.
const PROBES: [&str; 3] = ["/livez", "/readyz", "/metrics"];

/// Most bytes of a request's line and headers; hyper answers 431 to more.
pub(in crate::http) const MAX_HEAD_BYTES: usize = 64 * 1024;

/// Serves until `close` is cancelled and the requests under way have ended, at most ten seconds
/// longer. Between [`crate::http::App::shutdown`] and `close` connections are still taken: clients are
/// told that the service drains, and can read what is there.
pub async fn serve(listener: TcpListener, app: AppState, close: CancellationToken) {
    let patience = Duration::from_secs(u64::from(app.config.header_timeout_seconds.max(1)));
    let stall = Duration::from_secs(u64::from(app.config.download_timeout_seconds.max(1)));
    let places = Places::new(app.config.max_connections);
    let graceful = GracefulShutdown::new();
    let cut = CancellationToken::new();
    let tidying = tokio::spawn(idempotency::tidy(AppState::clone(&app)));
    let service = router(app);
    loop {
        let accepted = tokio::select! {
            accepted = accept(&listener, &places) => accepted,
            () = close.cancelled() => break,
        };
        let (stream, peer, place) = match accepted {
            Ok(accepted) => accepted,
            Err(error) => {
                tracing::warn!(error.message = %error, "a connection could not be accepted");
                tokio::time::sleep(PAUSE).await;
                continue;
            }
        };
        let place = Arc::new(place);
        let patience = if place.kept { PROBE_PATIENCE } else { patience };
        let mut stream = TimeoutStream::new(stream);
        stream.set_write_timeout(Some(stall));
        let service = service_fn({
            let (place, router) = (Arc::clone(&place), service.clone());
            move |request| answer(Arc::clone(&place), router.clone(), peer, request)
        });
        let connection = http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(patience)
            .max_buf_size(MAX_HEAD_BYTES)
            .serve_connection(TokioIo::new(Box::pin(stream)), service);
        let connection = graceful.watch(connection);
        let cut = cut.clone();
        tokio::spawn(async move {
            tokio::select! {
                ended = connection => if let Err(error) = ended {
                    tracing::debug!(error.message = %error, "a connection broke");
                },
                () = cut.cancelled() => {}
                () = place.cut.cancelled() => {}
            }
        });
    }
    drop(listener);
    tidying.abort();
    tokio::select! {
        () = graceful.shutdown() => {}
        () = tokio::time::sleep(DRAIN) => {
            tracing::warn!("requests were cut off by the shutdown");
            cut.cancel();
        }
    }
}

/// The next connection, once there is a place for it.
async fn accept(
    listener: &TcpListener,
    places: &Arc<Places>,
) -> io::Result<(tokio::net::TcpStream, Peer, Place)> {
    // Not before a client is there: somebody else gives up the place.
    let (stream, peer) = listener.accept().await?;
    stream.set_nodelay(true)?;
    Ok((stream, Peer(peer), places.take().await))
}

/// The answer to a request, whose connection is at work until it was sent.
async fn answer(
    place: Arc<Place>,
    router: Router,
    peer: Peer,
    request: Request<Incoming>,
) -> Result<Response, Infallible> {
    let work = place.work();
    if place.kept && !PROBES.contains(&request.uri().path()) {
        let detail = "as many connections as allowed are at work";
        let refused = ApiError::new(Code::RateLimited, detail).retry_after(5);
        let close = (CONNECTION, HeaderValue::from_static("close"));
        return Ok(([close], refused).into_response());
    }
    let mut request = request.map(Body::new);
    request.extensions_mut().insert(peer);
    let response = router.oneshot(request).await?;
    Ok(response.map(|body| Body::new(Watched::new(body, work))))
}
