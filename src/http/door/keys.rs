//! The key of a request: who sends it, and whether that may be done.
//!
//! Each operation has one [`Scope`] or is open ([`crate::http::operations`]). What is behind this
//! layer gets a [`Caller`], and nothing belongs to nobody.

use std::collections::HashMap;
use std::hash::Hash;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, PoisonError};

use axum::extract::{FromRequestParts, MatchedPath, Request, State};
use axum::http::header::{AUTHORIZATION, COOKIE, WWW_AUTHENTICATE};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderValue, Uri};
use axum::middleware::Next;
use axum::response::Response;
use base64::Engine;
use base64::prelude::BASE64_STANDARD;

use crate::http::AppState;
use crate::http::door::client::Client;
use crate::http::door::{origin, passwords, sessions};
use crate::http::wire::error::{ApiError, Code, Result};
use crate::http::wire::extract::header;
use crate::http::wire::request_id;
use crate::identity::{Actor, Caller, Refusal, Scope, Secret};
use crate::jobs::{Act, AuditOutcome};

/// Names that a use is noted of at most once, in milliseconds.
const PAUSE_MS: i64 = 60_000;

/// Most names that are remembered. Beyond it strangers are not noted: they must not fill the disk.
const MOST: usize = 4_096;

/// The cookie that a browser keeps its key in, out of the reach of scripts.
pub(in crate::http) const KEY_COOKIE: &str = "meshway-key";

/// The cookie of somebody who signed in with a password.
pub(in crate::http) const SESSION_COOKIE: &str = "meshway-session";

/// Where sessions begin.
const SESSION: &str = "/v1/session";

/// When what is worth a row a minute had its last one.
#[derive(Debug)]
pub(in crate::http) struct Minutely<K>(Mutex<HashMap<K, i64>>);

impl<K> Default for Minutely<K> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<K: Eq + Hash> Minutely<K> {
    /// Whether it is time for a row again; if so, the next one is a minute away.
    fn is_due(&self, name: K, now: i64) -> bool {
        let mut last = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        // A clock that was set back must not silence anybody for longer than that.
        let recent = |at: &i64| (0..PAUSE_MS).contains(&(now - at));
        if last.get(&name).is_some_and(recent) {
            return false;
        }
        if last.len() >= MOST {
            last.retain(|_, at| recent(at));
        }
        let room = last.len() < MOST;
        if room {
            last.insert(name, now);
        }
        room
    }
}

/// The layer of the operations that need this scope.
pub(in crate::http) async fn admit(
    State((app, scope)): State<(AppState, Scope)>,
    mut request: Request,
    next: Next,
) -> Result<Response> {
    let address = request.extensions().get::<Client>().map(|client| client.0);
    let id = request_id::current().unwrap_or_default();
    let operation = operation(&request);
    let asking = |caller: Caller| caller.asking(address, &id);
    let caller = if app.config.keys.is_empty() {
        asking(Caller::anybody())
    } else {
        let given = credential(&app, &request);
        let known = match given {
            Ok(given) => identify(&app, given, address).await,
            Err(error) => Err(error),
        };
        match known {
            Ok(caller) => asking(caller),
            Err(error) => {
                let stranger = asking(Caller::stranger());
                if app.strangers.is_due(address, app.store.now()) {
                    note(&app, &stranger, Act::AuthFail, &operation).await;
                }
                return Err(error);
            }
        }
    };
    if !caller.may(scope) {
        note(&app, &caller, Act::AuthDeny, &operation).await;
        let detail = format!("the key does not have the scope {scope}, which this needs");
        return Err(lacking(scope, &detail));
    }
    let standing = app.windows.count(&caller, app.store.now());
    if let Some(refusal) = standing.refusal() {
        return Err(refusal);
    }
    if let Actor::Key { id, .. } = &caller.actor
        && app.uses.is_due(Arc::clone(id), app.store.now())
    {
        let (app, id) = (AppState::clone(&app), Arc::clone(id));
        tokio::spawn(async move {
            if let Err(error) = app.store.note_use(&id).await {
                tracing::warn!(error.message = %error, "the use of a key was not noted");
            }
        });
    }
    request.extensions_mut().insert(caller);
    let mut response = next.run(request).await;
    standing.mark(response.headers_mut());
    Ok(response)
}

/// What a request shows of who sends it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::http) enum Credential {
    /// A key.
    Key(Secret),
    /// The cookie of somebody who signed in with a password.
    Session(Secret),
    /// A name and a password.
    Password(String, String),
}

