//! The accept loop. Not `axum::serve`: that gives a silent client no timeout.

use std::convert::Infallible;
use std::io;
use std::net::SocketAddr;
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
use hyper_util::server::graceful::{GracefulConnection, GracefulShutdown};
use ipnet::IpNet;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio_io_timeout::TimeoutStream;
use tokio_util::sync::CancellationToken;
use tower::ServiceExt;

use crate::http::door::client::Client;
use crate::http::door::head;
use crate::http::door::places::{Place, Places, Watched};
use crate::http::door::stream::{Requests, Stream};
use crate::http::door::tls::Tls;
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
    serve_tls(listener, None, app, close).await;
}

/// [`serve`], with TLS where it is given.
pub async fn serve_tls(
    listener: TcpListener,
    tls: Option<Arc<Tls>>,
    app: AppState,
    close: CancellationToken,
) {
    let patience = Duration::from_secs(u64::from(app.config.header_timeout_seconds.max(1)));
    let stall = Duration::from_secs(u64::from(app.config.download_timeout_seconds.max(1)));
    let places = Places::new(app.config.max_connections);
    let graceful = GracefulShutdown::new();
    let cut = CancellationToken::new();
    let tidying = tokio::spawn(idempotency::tidy(AppState::clone(&app)));
    let proxies: Arc<[IpNet]> = app.config.trusted_proxies().into();
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
        let connection = Connection {
            place: Arc::clone(&place),
            requests: Arc::default(),
            router: service.clone(),
            peer,
            proxies: Arc::clone(&proxies),
        };
        let (cut, watcher, tls) = (cut.clone(), graceful.watcher(), tls.clone());
        tokio::spawn(async move {
            let talk = async {
                let Some(wire) = wire(stream, tls.as_deref()).await else {
                    return;
                };
                if let Err(error) = watcher.watch(connection.over(wire, patience)).await {
                    tracing::debug!(error.message = %error, "a connection broke");
                }
            };
            tokio::select! {
                () = talk => {}
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
) -> io::Result<(TcpStream, SocketAddr, Place)> {
    // Only once a client is there, because taking a place may close another connection.
    let (stream, peer) = listener.accept().await?;
    stream.set_nodelay(true)?;
    Ok((stream, peer, places.take().await))
}

/// What bytes go over.
trait Wire: AsyncRead + AsyncWrite + Unpin + Send {}

impl<S: AsyncRead + AsyncWrite + Unpin + Send> Wire for S {}

/// The connection itself, or TLS over it; none if there is no handshake.
async fn wire(stream: TimeoutStream<TcpStream>, tls: Option<&Tls>) -> Option<Box<dyn Wire>> {
    let stream = Box::pin(stream);
    match tls {
        None => Some(Box::new(stream)),
        Some(tls) => Some(Box::new(tls.accept(stream).await?)),
    }
}

/// What an answer needs of its connection.
#[derive(Clone)]
struct Connection {
    place: Arc<Place>,
    requests: Arc<Requests>,
    router: Router,
    peer: SocketAddr,
    proxies: Arc<[IpNet]>,
}

impl Connection {
    /// Answers the requests that come over a wire; a header may take as long as `patience`.
    fn over(
        self,
        wire: Box<dyn Wire>,
        patience: Duration,
    ) -> impl GracefulConnection<Error = hyper::Error> {
        let stream = Stream::new(wire, Arc::clone(&self.place), Arc::clone(&self.requests));
        let service = service_fn(move |request| self.clone().answer(request));
        http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(patience)
            .max_buf_size(head::MAX_BYTES)
            .serve_connection(TokioIo::new(stream), service)
    }

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
            let client = Client::behind(self.peer.ip(), request.headers(), &self.proxies);
            request.extensions_mut().insert(client);
            self.router.oneshot(request).await?
        };
        Ok(response.map(|body| Body::new(Watched::new(body, work))))
    }
}

/// Whether it is for those who watch, below whatever path a proxy offers the service.
fn is_probe(path: &str) -> bool {
    PROBES.iter().any(|probe| path.ends_with(probe))
}
