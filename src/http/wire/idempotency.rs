//! `Idempotency-Key`: a request that is repeated with its key is answered again, not done again.
//!
//! A key is begun before the work. The answer is stored in the transaction of the work if there is
//! one (a submitted job), otherwise right after it. Only successes are stored: a refused request may
//! be corrected and sent again, and so may one whose client hung up.

use std::time::Duration;

use axum::body::{Body, to_bytes};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, Uri};
use axum::response::Response;
use sha2::{Digest, Sha256};

use crate::http::AppState;
use crate::http::wire::error::{ApiError, Code, Result};
use crate::http::wire::extract::header;
use crate::identity::Caller;
use crate::jobs::{self, Idempotency, IdempotencyState, StoredResponse, Subject};

/// The header that carries the key.
pub(in crate::http) const KEY: HeaderName = HeaderName::from_static("idempotency-key");
pub(in crate::http) const REPLAYED: HeaderName = HeaderName::from_static("idempotency-replayed");

/// Longest key.
pub(in crate::http) const MAX_KEY_LENGTH: usize = 255;

/// Headers that belong to an answer and are given again.
const KEPT_HEADERS: [&str; 5] = ["content-type", "location", "etag", "retry-after", "link"];

/// How long an answer is kept, in milliseconds.
pub(in crate::http) const KEPT_MS: i64 = 24 * 60 * 60 * 1_000;

/// How often old answers are forgotten.
const TIDY_EVERY: Duration = Duration::from_mins(10);

/// Removes old answers again and again. Never ends.
pub(in crate::http) async fn tidy(app: AppState) {
    loop {
        let before = app.store.now() - KEPT_MS;
        if let Err(error) = app.store.idempotency_prune(before).await {
            tracing::warn!(error.message = %error, "old answers could not be forgotten");
        }
        tokio::time::sleep(TIDY_EVERY).await;
    }
}

/// What identifies a request when it is repeated.
#[derive(Debug, Clone)]
pub(in crate::http) struct Request {
    caller: Caller,
    key: Option<String>,
    scope: String,
    hash: Sha256,
}

impl Request {
    /// A POST to the given address; what its body holds is added with [`Request::content`].
    ///
    /// # Errors
    /// [`Code::BadHeader`] for a key that is empty, too long or no text.
    pub(in crate::http) fn new(caller: &Caller, headers: &HeaderMap, uri: &Uri) -> Result<Self> {
        let key = header(headers, &KEY)?;
        if key.is_some_and(|key| !(1..=MAX_KEY_LENGTH).contains(&key.len())) {
            let detail = format!("Idempotency-Key must have 1 to {MAX_KEY_LENGTH} characters");
            return Err(ApiError::new(Code::BadHeader, detail));
        }
        let mut request = Self {
            caller: caller.clone(),
            key: key.map(str::to_owned),
            scope: format!("POST {}", uri.path()),
            hash: Sha256::new(),
        };
        request.content(uri.query().unwrap_or_default().as_bytes());
        Ok(request)
    }

    /// Refuses new work while the service accepts none. A request that was answered before passes.
    ///
    /// # Errors
    /// [`Code::Draining`], [`Code::InsufficientStorage`], and those of the store.
    pub(in crate::http) async fn admit(&self, app: &AppState) -> Result<()> {
        let Err(refusal) = app.check_accepting() else {
            return Ok(());
        };
        let answered = match &self.key {
            Some(key) => {
                let acts = app.store.by(&self.caller);
                acts.idempotency_answered(key, &self.scope).await?
            }
            None => false,
        };
        if answered { Ok(()) } else { Err(refusal) }
    }

    /// Adds a body, or its hash, to what identifies the request.
    pub(in crate::http) fn content(&mut self, part: &[u8]) {
        self.hash.update((part.len() as u64).to_le_bytes());
        self.hash.update(part);
    }

