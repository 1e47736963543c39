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

use crate::http::door::head;
use crate::http::door::places::{Peer, Place, Places, Watched};
use crate::http::door::stream::{Requests, Stream};
use crate::http::wire::error::{ApiError, Code};
use crate::http::wire::idempotency;
use crate::http::{AppState, router};

/// Time that requests under way have to end after the port was closed.
const DRAIN: Duration = Duration::from_secs(10);

/// Pause after a failed accept, such as for want of file descriptors: without it the loop spins.
const PAUSE: Duration = Duration::from_millis(100);

/// Time that a probe has for its request's header where all other places are taken.
const PROBE_PATIENCE: Duration = Duration::from_secs(2);

/// The paths that count as probes.
const PROBES: [&str; 3] = ["/livez", "/readyz", "/metrics"];

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
        let requests = Arc::default();
        let stream = Stream::new(Box::pin(stream), Arc::clone(&place), Arc::clone(&requests));
        let connection = Connection {
            place: Arc::clone(&place),
            requests,
            router: service.clone(),
            peer,
        };
        let service = service_fn(move |request| connection.clone().answer(request));
        let connection = http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(patience)
            .max_buf_size(head::MAX_BYTES)
            .serve_connection(TokioIo::new(stream), service);
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

/// Accepts the next connection and waits for a place for it.
async fn accept(
    listener: &TcpListener,
    places: &Arc<Places>,
) -> io::Result<(tokio::net::TcpStream, Peer, Place)> {
    // Only once a client is there, because taking a place may close another connection.
    let (stream, peer) = listener.accept().await?;
    stream.set_nodelay(true)?;
    Ok((stream, Peer(peer), places.take().await))
}

/// What an answer needs of its connection.
#[derive(Clone)]
struct Connection {
    place: Arc<Place>,
    requests: Arc<Requests>,
    router: Router,
    peer: Peer,
}

impl Connection {
    /// The answer to a request, whose connection is at work until it was sent.
    async fn answer(self, request: Request<Incoming>) -> Result<Response, Infallible> {
        let work = self.place.work();
        let request = request.map(|body| self.requests.begin(body));
        let response = if self.place.kept && !is_probe(request.uri().path()) {
            let detail = "as many connections as allowed are at work";
            let refused = ApiError::new(Code::RateLimited, detail).retry_after(5);
            let close = (CONNECTION, HeaderValue::from_static("close"));
            ([close], refused).into_response()
        } else {
            let mut request = request;
            request.extensions_mut().insert(self.peer);
            self.router.oneshot(request).await?
        };
        Ok(response.map(|body| Body::new(Watched::new(body, work))))
    }
}

/// Whether it is for those who watch, below whatever path a proxy offers the service.
fn is_probe(path: &str) -> bool {
    PROBES.iter().any(|probe| path.ends_with(probe))
}
