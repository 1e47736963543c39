//! Batches: many clouds in one request, or many parts of them, with a job for each.

pub(in crate::http) mod request;

use std::time::Duration;

use axum::Json;
use axum::extract::{Request, State};
use axum::http::header::{LOCATION, RETRY_AFTER};
use axum::http::{HeaderValue, StatusCode, Uri};
use axum::response::{IntoResponse, Response};

use crate::http::AppState;
use crate::http::api;
use crate::http::resources::clouds::files::{self, Usable};
use crate::http::resources::jobs::erase;
use crate::http::resources::jobs::members_of;
use crate::http::resources::jobs::request::{JobRequest, preset_named};
use crate::http::resources::jobs::wait::{Patience, waited};
use crate::http::resources::retention::Wanted;
use crate::http::upload::bodies::JSON_LIMIT;
use crate::http::upload::{self, receive_several};
use crate::http::wire::error::{ApiError, Code, Result};
use crate::http::wire::extract::{Id, NoQuery, Query, kept, preferred_wait, switch};
use crate::http::wire::idempotency::{self, Begun, REPLAYED};
use crate::http::wire::page::{Page, PageOf};
use crate::identity::{Caller, Tenant};
use crate::jobs::{Batch, BatchId, Cloud, JobFilter, StoredResponse, Subject};
use crate::reconstruction::medical::Choice;
use crate::reconstruction::plan::Cost;
use request::{BatchRequest, MOST_JOBS, check_number};

/// Seconds after which it is worth to look again at a batch that goes on.
const LOOK_AGAIN: u32 = 2;

/// A cloud of a batch, and what is asked of it.
type Planned<T> = (T, Vec<(JobRequest, Cost)>);

/// `POST /v1/batches`: for clouds that are here, or with the clouds themselves.
pub(in crate::http) async fn create(
    State(app): State<AppState>,
    caller: Caller,
    mut query: Query,
    request: Request,
) -> Result<Response> {
    let preset = query.take("preset", |name| preset_named(&name));
    let source = query.take("source", |text| Choice::parse_several(&text));
    let assume_orientation = query.take("assume_orientation", switch).unwrap_or(false);
    let keep_identifiers = query.take("keep", kept).unwrap_or(false);
    let ttl = query.take("ttl", |text| Wanted::of_job(&text));
    query.finish()?;
    let wait = preferred_wait(request.headers());
    let mut key = idempotency::Request::new(&caller, request.headers(), request.uri())?;
    key.admit(&app).await?;
    let (mut uploads, body) = receive_several(&app, request, MOST_JOBS).await?;
    for upload in &mut uploads {
        upload.assume_orientation = assume_orientation;
        upload.keep_identifiers = keep_identifiers;
        key.content(upload.spooled.sha256.as_bytes());
    }
    key.content(body.as_deref().unwrap_or_default());
    let members = members_of("the request", body.as_deref())?;
    let asked = BatchRequest::new(members, (preset, source, ttl), uploads.len())?;
    let attempt = match key.begin(&app).await? {
        Begun::Replay(first) => return replayed(&app, &caller.tenant, first).await,
        Begun::New(attempt) => attempt,
    };
    let (mut sent, mut named) = (Vec::new(), Vec::new());
    for (place, upload) in (1..).zip(uploads) {
        let of_cloud = |error: ApiError| error.of_cloud(place);
        let usable = files::usable(&app, &caller.tenant, upload).await;
        let usable = usable.map_err(of_cloud)?;
        let jobs = asked.jobs(&app.config, &usable.summary).map_err(of_cloud)?;
        sent.push((usable, jobs));
    }
    for (place, id) in (1..).zip(&asked.clouds) {
        let cloud = app.store.of(&caller.tenant).cloud(id).await?;
        let missing = || {
            let pointer = format!("/clouds/{}", place - 1);
            ApiError::fault(
                Code::CloudMissing,
                &pointer,
                format!("there is no cloud {id}"),
            )
        };
        let cloud = cloud.ok_or_else(missing);
        let planned = cloud.and_then(|cloud| {
            let jobs = asked.jobs(&app.config, &cloud.summary)?;
            Ok((cloud, jobs))
        });
        named.push(planned.map_err(|error| error.of_cloud(place))?);
    }
    let jobs = sent.iter().map(|(_, jobs)| jobs.len());
    check_number(jobs.chain(named.iter().map(|(_, jobs)| jobs.len())).sum())?;
    // Only now, when all are known to be good, is any of them kept.
    named.extend(keep(&app, &caller, sent).await?);
    let of_cloud = |(cloud, jobs): Planned<Cloud>| {
        let config = &app.config;
        let new =
            move |(job, cost): (JobRequest, Cost)| job.of_cloud(cloud.id.clone(), &cost, config);
        jobs.into_iter().map(new)
    };
    let jobs = named.into_iter().flat_map(of_cloud).collect();
    let answered = attempt.with(|id: &BatchId| nameplate(StatusCode::ACCEPTED, id));
    let id = app.store.by(&caller).submit_batch(jobs, answered).await?;
    attempt.kept();
    let Some(wait) = wait else {
        let batch = find(&app, &caller.tenant, &id).await?;
        return answer(StatusCode::ACCEPTED, &batch);
    };
    let mut patience = Patience::new(&app, wait);
    let batch = loop {
        let batch = find(&app, &caller.tenant, &id).await?;
        if batch.is_final() || !patience.again().await {
            break batch;
        }
    };
    answered_in_time(&batch, wait)
}

