//! A receiver of webhooks, which answers as it is told.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex};

use axum::Router;
use axum::body::Bytes;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use axum::routing::any;
use serde_json::Value;
use tokio::net::TcpListener;

use crate::server::{PATIENCE, until};

/// What a receiver saw.
#[derive(Debug, Clone)]
pub(crate) struct Seen {
    pub(crate) path: String,
    pub(crate) headers: HeaderMap,
    pub(crate) body: Bytes,
}

impl Seen {
    pub(crate) fn header(&self, name: &str) -> &str {
        self.headers[name].to_str().unwrap()
    }

    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap()
    }
}

/// A status and a header.
type Answer = (u16, &'static str, &'static str);

/// A receiver that answers as it is told, and else takes all.
#[derive(Debug, Clone, Default)]
pub(crate) struct Receiver {
    seen: Arc<Mutex<Vec<Seen>>>,
    answers: Arc<Mutex<VecDeque<Answer>>>,
}

impl Receiver {
    /// Listens on a free port.
    pub(crate) async fn start(&self) -> SocketAddr {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        self.serve(listener);
        address
    }

    pub(crate) fn serve(&self, listener: TcpListener) {
        let router = Router::new().fallback(any(take)).with_state(self.clone());
        tokio::spawn(async { axum::serve(listener, router).await });
    }

    pub(crate) fn answer(&self, status: u16, name: &'static str, value: &'static str) {
        self.answers
            .lock()
            .unwrap()
            .push_back((status, name, value));
    }

    pub(crate) fn seen(&self) -> Vec<Seen> {
        self.seen.lock().unwrap().clone()
    }

    pub(crate) async fn sees(&self, number: usize) -> Vec<Seen> {
        until("a message arrives", PATIENCE, async || {
            Some(self.seen()).filter(|seen| seen.len() >= number)
        })
        .await
    }
}

async fn take(
    State(receiver): State<Receiver>,
    uri: Uri,
    headers: HeaderMap,
    body: Bytes,
) -> Response {
    let path = uri.to_string();
    receiver.seen.lock().unwrap().push(Seen {
        path,
        headers,
        body,
    });
    let answer = receiver.answers.lock().unwrap().pop_front();
    let (status, name, value) = answer.unwrap_or((204, "x-answer", "none"));
    (StatusCode::from_u16(status).unwrap(), [(name, value)]).into_response()
}
