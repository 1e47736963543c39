//! Who may ask, and who did what: keys and the audit trail of the caller's tenant.

use axum::Json;
use axum::extract::State;
use axum::http::header::{ORIGIN, SET_COOKIE};
use axum::http::{HeaderMap, StatusCode, Uri};
use axum::response::{IntoResponse, Response};

use crate::config::Config;
use crate::http::AppState;
use crate::http::api;
use crate::http::door::keys::{KEY_COOKIE, key_in};
use crate::http::wire::error::Result;
use crate::http::wire::extract::{NoQuery, Query, header};
use crate::http::wire::page::{Page, PageOf};
use crate::identity::Caller;
use crate::jobs::{Act, AuditOutcome};

/// `GET /v1/keys`: those of the tenant, by name.
pub(in crate::http) async fn keys(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
) -> Result<Response> {
    let uses = app.store.key_uses().await?;
    let mut keys = app.config.keys.all();
    keys.retain(|key| key.tenant == caller.tenant);
    let item = |key| api::Key::new(key, &uses);
    let items = keys.iter().map(|key| item(key)).collect();
    Ok(Json(api::Items { items }).into_response())
}

/// `GET /v1/audit`: newest first.
pub(in crate::http) async fn audit(
    State(app): State<AppState>,
    caller: Caller,
    uri: Uri,
    mut query: Query,
) -> Result<Response> {
    let page = Page::<i64>::of(&mut query);
    query.finish()?;
    let page = page?;
    let acts = app.store.by(&caller);
    acts.note(Act::AuditRead, "audit", AuditOutcome::Done)
        .await?;
    let records = app.store.of(&caller.tenant);
    let found = records.audit(page.before, page.limit + 1).await?;
    let PageOf { items, next } = page.cut(found, |row| row.seq.to_string());
    Ok(next.answer(&uri, items.iter().map(api::AuditRow::from).collect()))
}

/// Seconds that a browser keeps a key: a working day.
const SIGNED_IN: u32 = 12 * 60 * 60;

/// `POST /v1/session`: the browser keeps the key of this request and sends it from then on.
pub(in crate::http) async fn sign_in(
    State(app): State<AppState>,
    headers: HeaderMap,
    uri: Uri,
    _: NoQuery,
) -> Result<Response> {
    if app.config.keys.is_empty() {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    let key = key_in(&headers, &uri)?;
    keep(&app.config, &headers, key.reveal(), SIGNED_IN)
}

/// `DELETE /v1/session`: the browser forgets its key.
pub(in crate::http) async fn sign_out(
    State(app): State<AppState>,
    headers: HeaderMap,
    _: NoQuery,
) -> Result<Response> {
    keep(&app.config, &headers, "", 0)
}

/// Has the browser keep a key for so long, in a cookie that no script and no other site can use, and that goes over TLS
/// alone where the page did.
fn keep(config: &Config, headers: &HeaderMap, key: &str, seconds: u32) -> Result<Response> {
    let origin = header(headers, &ORIGIN)?;
    let encrypted = config.tls_cert.is_some() || origin.is_some_and(|o| o.starts_with("https:"));
    let secure = if encrypted { "; Secure" } else { "" };
    let path = config.address("/");
    let cookie = format!(
        "{KEY_COOKIE}={key}; Path={path}; Max-Age={seconds}; HttpOnly; SameSite=Strict{secure}"
    );
    Ok((StatusCode::NO_CONTENT, [(SET_COOKIE, cookie)]).into_response())
}