/// What a request shows; cookies only in requests of pages of this service, passwords only where they
/// open a session.
fn credential(app: &AppState, request: &Request) -> Result<Credential> {
    let (headers, uri) = (request.headers(), request.uri());
    let given = credential_in(headers, uri)?;
    if !headers.contains_key(AUTHORIZATION) {
        origin::check_cookie(&app.config, headers, uri)?;
    }
    let route = request.extensions().get::<MatchedPath>();
    let signs_in = route.is_some_and(|route| route.as_str().ends_with(SESSION));
    if matches!(given, Credential::Password(..)) && !signs_in {
        let detail = "a password opens a session, at POST /v1/session; other requests bear its cookie, or a key";
        return Err(unauthenticated(detail, Some("invalid_request")));
    }
    Ok(given)
}

async fn identify(app: &AppState, given: Credential, address: Option<IpAddr>) -> Result<Caller> {
    let (keys, now) = (&app.config.keys, app.store.now());
    match given {
        Credential::Key(secret) => {
            let found = match keys.identify(&secret, address, now) {
                // Another node may have made it a moment ago.
                Err(Refusal::Unknown) if app.store.is_shared() => {
                    if let Some(key) = app.store.key(&secret.hash()).await? {
                        keys.add(key);
                    }
                    keys.identify(&secret, address, now)
                }
                found => found,
            };
            found.map_err(refused)
        }
        Credential::Session(secret) => {
            let found = sessions::find(app, &secret).await?;
            found.ok_or_else(|| {
                unauthenticated(
                    "the session has ended: sign in again",
                    Some("invalid_token"),
                )
            })
        }
        Credential::Password(name, password) => {
            passwords::check(app, (name, password), address).await
        }
    }
}

impl FromRequestParts<AppState> for Caller {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, _: &AppState) -> Result<Self> {
        let caller = parts.extensions.get::<Self>().cloned();
        caller.ok_or_else(|| ApiError::internal("an open operation asks who its caller is"))
    }
}

/// What a request bears, in its header or else in a cookie. Browsers send cookies for pages of this service
/// alone.
///
/// # Errors
/// [`Code::Unauthenticated`] without anything, [`Code::KeyInAddress`] for a key in the address.
pub(in crate::http) fn credential_in(headers: &HeaderMap, uri: &Uri) -> Result<Credential> {
    let query = uri.query().unwrap_or_default();
    if query
        .split(['&', '='])
        .any(|part| part.parse::<Secret>().is_ok())
    {
        let detail = "a key in an address is written into logs and histories on the way: take this \
                      one out of use, and send the next one in the header Authorization";
        return Err(ApiError::new(Code::KeyInAddress, detail));
    }
    if let Some(given) = header(headers, &AUTHORIZATION)? {
        return match given.split_once(' ') {
            Some((scheme, key)) if scheme.eq_ignore_ascii_case("bearer") => {
                secret(key).map(Credential::Key)
            }
            Some((scheme, pair)) if scheme.eq_ignore_ascii_case("basic") => basic(pair),
            _ => Err(unauthenticated(
                "the header Authorization must have the form Bearer mw_…",
                Some("invalid_request"),
            )),
        };
    }
    if let Some(session) = cookie(headers, SESSION_COOKIE) {
        return secret(session).map(Credential::Session);
    }
    let key = cookie(headers, KEY_COOKIE)
        .ok_or_else(|| unauthenticated("send a key: Authorization: Bearer mw_…", None))?;
    secret(key).map(Credential::Key)
}

fn secret(text: &str) -> Result<Secret> {
    text.trim().parse().map_err(|fault| {
        let detail = format!("what was sent as a key {fault}");
        unauthenticated(&detail, Some("invalid_token"))
    })
}

/// A name and a password in the form of RFC 7617, in UTF-8.
fn basic(pair: &str) -> Result<Credential> {
    let bytes = BASE64_STANDARD.decode(pair.trim()).ok();
    let text = bytes.and_then(|bytes| String::from_utf8(bytes).ok());
    let pair = text.as_deref().and_then(|text| text.split_once(':'));
    let (name, password) = pair.ok_or_else(|| {
        let detail = "after Basic comes the Base64 of NAME:PASSWORD in UTF-8";
        unauthenticated(detail, Some("invalid_request"))
    })?;
    Ok(Credential::Password(name.to_owned(), password.to_owned()))
}

fn cookie<'h>(headers: &'h HeaderMap, name: &str) -> Option<&'h str> {
    let texts = headers.get_all(COOKIE).iter();
    let mut pairs = texts
        .filter_map(|text| text.to_str().ok())
        .flat_map(|text| text.split(';'));
    // One that was emptied is none.
    let value = pairs.find_map(|pair| pair.trim().strip_prefix(name)?.strip_prefix('='));
    value.filter(|value| !value.is_empty())
}

