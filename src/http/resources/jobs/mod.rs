//! Jobs: submitted, listed, described, cancelled, tried again, erased.

pub(in crate::http) mod answer;
pub(in crate::http) mod cancel;
pub(in crate::http) mod erase;
pub(in crate::http) mod found;
pub(in crate::http) mod request;
mod source;
pub(in crate::http) mod wait;

use std::collections::HashMap;

use axum::Json;
use axum::extract::{Request, State};
use axum::http::header::LOCATION;
use axum::http::{HeaderMap, StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use serde_json::{Map, Value};

use crate::http::AppState;
use crate::http::api;
use crate::http::resources::clouds::files;
use crate::http::resources::jobs::answer::{answer, body, poll};
use crate::http::resources::jobs::found::{Found, found};
use crate::http::resources::jobs::request::{JobRequest, preset_named};
use crate::http::resources::jobs::source::source_named;
use crate::http::resources::jobs::wait::Wish;
use crate::http::resources::retention::{self, Wanted};
use crate::http::upload::bodies::JSON_LIMIT;
use crate::http::upload::{self, Payload, Upload, receive};
use crate::http::wire::error::{ApiError, Code, Result};
use crate::http::wire::extract::{Id, Members, NoQuery, Query, kept, switch, text};
use crate::http::wire::idempotency::{self, Attempt, Begun, kept_headers};
use crate::http::wire::page::{Page, PageOf};
use crate::identity::{Caller, Tenant};
use crate::jobs::{
    BatchId, Cloud, CloudId, Error, Job, JobFilter, JobId, NewJob, Status, StoredResponse, Subject,
    Verdict,
};

/// `POST /v1/jobs`: for a cloud that is here, or with the cloud itself.
pub(in crate::http) async fn create(
    State(app): State<AppState>,
    caller: Caller,
    mut query: Query,
    request: Request,
) -> Result<Response> {
    let dry_run = query.take("dry_run", switch).unwrap_or(false);
    let preset = query.take("preset", |name| preset_named(&name));
    let source = query.take("source", |text| source_named(&text));
    let assume_orientation = query.take("assume_orientation", switch).unwrap_or(false);
    let keep_identifiers = query.take("keep", kept).unwrap_or(false);
    let ttl = query.take("ttl", |text| Wanted::of_job(&text));
    query.finish()?;
    let wish = Wish::of(request.headers())?;
    let mut key = idempotency::Request::new(&caller, request.headers(), request.uri())?;
    if !dry_run {
        key.admit(&app).await?;
    }
    let (members, upload) = match receive(&app, request).await? {
        Payload::Json(body) => {
            key.content(&body);
            (Members::of(&body)?, None)
        }
        Payload::File(mut upload, job) => {
            upload.assume_orientation = assume_orientation;
            upload.keep_identifiers = keep_identifiers;
            key.content(upload.spooled.sha256.as_bytes());
            key.content(job.as_deref().unwrap_or_default());
            (members_of("part job", job.as_deref())?, Some(upload))
        }
    };
    let asked = JobRequest::new(members, (preset, source, ttl))?;
    check_one_cloud(&asked, upload.as_ref(), dry_run)?;
    let attempt = match key.begin(&app).await? {
        Begun::Replay(response) => return Ok(response),
        Begun::New(attempt) => attempt,
    };
    if dry_run {
        let response = estimate(&app, &caller.tenant, &asked, upload.as_ref()).await?;
        return attempt.keep(response, None).await;
    }
    let (cloud, cost) = match (upload, &asked.cloud_id) {
        (Some(upload), _) => {
            let keep = Wanted::keep(None, app.config.cloud_ttl);
            let usable = files::usable(&app, &caller.tenant, upload).await?;
            // Before it is kept: of a request that is refused nothing stays.
            let cost = asked.check(&app.config, Some(&usable.summary))?;
            (files::keep(&app, &caller, usable, keep).await?.0, cost)
        }
        (None, Some(id)) => {
            let cloud = find_cloud(&app, &caller.tenant, id).await?;
            let cost = asked.check(&app.config, Some(&cloud.summary))?;
            (cloud, cost)
        }
        (None, None) => return Err(ApiError::internal("a job without a cloud was let in")),
    };
    let new = asked.of_cloud(cloud.id, &cost, &app.config);
    let job = submit(&app, &caller, new, attempt).await?;
    wish.answer(&app, &caller, job).await
}

/// `GET /v1/jobs`: newest first, filtered by `status`, `label` (`key:value`), `cloud_id`, `batch_id`,
/// `verdict` and `created_after`.
pub(in crate::http) async fn list(
    State(app): State<AppState>,
    caller: Caller,
    uri: Uri,
    mut query: Query,
) -> Result<Response> {
    let page = Page::<JobId>::of(&mut query);
    let filter = JobFilter {
        status: query.take("status", |name| {
            Status::from_name(&name).ok_or_else(|| {
                let names = Status::ALL.map(Status::name).join(", ");
                format!("must be one of {names}")
            })
        }),
        cloud_id: query.take("cloud_id", text::<CloudId>),
        batch_id: query.take("batch_id", text::<BatchId>),
        label: query.take("label", |label| labelled(&label)),
        verdict: query.take("verdict", |name| {
            Verdict::from_name(&name).ok_or_else(|| {
                let names = Verdict::ALL.map(Verdict::name).join(", ");
                format!("must be one of {names}")
            })
        }),
        created_after: query.take("created_after", |value| api::milliseconds(&value)),
    };
    query.finish()?;
    let page = page?;
    let records = app.store.of(&caller.tenant);
    let listed = records
        .list_jobs(&filter, page.before.as_ref(), page.limit + 1)
        .await?;
    let PageOf { items, next } = page.cut(listed, |job| job.id.to_string());
    let waits = items.iter().any(|job| job.status == Status::Queued);
    let places = if waits {
        records.places().await?
    } else {
        HashMap::new()
    };
    let shown = items
        .iter()
        .map(|job| api::Job::new(job, places.get(&job.id).map(|place| app.shown(place))))
        .collect();
    Ok(next.answer(&uri, shown))
}

/// `GET /v1/jobs/{id}`: made to be polled.
pub(in crate::http) async fn show(
    State(app): State<AppState>,
    _: NoQuery,
    Found(job): Found,
    headers: HeaderMap,
) -> Result<Response> {
    poll(&headers, &job, place(&app, &job).await?)
}

/// `POST /v1/jobs/{id}/cancel`: whatever came first, the answer is the true state.
pub(in crate::http) async fn cancel(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Id(id): Id<JobId>,
    request: Request,
) -> Result<Response> {
    let mut key = idempotency::Request::new(&caller, request.headers(), request.uri())?;
    let body = upload::json(&app, request, JSON_LIMIT).await?;
    key.content(&body);
    members_of("the body", Some(&body))?.finish()?;
    let attempt = match key.begin(&app).await? {
        Begun::Replay(response) => return Ok(response),
        Begun::New(attempt) => attempt,
    };
    let job = found(app.store.by(&caller).request_cancel(&id).await?)?;
    let response = answer(StatusCode::OK, &job, None);
    attempt.keep(response, Some(Subject::Job(job.id))).await
}

/// `POST /v1/jobs/{id}/retry`: a new job from one that has ended.
pub(in crate::http) async fn retry(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Id(id): Id<JobId>,
    request: Request,
) -> Result<Response> {
    let wish = Wish::of(request.headers())?;
    let mut key = idempotency::Request::new(&caller, request.headers(), request.uri())?;
    key.admit(&app).await?;
    let body = upload::json(&app, request, JSON_LIMIT).await?;
    key.content(&body);
    let members = members_of("the body", Some(&body))?;
    let attempt = match key.begin(&app).await? {
        Begun::Replay(response) => return Ok(response),
        Begun::New(attempt) => attempt,
    };
    let job = found(app.store.of(&caller.tenant).job(&id).await?)?;
    if !job.status.is_final() {
        let detail = format!(
            "the job is {}; it can be tried again when it has ended",
            job.status
        );
        return Err(ApiError::new(Code::ResultNotReady, detail));
    }
    let asked = JobRequest::again(&job, members)?;
    let cloud = find_cloud(&app, &caller.tenant, &job.cloud_id).await?;
    let cost = asked.check(&app.config, Some(&cloud.summary))?;
    let new = asked.of_cloud(cloud.id, &cost, &app.config);
    let job = submit(&app, &caller, new, attempt).await?;
    wish.answer(&app, &caller, job).await
}

/// `PATCH /v1/jobs/{id}`: how long it is kept, whether it is held, and when it has its turn.
pub(in crate::http) async fn keep(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Id(id): Id<JobId>,
    request: Request,
) -> Result<Response> {
    found(app.store.of(&caller.tenant).job(&id).await?)?;
    let body = upload::json(&app, request, JSON_LIMIT).await?;
    let members = Members::of(&body)?;
    let change = retention::of_job(members, app.config.job_ttl)?;
    let job = found(app.store.by(&caller).keep_job(&id, change).await?)?;
    let place = place(&app, &job).await?;
    let mut response = answer(StatusCode::OK, &job, place);
    response.headers_mut().remove(LOCATION);
    Ok(response)
}

/// A label as lists name it.
///
/// # Errors
/// What is wrong with the text.
fn labelled(label: &str) -> std::result::Result<(String, String), String> {
    let (key, value) = label
        .split_once(':')
        .ok_or("must have the form key:value")?;
    Ok((key.to_owned(), value.to_owned()))
}

/// Puts the job into the queue; under a key its answer is kept in the same transaction.
async fn submit(app: &AppState, caller: &Caller, new: NewJob, attempt: Attempt) -> Result<Job> {
    let keep = attempt.with(|job: &Job| {
        let headers = answer(StatusCode::ACCEPTED, job, None);
        StoredResponse {
            status: StatusCode::ACCEPTED.as_u16(),
            headers: kept_headers(headers.headers()),
            body: body(job, None),
        }
    });
    let job = app.store.by(caller).submit(new, keep).await?;
    attempt.kept();
    Ok(job)
}

/// The answer to a dry run: what would be done, and what it would cost.
async fn estimate(
    app: &AppState,
    tenant: &Tenant,
    asked: &JobRequest,
    upload: Option<&Upload>,
) -> Result<Response> {
    let summary = match (upload, &asked.cloud_id) {
        (Some(upload), _) => Some(files::read(app, upload, None).await?),
        (None, Some(id)) => Some(find_cloud(app, tenant, id).await?.summary),
        (None, None) => None,
    };
    let body = api::DryRun {
        dry_run: true,
        cloud_id: asked.cloud_id.as_ref(),
        preset: asked.preset,
        settings: &asked.settings,
        estimate: asked.check(&app.config, summary.as_ref())?,
    };
    Ok(Json(body).into_response())
}

/// A request names its cloud or brings it along; a dry run may go without.
fn check_one_cloud(asked: &JobRequest, upload: Option<&Upload>, dry_run: bool) -> Result<()> {
    let refuse = |pointer, detail| Err(ApiError::fault(Code::RequestInvalid, pointer, detail));
    match (&asked.cloud_id, upload) {
        (Some(_), Some(_)) => refuse("/cloud_id", "is given, but a cloud was sent too"),
        (None, None) if !dry_run => refuse("/cloud_id", "is missing"),
        _ => Ok(()),
    }
}

/// The members of a part that may be empty.
///
/// # Errors
/// As [`Members::of`].
pub(in crate::http) fn members_of(part: &str, body: Option<&[u8]>) -> Result<Members> {
    match body {
        None | Some([]) => Ok(Map::<String, Value>::new().into()),
        Some(body) => Members::of_part(part, body),
    }
}

async fn find_cloud(app: &AppState, tenant: &Tenant, id: &CloudId) -> Result<Cloud> {
    let cloud = app.store.of(tenant).cloud(id).await?;
    cloud.ok_or_else(|| Error::CloudMissing(id.clone()).into())
}

/// Where a job stands while it waits.
pub(in crate::http) async fn place(app: &AppState, job: &Job) -> Result<Option<api::Place>> {
    if job.status != Status::Queued {
        return Ok(None);
    }
    let place = app.store.of(&job.tenant).place(&job.id).await?;
    Ok(place.map(|place| app.shown(&place)))
}
