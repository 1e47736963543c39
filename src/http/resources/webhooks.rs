//! Webhooks of the caller's tenant, and the messages to them.

use axum::Json;
use axum::extract::{Request, State};
use axum::http::header::{CACHE_CONTROL, LOCATION};
use axum::http::{StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use serde_json::Value;

use crate::http::AppState;
use crate::http::api;
use crate::http::resources::jobs::members_of;
use crate::http::upload::{self, bodies::JSON_LIMIT};
use crate::http::wire::error::{ApiError, Code, Result};
use crate::http::wire::extract::{Id, Members, NoQuery, Query, json};
use crate::http::wire::page::{Page, PageOf};
use crate::identity::Caller;
use crate::jobs::{Delivery, DeliveryId, NewWebhook, News, Webhook, WebhookChange, WebhookId};
use crate::webhooks::{Policy, Secret};

/// Most webhooks of a tenant: each multiplies what the end of a job writes.
const MOST: u32 = 20;

/// How long messages are signed with the secret before a new one too, in milliseconds: a day, in which
/// the receiver learns the new one.
const OLD_SECRET_MS: i64 = 24 * 60 * 60 * 1_000;

/// `GET /v1/webhooks`: all of the tenant, oldest first.
pub(in crate::http) async fn list(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
) -> Result<Response> {
    let webhooks = app.store.of(&caller.tenant).webhooks().await?;
    let items: Vec<_> = webhooks.iter().map(api::Webhook::from).collect();
    Ok(Json(api::Items { items }).into_response())
}

/// `POST /v1/webhooks`: the answer has the secret, this once.
pub(in crate::http) async fn create(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    request: Request,
) -> Result<Response> {
    let body = upload::json(&app, request, JSON_LIMIT).await?;
    let mut members = Members::of(&body)?;
    let url = members.required("url", |value| address(&app, value));
    let events = members.take("events", events);
    members.finish()?;
    let Some(url) = url else {
        return Err(ApiError::internal(
            "a webhook without an address was let in",
        ));
    };
    let secret = Secret::generate().map_err(ApiError::internal)?;
    let new = NewWebhook {
        url,
        events: events.unwrap_or_else(|| News::ALL.to_vec()),
        secret: secret.clone().into_bytes(),
    };
    let made = app.store.by(&caller).create_webhook(new, MOST).await?;
    let made = made.ok_or_else(|| {
        let detail = format!("a tenant has at most {MOST} webhooks; remove one that is not needed");
        ApiError::new(Code::WebhookLimit, detail)
    })?;
    let location = [(LOCATION, format!("/v1/webhooks/{}", made.id))];
    Ok((StatusCode::CREATED, location, shown_once(&secret, &made)).into_response())
}

/// `GET /v1/webhooks/{id}`.
pub(in crate::http) async fn show(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Id(id): Id<WebhookId>,
) -> Result<Response> {
    let webhook = app.store.of(&caller.tenant).webhook(&id).await?;
    let webhook = webhook.ok_or_else(no_webhook)?;
    Ok(Json(api::Webhook::from(&webhook)).into_response())
}

/// `PATCH /v1/webhooks/{id}`: another address, other events, enabled or not.
pub(in crate::http) async fn change(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Id(id): Id<WebhookId>,
    request: Request,
) -> Result<Response> {
    let body = upload::json(&app, request, JSON_LIMIT).await?;
    let mut members = members_of("the body", Some(&body))?;
    let change = WebhookChange {
        url: members.take("url", |value| address(&app, value)),
        events: members.take("events", events),
        enabled: members.take("enabled", json::<bool>),
        secret: None,
    };
    members.finish()?;
    let changed = app.store.by(&caller).change_webhook(&id, change).await?;
    let changed = changed.ok_or_else(no_webhook)?;
    Ok(Json(api::Webhook::from(&changed)).into_response())
}

/// `POST /v1/webhooks/{id}/secret`: a new secret, beside which the old one signs for a day.
pub(in crate::http) async fn renew_secret(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Id(id): Id<WebhookId>,
    request: Request,
) -> Result<Response> {
    without_members(&app, request).await?;
    let secret = Secret::generate().map_err(ApiError::internal)?;
    let change = WebhookChange {
        secret: Some((secret.clone().into_bytes(), OLD_SECRET_MS)),
        ..WebhookChange::default()
    };
    let changed = app.store.by(&caller).change_webhook(&id, change).await?;
    let changed = changed.ok_or_else(no_webhook)?;
    Ok(shown_once(&secret, &changed))
}

/// `DELETE /v1/webhooks/{id}`: with the messages to it.
pub(in crate::http) async fn erase(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Id(id): Id<WebhookId>,
) -> Result<StatusCode> {
    if !app.store.by(&caller).delete_webhook(&id).await? {
        return Err(no_webhook());
    }
    Ok(StatusCode::NO_CONTENT)
}

/// `POST /v1/webhooks/{id}/test`: a message that tells of nothing.
pub(in crate::http) async fn test(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Id(id): Id<WebhookId>,
    request: Request,
) -> Result<Response> {
    without_members(&app, request).await?;
    let made = app.store.by(&caller).test_webhook(&id).await?;
    Ok(accepted(&made.ok_or_else(no_webhook)?))
}

/// `GET /v1/webhooks/{id}/deliveries`: newest first.
pub(in crate::http) async fn deliveries(
    State(app): State<AppState>,
    caller: Caller,
    Id(id): Id<WebhookId>,
    uri: Uri,
    mut query: Query,
) -> Result<Response> {
    let page = Page::<DeliveryId>::of(&mut query);
    query.finish()?;
    let page = page?;
    let records = app.store.of(&caller.tenant);
    records.webhook(&id).await?.ok_or_else(no_webhook)?;
    let before = page.before.as_ref();
    let found = records.deliveries(&id, before, page.limit + 1).await?;
    let PageOf { items, next } = page.cut(found, |delivery| delivery.id.to_string());
    Ok(next.answer(&uri, items.iter().map(api::Delivery::from).collect()))
}

/// `GET /v1/deliveries/{id}`.
pub(in crate::http) async fn delivery(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Id(id): Id<DeliveryId>,
) -> Result<Response> {
    let delivery = app.store.of(&caller.tenant).delivery(&id).await?;
    let delivery = delivery.ok_or_else(no_delivery)?;
    Ok(Json(api::Delivery::from(&delivery)).into_response())
}

/// `POST /v1/deliveries/{id}/redeliver`: the same message again, now.
pub(in crate::http) async fn redeliver(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Id(id): Id<DeliveryId>,
    request: Request,
) -> Result<Response> {
    without_members(&app, request).await?;
    let again = app.store.by(&caller).redeliver(&id).await?;
    Ok(accepted(&again.ok_or_else(no_delivery)?))
}

/// A secret that is told this once.
fn shown_once(secret: &Secret, webhook: &Webhook) -> Response {
    let told = api::SecretWebhook {
        secret: secret.reveal(),
        what: api::Webhook::from(webhook),
    };
    ([(CACHE_CONTROL, "no-store")], Json(told)).into_response()
}

/// A message that will be sent.
fn accepted(delivery: &Delivery) -> Response {
    let location = [(LOCATION, format!("/v1/deliveries/{}", delivery.id))];
    let told = Json(api::Delivery::from(delivery));
    (StatusCode::ACCEPTED, location, told).into_response()
}

async fn without_members(app: &AppState, request: Request) -> Result<()> {
    let body = upload::json(app, request, JSON_LIMIT).await?;
    members_of("the body", Some(&body))?.finish()
}

fn no_webhook() -> ApiError {
    ApiError::not_found("webhook")
}

fn no_delivery() -> ApiError {
    ApiError::not_found("delivery")
}

/// For [`Members::take`]: an address that messages may go to.
fn address(app: &AppState, value: Value) -> std::result::Result<String, String> {
    let url = Policy::of(&app.config).url(&json::<String>(value)?)?;
    Ok(url.into())
}

/// For [`Members::take`]: what a webhook is told of.
fn events(value: Value) -> std::result::Result<Vec<News>, String> {
    let known = || News::ALL.map(News::name).join(", ");
    let mut events = Vec::new();
    for name in json::<Vec<String>>(value)? {
        let news = News::from_name(&name).filter(|news| News::ALL.contains(news));
        let news = news.ok_or_else(|| format!("{name} is unknown; known are: {}", known()))?;
        events.push(news);
    }
    if events.is_empty() {
        return Err(format!("must name at least one of {}", known()));
    }
    events.sort_unstable();
    events.dedup();
    Ok(events)
}