/// `GET /v1/batches`: newest first, without their jobs.
pub(in crate::http) async fn list(
    State(app): State<AppState>,
    caller: Caller,
    uri: Uri,
    mut query: Query,
) -> Result<Response> {
    let page = Page::<BatchId>::of(&mut query);
    query.finish()?;
    let page = page?;
    let records = app.store.of(&caller.tenant);
    let found = records
        .list_batches(page.before.as_ref(), page.limit + 1)
        .await?;
    let PageOf { items, next } = page.cut(found, |batch| batch.id.to_string());
    Ok(next.answer(&uri, items.iter().map(api::Batch::listed).collect()))
}

/// `GET /v1/batches/{id}`: made to be polled.
pub(in crate::http) async fn show(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Id(id): Id<BatchId>,
) -> Result<Response> {
    let batch = find(&app, &caller.tenant, &id).await?;
    let mut response = answer(StatusCode::OK, &batch)?;
    response.headers_mut().remove(LOCATION);
    Ok(response)
}

/// `POST /v1/batches/{id}/cancel`: all jobs that have not ended.
pub(in crate::http) async fn cancel(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Id(id): Id<BatchId>,
    request: Request,
) -> Result<Response> {
    let mut key = idempotency::Request::new(&caller, request.headers(), request.uri())?;
    let body = upload::json(&app, request, JSON_LIMIT).await?;
    key.content(&body);
    members_of("the body", Some(&body))?.finish()?;
    let attempt = match key.begin(&app).await? {
        Begun::Replay(first) => return replayed(&app, &caller.tenant, first).await,
        Begun::New(attempt) => attempt,
    };
    if !app.store.by(&caller).cancel_batch(&id).await? {
        return Err(absent(&app, &caller.tenant, &id).await);
    }
    let location = [(LOCATION, url(&id))];
    let nameplate = (StatusCode::OK, location).into_response();
    attempt
        .keep(nameplate, Some(Subject::Batch(id.clone())))
        .await?;
    answer(StatusCode::OK, &find(&app, &caller.tenant, &id).await?)
}

/// `DELETE /v1/batches/{id}`: all its jobs, and their clouds where no other job names them. What is
/// held stays, and the batch with it.
pub(in crate::http) async fn erase(
    State(app): State<AppState>,
    caller: Caller,
    mut query: Query,
    Id(id): Id<BatchId>,
) -> Result<Response> {
    let clouds_too = query.take("clouds", switch).unwrap_or(true);
    query.finish()?;
    find(&app, &caller.tenant, &id).await?;
    let filter = JobFilter {
        batch_id: Some(id),
        ..JobFilter::default()
    };
    let erased = erase::all(&app, &caller, &filter, clouds_too).await?;
    Ok(Json(erased).into_response())
}

/// The batch of the given name.
///
/// # Errors
/// [`Code::NotFound`] and [`Code::Gone`].
pub(in crate::http) async fn find(app: &AppState, tenant: &Tenant, id: &BatchId) -> Result<Batch> {
    match app.store.of(tenant).batch(id).await? {
        Some(batch) => Ok(batch),
        None => Err(absent(app, tenant, id).await),
    }
}

/// Why there is no such batch: it was erased, or never here.
pub(in crate::http) async fn absent(app: &AppState, tenant: &Tenant, id: &BatchId) -> ApiError {
    ApiError::absent("batch", app.store.of(tenant).batch_tombstone(id).await)
}

/// Turns what was sent into clouds.
async fn keep(
    app: &AppState,
    caller: &Caller,
    sent: Vec<Planned<Usable>>,
) -> Result<Vec<Planned<Cloud>>> {
    let kept = Wanted::keep(None, app.config.cloud_ttl);
    let mut clouds = Vec::new();
    for (place, (usable, jobs)) in (1..).zip(sent) {
        let cloud = files::keep(app, caller, usable, kept).await;
        let (cloud, _) = cloud.map_err(|error| error.of_cloud(place))?;
        clouds.push((cloud, jobs));
    }
    Ok(clouds)
}

fn url(id: &BatchId) -> String {
    format!("/v1/batches/{id}")
}

/// What is kept under a key: the batch by name, and nothing of its jobs, which may be erased.
fn nameplate(status: StatusCode, id: &BatchId) -> StoredResponse {
    StoredResponse {
        status: status.as_u16(),
        headers: vec![(LOCATION.to_string(), url(id))],
        body: Vec::new(),
    }
}

/// The answer to a repeated request: that of the first one, with the batch as it is now.
async fn replayed(app: &AppState, tenant: &Tenant, first: Response) -> Result<Response> {
    let location = first.headers().get(LOCATION);
    let id = location.and_then(|url| url.to_str().ok()?.rsplit('/').next()?.parse().ok());
    let id = id.ok_or_else(|| ApiError::internal("a kept answer names no batch"))?;
    let mut response = answer(first.status(), &find(app, tenant, &id).await?)?;
    let replayed = HeaderValue::from_static("true");
    response.headers_mut().insert(REPLAYED, replayed);
    Ok(response)
}

/// The answer after a wait: 200 where all jobs have ended.
fn answered_in_time(batch: &Batch, wait: Duration) -> Result<Response> {
    let status = if batch.is_final() {
        StatusCode::OK
    } else {
        StatusCode::ACCEPTED
    };
    waited(answer(status, batch)?, wait)
}

/// The answer that shows a batch, with `Location` and, until it ends, `Retry-After`.
fn answer(status: StatusCode, batch: &Batch) -> Result<Response> {
    let mut response = (status, Json(api::Batch::whole(batch))).into_response();
    let location = HeaderValue::try_from(url(&batch.id)).map_err(ApiError::internal)?;
    let headers = response.headers_mut();
    headers.insert(LOCATION, location);
    if !batch.is_final() {
        headers.insert(RETRY_AFTER, HeaderValue::from(LOOK_AGAIN));
    }
    Ok(response)
}