    /// Begins the key, or finds the answer of the first request.
    ///
    /// # Errors
    /// [`Code::IdempotencyInFlight`], [`Code::IdempotencyMismatch`], [`Code::Gone`] where the
    /// answer was a job, a cloud or a batch that was erased since, and those of the store.
    pub(in crate::http) async fn begin(self, app: &AppState) -> Result<Begun> {
        let Some(key) = self.key else {
            return Ok(Begun::New(Attempt(None)));
        };
        let sha256 = crate::http::wire::download::hex(self.hash.finalize());
        let found = app
            .store
            .by(&self.caller)
            .idempotency_begin(&key, &self.scope, &sha256)
            .await?;
        match found {
            IdempotencyState::New => Ok(Begun::New(Attempt(Some(Open {
                app: AppState::clone(app),
                caller: self.caller,
                key,
                scope: self.scope,
            })))),
            IdempotencyState::Replay(stored) => replay(stored).map(Begun::Replay),
            IdempotencyState::Gone(tombstone) => Err(ApiError::gone("job", &tombstone)),
            IdempotencyState::CloudGone(tombstone) => Err(ApiError::gone("cloud", &tombstone)),
            IdempotencyState::BatchGone(tombstone) => Err(ApiError::gone("batch", &tombstone)),
            IdempotencyState::InFlight => Err(ApiError::new(
                Code::IdempotencyInFlight,
                "the first request with this Idempotency-Key is being worked on",
            )),
            IdempotencyState::Mismatch => Err(ApiError::new(
                Code::IdempotencyMismatch,
                "this Idempotency-Key was used for another request",
            )),
        }
    }
}

/// The outcome of beginning a key.
pub(in crate::http) enum Begun {
    /// Nothing: the work is to be done.
    New(Attempt),
    /// The answer of the first request.
    Replay(Response),
}

/// The work under a key. If it is dropped without an answer, because of an error or a client that
/// hung up, the key is forgotten. The store ignores that if the answer was stored after all.
pub(in crate::http) struct Attempt(Option<Open>);

struct Open {
    app: AppState,
    caller: Caller,
    key: String,
    scope: String,
}

impl Attempt {
    /// For [`crate::jobs::store::Acts::submit`] and its like, which keep the answer with what is made.
    pub(in crate::http) fn with<T>(
        &self,
        respond: impl Fn(&T) -> StoredResponse + Send + Sync + 'static,
    ) -> Option<Idempotency<T>> {
        let open = self.0.as_ref()?;
        Some(Idempotency {
            key: open.key.clone(),
            scope: open.scope.clone(),
            respond: Box::new(respond),
        })
    }

    /// Forgets nothing: the answer was kept with what was made.
    pub(in crate::http) fn kept(mut self) {
        self.0 = None;
    }

    /// Keeps an answer and gives it back; one that tells of a job or a cloud is emptied with it.
    ///
    /// # Errors
    /// Those of the store.
    pub(in crate::http) async fn keep(
        mut self,
        response: Response,
        subject: Option<Subject>,
    ) -> Result<Response> {
        let Some(open) = self.0.as_ref() else {
            return Ok(response);
        };
        if !response.status().is_success() {
            return Ok(response);
        }
        let (parts, body) = response.into_parts();
        let body = to_bytes(body, usize::MAX)
            .await
            .map_err(ApiError::internal)?;
        let stored = StoredResponse {
            status: parts.status.as_u16(),
            headers: kept_headers(&parts.headers),
            body: body.to_vec(),
        };
        let kept = open
            .app
            .store
            .by(&open.caller)
            .idempotency_complete(&open.key, &open.scope, subject, stored)
            .await;
        match kept {
            // The key was pruned meanwhile. The work is done nevertheless.
            Ok(()) | Err(jobs::Error::Stale) => {}
            Err(error) => return Err(error.into()),
        }
        self.0 = None;
        Ok(Response::from_parts(parts, Body::from(body)))
    }
}

impl Drop for Attempt {
    fn drop(&mut self) {
        let (Some(open), Ok(runtime)) = (self.0.take(), tokio::runtime::Handle::try_current())
        else {
            return;
        };
        runtime.spawn(async move {
            let acts = open.app.store.by(&open.caller);
            if let Err(error) = acts.idempotency_abandon(&open.key, &open.scope).await {
                tracing::warn!(error.message = %error, "a key could not be forgotten");
            }
        });
    }
}

/// The headers of an answer that are given again.
pub(in crate::http) fn kept_headers(headers: &HeaderMap) -> Vec<(String, String)> {
    KEPT_HEADERS
        .iter()
        .filter_map(|&name| {
            let value = headers.get(name)?.to_str().ok()?;
            Some((name.to_owned(), value.to_owned()))
        })
        .collect()
}

fn replay(stored: StoredResponse) -> Result<Response> {
    let mut response = Response::new(Body::from(stored.body));
    *response.status_mut() = StatusCode::from_u16(stored.status).map_err(ApiError::internal)?;
    for (name, value) in stored.headers {
        let name = HeaderName::try_from(name).map_err(ApiError::internal)?;
        let value = HeaderValue::try_from(value).map_err(ApiError::internal)?;
        response.headers_mut().insert(name, value);
    }
    response
        .headers_mut()
        .insert(REPLAYED, HeaderValue::from_static("true"));
    Ok(response)
}
