//! Who may ask, and who did what: keys and the audit trail of the caller's tenant.

use std::collections::HashMap;
use std::sync::Arc;

use axum::Json;
use axum::extract::{Request, State};
use axum::http::header::CACHE_CONTROL;
use axum::http::{StatusCode, Uri};
use axum::response::{IntoResponse, Response};

use crate::http::AppState;
use crate::http::api;
use crate::http::door::keys::lacking;
use crate::http::upload::{self, bodies::JSON_LIMIT};
use crate::http::wire::error::{ApiError, Code, Result};
use crate::http::wire::extract::{Id, Members, NoQuery, Query, json};
use crate::http::wire::page::{Page, PageOf};
use crate::identity::{Actor, Caller, Key, Limits, Secret, file};
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

/// `POST /v1/keys`: a key of the tenant, shown this once. It can have no scope that its maker lacks: who
/// may make keys must not get to surfaces that way.
pub(in crate::http) async fn create_key(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    request: Request,
) -> Result<Response> {
    let body = upload::json(&app, request, JSON_LIMIT).await?;
    let mut members = Members::of(&body)?;
    let name = members.required("name", |value| file::name(&json::<String>(value)?));
    let scopes = members.required("scopes", |value| file::scopes(&json::<Vec<String>>(value)?));
    let networks = members.take("networks", |value| {
        file::networks(&json::<Vec<String>>(value)?)
    });
    let limits = members.take("limits", |value| file::of_account(json::<Limits>(value)?));
    let expires = members.take("expires_at", |value| {
        api::milliseconds(&json::<String>(value)?)
    });
    members.finish()?;
    let (Some(name), Some(scopes)) = (name, scopes) else {
        return Err(ApiError::internal("a key without a name was let in"));
    };
    if caller.actor == Actor::Anybody {
        let detail = "the service has no keys yet, so it cannot know who asks; the first one comes from \
                      the file of --config: `meshway key new` makes it";
        return Err(ApiError::new(Code::KeyInFile, detail));
    }
    let beyond: Vec<_> = scopes.iter().filter(|scope| !caller.may(*scope)).collect();
    if let Some(&scope) = beyond.first() {
        let names: Vec<_> = beyond.iter().map(|scope| scope.name()).collect();
        let detail = format!(
            "a key can give only the scopes that it has itself; this one lacks {}",
            names.join(", ")
        );
        return Err(lacking(scope, &detail));
    }
    let secret = Secret::generate().map_err(ApiError::internal)?;
    let key = Key {
        name,
        tenant: caller.tenant.clone(),
        hash: secret.hash(),
        scopes,
        expires,
        networks: networks.unwrap_or_default(),
        limits: limits.unwrap_or_default(),
        in_file: false,
    };
    let known = app.config.keys.all();
    let same = |other: &Arc<Key>| other.tenant == key.tenant && other.name == key.name;
    if known.iter().any(same) || !app.store.by(&caller).create_key(key.clone()).await? {
        let detail = format!("the tenant has a key {} already", key.name);
        return Err(ApiError::new(Code::KeyName, detail));
    }
    app.config.keys.add(key.clone());
    let made = api::NewKey {
        key: secret.reveal(),
        what: api::Key::new(&key, &HashMap::new()),
    };
    let private = [(CACHE_CONTROL, "no-store")];
    Ok((StatusCode::CREATED, private, Json(made)).into_response())
}

/// `DELETE /v1/keys/{id}`: opens nothing from now on.
pub(in crate::http) async fn delete_key(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Id(id): Id<String>,
) -> Result<StatusCode> {
    let known = app.config.keys.all();
    let key = known
        .iter()
        .find(|key| key.tenant == caller.tenant && key.hash.id() == id);
    let key = key.ok_or_else(|| ApiError::not_found("key"))?;
    if key.in_file {
        let detail = "the key stands in the file of --config: take it out there, and send SIGHUP";
        return Err(ApiError::new(Code::KeyInFile, detail));
    }
    // The row first: what the answer says must hold after a restart.
    if !app.store.by(&caller).delete_key(&id).await? {
        return Err(ApiError::not_found("key"));
    }
    app.config.keys.remove(&key.hash);
    Ok(StatusCode::NO_CONTENT)
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
