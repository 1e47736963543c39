//! The accept loop. Not `axum::serve`: that gives a silent client no timeout.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use hyper_util::service::TowerToHyperService;
use tokio::net::TcpListener;
use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;

use super::{AppState, idempotency, router};

/// Time that requests under way have to end after the port was closed.
const DRAIN: Duration = Duration::from_secs(10);

/// Pause after a failed accept, such as for want of file descriptors: without it the loop spins.
const PAUSE: Duration = Duration::from_millis(100);

/// Most bytes of a request's line and headers; hyper answers 431 to more.
pub(super) const MAX_HEAD_BYTES: usize = 64 * 1024;

/// Serves until `close` is cancelled and the requests under way have ended, at most ten seconds
/// longer. Between [`super::App::shutdown`] and `close` connections are still taken: clients are
/// told that the service drains, and can read what is there.
pub async fn serve(listener: TcpListener, app: AppState, close: CancellationToken) {
    let patience = Duration::from_secs(u64::from(app.config.header_timeout_seconds.max(1)));
    let places = Arc::new(Semaphore::new(app.config.max_connections as usize));
    let graceful = GracefulShutdown::new();
    let cut = CancellationToken::new();
    let tidying = tokio::spawn(idempotency::tidy(AppState::clone(&app)));
    let service = router(app);
    loop {
        let accepted = tokio::select! {
            accepted = accept(&listener, &places) => accepted,
            () = close.cancelled() => break,
        };
        let (stream, place) = match accepted {
            Ok(accepted) => accepted,
            Err(error) => {
                tracing::warn!(error.message = %error, "a connection could not be accepted");
                tokio::time::sleep(PAUSE).await;
                continue;
            }
        };
        let connection = http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(patience)
            .max_buf_size(MAX_HEAD_BYTES)
            .serve_connection(
                TokioIo::new(stream),
                TowerToHyperService::new(service.clone()),
            );
        let connection = graceful.watch(connection);
        let cut = cut.clone();
        tokio::spawn(async move {
            tokio::select! {
                ended = connection => if let Err(error) = ended {
                    tracing::debug!(error.message = %error, "a connection broke");
                },
                () = cut.cancelled() => {}
            }
            drop(place);
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
    places: &Arc<Semaphore>,
) -> io::Result<(tokio::net::TcpStream, tokio::sync::OwnedSemaphorePermit)> {
    let place = Arc::clone(places)
        .acquire_owned()
        .await
        .map_err(io::Error::other)?;
    let (stream, _) = listener.accept().await?;
    stream.set_nodelay(true)?;
    Ok((stream, place))
}
