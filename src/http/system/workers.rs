//! What a process says of itself that only works on jobs: that it lives, that it could take a job, and its
//! metrics.

use std::net::SocketAddr;
use std::sync::{Arc, PoisonError};

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Json, Router};
use tokio::net::TcpListener;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

use super::{livez, scraped, uncached};
use crate::http::api;
use crate::http::telemetry::workers::WorkerGauges;
use crate::http::telemetry::{Telemetry, own};
use crate::http::wire::error::{ApiError, Code, Result};
use crate::jobs::{Store, Workers};

/// What is told.
struct Told {
    store: Store,
    workers: watch::Receiver<Workers>,
    shutdown: CancellationToken,
    telemetry: Telemetry,
    gauges: WorkerGauges,
}

/// Answers `/livez`, `/readyz` and `/metrics` until `close`. `shutdown` says that no more jobs are taken.
///
/// # Errors
/// When the address cannot be listened to.
pub async fn tell_of_workers(
    address: SocketAddr,
    (store, workers): (Store, watch::Receiver<Workers>),
    shutdown: CancellationToken,
    close: CancellationToken,
) -> std::io::Result<()> {
    let (telemetry, gauges) = (Telemetry::default(), WorkerGauges::default());
    {
        let registry = telemetry.registry.lock();
        let mut registry = registry.unwrap_or_else(PoisonError::into_inner);
        gauges.register(own(&mut registry));
    }
    let told = Told {
        store,
        workers,
        shutdown,
        telemetry,
        gauges,
    };
    let router = Router::new()
        .route("/livez", get(livez))
        .route("/readyz", get(readyz))
        .route("/metrics", get(metrics))
        .with_state(Arc::new(told));
    let listener = TcpListener::bind(address).await?;
    let address = listener.local_addr()?;
    tracing::info!("listening on http://{address}");
    tokio::spawn(async move {
        let served = axum::serve(listener, router).with_graceful_shutdown(close.cancelled_owned());
        if let Err(error) = served.await {
            tracing::error!(error.message = %error, "nobody is told of the workers any more");
        }
    });
    Ok(())
}

/// Whether a job would be taken: the database answers, and workers run.
async fn readyz(State(told): State<Arc<Told>>) -> Response {
    let workers = *told.workers.borrow();
    let found = if told.shutdown.is_cancelled() {
        Err("no more jobs are taken".to_owned())
    } else if workers.busy + workers.idle == 0 {
        Err("no worker process runs".to_owned())
    } else {
        let rows = told.store.nodes().await;
        rows.map(drop)
            .map_err(|error| format!("database: {}", error.code()))
    };
    let answer = match found {
        Ok(()) => (StatusCode::OK, Json(api::Live { status: "ready" })).into_response(),
        Err(detail) => ApiError::new(Code::NotReady, detail).into_response(),
    };
    uncached(answer)
}

async fn metrics(State(told): State<Arc<Told>>, headers: HeaderMap) -> Result<Response> {
    told.gauges.set(*told.workers.borrow());
    scraped(&told.telemetry, &headers)
}