/// A key from a wrong address is as unknown as any: a thief must not learn that it is good.
fn refused(refusal: Refusal) -> ApiError {
    tracing::info!(reason = refusal.name(), "a key was refused");
    let detail = match refusal {
        Refusal::Expired => "the key has expired",
        Refusal::Unknown | Refusal::Elsewhere => "the key is not known here",
    };
    unauthenticated(detail, Some("invalid_token"))
}

pub(in crate::http) fn unauthenticated(detail: &str, error: Option<&str>) -> ApiError {
    let error = error.map_or(String::new(), |error| format!(", error=\"{error}\""));
    challenge(ApiError::new(Code::Unauthenticated, detail), &error)
}

/// What a key is refused that does not have the scope.
pub(in crate::http) fn lacking(scope: Scope, detail: &str) -> ApiError {
    let error = format!(", error=\"insufficient_scope\", scope=\"{scope}\"");
    challenge(ApiError::new(Code::Forbidden, detail), &error).with("scope", scope.name().into())
}

/// The problem with what RFC 6750 asks for.
fn challenge(problem: ApiError, error: &str) -> ApiError {
    match HeaderValue::try_from(format!("Bearer realm=\"meshway\"{error}")) {
        Ok(value) => problem.with_header(WWW_AUTHENTICATE, value),
        Err(_) => problem,
    }
}

/// What is asked for, without the ids in it.
fn operation(request: &Request) -> String {
    let route = request.extensions().get::<MatchedPath>();
    let route = route.map_or("unmatched", MatchedPath::as_str);
    format!("{} {route}", request.method())
}

/// Notes a refusal. It is one whether or not it can be noted.
async fn note(app: &AppState, caller: &Caller, act: Act, operation: &str) {
    let acts = app.store.by(caller);
    if let Err(error) = acts.note(act, operation, AuditOutcome::Refused).await {
        tracing::warn!(act = act.name(), error.message = %error, "a refusal was not noted");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_due_once_a_minute_and_there_are_not_too_many() {
        let names = Minutely::default();
        assert!(names.is_due(0, 1_000_000));
        assert!(!names.is_due(0, 1_059_999));
        assert!(names.is_due(0, 1_060_000));
        assert!(names.is_due(0, 0));
        for name in 1..MOST {
            assert!(names.is_due(name, 1));
        }
        assert!(!names.is_due(MOST, 2));
        assert!(names.is_due(MOST, PAUSE_MS + 1));
    }

    #[test]
    fn a_key_is_taken_from_header_or_cookie_and_never_from_the_address() {
        let secret = Secret::generate().unwrap();
        let key_of = |value: &str, uri: String| {
            let mut headers = HeaderMap::new();
            headers.insert(AUTHORIZATION, value.parse().unwrap());
            credential_in(&headers, &uri.parse().unwrap()).map_err(|error| error.code())
        };
        let plain = || "/v1/jobs?limit=1".to_owned();
        let bearer = format!("bearer {}", secret.reveal());
        assert_eq!(
            key_of(&bearer, plain()),
            Ok(Credential::Key(secret.clone()))
        );
        // "anna:a:b", by `printf anna:a:b | base64`.
        let pair = Credential::Password("anna".to_owned(), "a:b".to_owned());
        assert_eq!(key_of("Basic YW5uYTphOmI=", plain()), Ok(pair));
        for wrong in [
            secret.reveal(),
            "Basic YQ==",
            "Basic ?",
            "Bearer",
            "Bearer x",
        ] {
            assert_eq!(
                key_of(wrong, plain()),
                Err(Code::Unauthenticated),
                "{wrong}"
            );
        }
        let in_cookie = |text: String| {
            let mut headers = HeaderMap::new();
            headers.insert(COOKIE, text.parse().unwrap());
            credential_in(&headers, &plain().parse().unwrap()).ok()
        };
        let kept = format!("a=b; {KEY_COOKIE}={}", secret.reveal());
        assert_eq!(
            in_cookie(kept.clone()),
            Some(Credential::Key(secret.clone()))
        );
        let session = Secret::generate().unwrap();
        let both = format!("{kept}; {SESSION_COOKIE}={}", session.reveal());
        assert_eq!(in_cookie(both), Some(Credential::Session(session)));
        let emptied = format!("{kept}; {SESSION_COOKIE}=");
        assert_eq!(in_cookie(emptied), Some(Credential::Key(secret.clone())));
        assert_eq!(
            in_cookie(format!("x{KEY_COOKIE}={}", secret.reveal())),
            None
        );
        let uri = format!("/v1/jobs?key={}", secret.reveal());
        assert_eq!(key_of(&bearer, uri), Err(Code::KeyInAddress));
    }
}
