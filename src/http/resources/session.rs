//! Browsers that sign in: with a key, which they keep in a cookie, or with a name and a password, for
//! which they get the cookie of a session.

use axum::Json;
use axum::extract::{Request, State};
use axum::http::header::{CACHE_CONTROL, ORIGIN, SET_COOKIE};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{AppendHeaders, IntoResponse, Response};

use crate::config::Config;
use crate::http::AppState;
use crate::http::api;
use crate::http::door::keys::{Credential, KEY_COOKIE, SESSION_COOKIE, credential_in};
use crate::http::door::sessions;
use crate::http::wire::error::{ApiError, Result};
use crate::http::wire::extract::{NoQuery, header};
use crate::identity::{Actor, Caller};
use crate::jobs::{Act, AuditOutcome};

/// Seconds that a browser keeps a cookie: a working day.
const SIGNED_IN: u32 = 12 * 60 * 60;

/// `GET /v1/session`: who this is, and what it may do. A page offers nothing else.
pub(in crate::http) async fn show(caller: Caller, _: NoQuery) -> Response {
    let private = [(CACHE_CONTROL, "no-store")];
    (private, Json(api::Session::from(&caller))).into_response()
}

/// `POST /v1/session`: the browser keeps the key of this request, or a session for its name and
/// password, and sends it from then on.
pub(in crate::http) async fn sign_in(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    request: Request,
) -> Result<Response> {
    if caller.actor == Actor::Anybody {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    let headers = request.headers();
    let (kept, emptied) = match credential_in(headers, request.uri())? {
        Credential::Key(key) => ((KEY_COOKIE, key), SESSION_COOKIE),
        // It has one.
        Credential::Session(_) => return Ok(StatusCode::NO_CONTENT.into_response()),
        Credential::Password(name, _) => {
            let user = app.config.keys.user(&name);
            let user = user.ok_or_else(|| ApiError::internal("a user went while signing in"))?;
            let note = app.store.by(&caller);
            note.note(Act::SessionCreate, &name, AuditOutcome::Done)
                .await?;
            let session = sessions::begin(&app, &user).await?;
            ((SESSION_COOKIE, session), KEY_COOKIE)
        }
    };
    let cookies = [
        cookie(&app.config, headers, (kept.0, kept.1.reveal(), SIGNED_IN))?,
        cookie(&app.config, headers, (emptied, "", 0))?,
    ];
    Ok(set(cookies))
}

/// `DELETE /v1/session`: the browser forgets its key, and its session ends.
pub(in crate::http) async fn sign_out(
    State(app): State<AppState>,
    _: NoQuery,
    request: Request,
) -> Result<Response> {
    let headers = request.headers();
    if let Ok(Credential::Session(secret)) = credential_in(headers, request.uri()) {
        sessions::end(&app, &secret).await?;
    }
    let cookies = [
        cookie(&app.config, headers, (KEY_COOKIE, "", 0))?,
        cookie(&app.config, headers, (SESSION_COOKIE, "", 0))?,
    ];
    Ok(set(cookies))
}

fn set(cookies: [String; 2]) -> Response {
    let cookies = AppendHeaders(cookies.map(|cookie| (SET_COOKIE, cookie)));
    (StatusCode::NO_CONTENT, cookies).into_response()
}

/// A cookie of this name and value for so many seconds that no script and no other site can use, and
/// that goes over TLS alone where the page did.
fn cookie(
    config: &Config,
    headers: &HeaderMap,
    (name, value, seconds): (&str, &str, u32),
) -> Result<String> {
    let origin = header(headers, &ORIGIN)?;
    let encrypted = config.tls_cert.is_some() || origin.is_some_and(|o| o.starts_with("https:"));
    let secure = if encrypted { "; Secure" } else { "" };
    let path = config.address("/");
    Ok(format!(
        "{name}={value}; Path={path}; Max-Age={seconds}; HttpOnly; SameSite=Strict{secure}"
    ))
}
