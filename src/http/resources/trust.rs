//! Who may ask, and who did what: keys and the audit trail of the caller's tenant.

use axum::Json;
use axum::extract::State;
use axum::http::Uri;
use axum::response::{IntoResponse, Response};

use crate::http::AppState;
use crate::http::api;
use crate::http::wire::error::Result;
use crate::http::wire::extract::{NoQuery, Query};
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
