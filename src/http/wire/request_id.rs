//! The id of the request that is answered, for whatever writes a problem on the way.

use std::future::Future;

use axum::extract::Request;
use axum::http::HeaderName;

/// The header that carries it, in requests and in answers.
pub(in crate::http) const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// Longest id that is taken over from a client.
const MAX_LENGTH: usize = 128;

tokio::task_local! {
    static CURRENT: String;
}

/// The id of a request: the client's if it is plain text, else a new one.
pub(in crate::http) fn of(request: &Request) -> String {
    let plain = |id: &&str| {
        (1..=MAX_LENGTH).contains(&id.len()) && id.bytes().all(|b| b.is_ascii_graphic())
    };
    let given = request.headers().get(REQUEST_ID);
    let given = given.and_then(|id| id.to_str().ok()).filter(plain);
    given.map_or_else(|| uuid::Uuid::now_v7().simple().to_string(), str::to_owned)
}

/// Runs what answers the request of this id.
pub(in crate::http) async fn within<F: Future>(id: String, answer: F) -> F::Output {
    CURRENT.scope(id, answer).await
}

/// The id of the request that this task answers.
pub(in crate::http) fn current() -> Option<String> {
    CURRENT.try_with(Clone::clone).ok()
}
