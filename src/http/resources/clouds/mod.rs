//! Clouds: uploaded, listed, described, fetched, erased.

pub(in crate::http) mod files;
pub(in crate::http) mod points;

use axum::Json;
use axum::extract::{Request, State};
use axum::http::header::LOCATION;
use axum::http::{HeaderMap, StatusCode, Uri};
use axum::response::{IntoResponse, Response};

use crate::http::AppState;
use crate::http::api;
use crate::http::resources::retention::{self, Wanted};
use crate::http::resources::witness::witnessed;
use crate::http::upload::bodies::JSON_LIMIT;
use crate::http::upload::{self, Payload, receive};
use crate::http::wire::download::{Content, Download};
use crate::http::wire::error::{ApiError, Code, Result};
use crate::http::wire::extract::{Id, Members, NoQuery, Query, kept, switch};
use crate::http::wire::idempotency::{self, Begun};
use crate::http::wire::page::{Page, PageOf};
use crate::identity::{Caller, Tenant};
use crate::jobs::{Act, Cloud, CloudDeletion, CloudId, Subject};

/// `POST /v1/clouds`: 201, or 200 when the same bytes are here already.
pub(in crate::http) async fn create(
    State(app): State<AppState>,
    caller: Caller,
    mut query: Query,
    request: Request,
) -> Result<Response> {
    let assume_orientation = query.take("assume_orientation", switch).unwrap_or(false);
    let keep_identifiers = query.take("keep", kept).unwrap_or(false);
    let ttl = query.take("ttl", |text| Wanted::of_cloud(&text));
    query.finish()?;
    let mut key = idempotency::Request::new(&caller, request.headers(), request.uri())?;
    key.admit(&app).await?;
    let Payload::File(mut upload, None) = receive(&app, request).await? else {
        let detail = "send a point cloud, raw or as the only part, file, of a form";
        return Err(ApiError::new(Code::UnsupportedFormat, detail));
    };
    upload.assume_orientation = assume_orientation;
    upload.keep_identifiers = keep_identifiers;
    key.content(upload.spooled.sha256.as_bytes());
    let attempt = match key.begin(&app).await? {
        Begun::Replay(response) => return Ok(response),
        Begun::New(attempt) => attempt,
    };
    let usable = files::usable(&app, &caller.tenant, upload).await?;
    let keep = Wanted::keep(ttl, app.config.cloud_ttl);
    let (cloud, created) = files::keep(&app, &caller, usable, keep).await?;
    let status = if created {
        StatusCode::CREATED
    } else {
        StatusCode::OK
    };
    let location = [(LOCATION, format!("/v1/clouds/{}", cloud.id))];
    let response = (status, location, Json(api::Cloud::from(&cloud))).into_response();
    attempt.keep(response, Some(Subject::Cloud(cloud.id))).await
}

/// `GET /v1/clouds`: newest first.
pub(in crate::http) async fn list(
    State(app): State<AppState>,
    caller: Caller,
    uri: Uri,
    mut query: Query,
) -> Result<Response> {
    let page = Page::<CloudId>::of(&mut query);
    query.finish()?;
    let page = page?;
    let records = app.store.of(&caller.tenant);
    let found = records
        .list_clouds(page.before.as_ref(), page.limit + 1)
        .await?;
    let PageOf { items, next } = page.cut(found, |cloud| cloud.id.to_string());
    Ok(next.answer(&uri, items.iter().map(api::Cloud::from).collect()))
}

/// `GET /v1/clouds/{id}`.
pub(in crate::http) async fn show(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Id(id): Id<CloudId>,
) -> Result<Response> {
    let cloud = find(&app, &caller.tenant, &id).await?;
    Ok(Json(api::Cloud::from(&cloud)).into_response())
}

/// `GET /v1/clouds/{id}/content`: the bytes as they are kept.
pub(in crate::http) async fn content(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Id(id): Id<CloudId>,
    headers: HeaderMap,
) -> Result<Response> {
    let cloud = find(&app, &caller.tenant, &id).await?;
    let ending = if cloud.summary.gzipped { ".gz" } else { "" };
    let download = Download {
        content: match cloud.object {
            Some(object) => Content::Stored {
                store: app.store.clone(),
                object,
                bytes: cloud.bytes,
            },
            None => Content::File {
                path: app.store.cloud_path(&cloud.sha256),
                bytes: cloud.bytes,
            },
        },
        sha256: cloud.sha256,
        media_type: "application/octet-stream",
        file_name: format!("{}.{}{ending}", cloud.id, cloud.summary.format.extension()),
    };
    let response = download.respond(&headers).await?;
    witnessed(&app, &caller, (Act::CloudRead, id.as_str()), response).await
}

/// `PATCH /v1/clouds/{id}`: how long it is kept, and whether it is held.
pub(in crate::http) async fn keep(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Id(id): Id<CloudId>,
    request: Request,
) -> Result<Response> {
    find(&app, &caller.tenant, &id).await?;
    let body = upload::json(&app, request, JSON_LIMIT).await?;
    let change = retention::change(Members::of(&body)?, Wanted::of_cloud, None, None)?;
    match app.store.by(&caller).keep_cloud(&id, change).await? {
        Some(cloud) => Ok(Json(api::Cloud::from(&cloud)).into_response()),
        None => Err(absent(&app, &caller.tenant, &id).await),
    }
}

/// `DELETE /v1/clouds/{id}`.
pub(in crate::http) async fn erase(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Id(id): Id<CloudId>,
) -> Result<StatusCode> {
    match files::erase(&app, &caller, &id).await? {
        CloudDeletion::Deleted(_) => Ok(StatusCode::NO_CONTENT),
        CloudDeletion::InUse => Err(ApiError::new(
            Code::CloudInUse,
            "a job that waits or runs needs the cloud; cancel the job first",
        )
        .retry_after(10)),
        CloudDeletion::Missing => Err(absent(&app, &caller.tenant, &id).await),
    }
}

pub(in crate::http) async fn find(app: &AppState, tenant: &Tenant, id: &CloudId) -> Result<Cloud> {
    match app.store.of(tenant).cloud(id).await? {
        Some(cloud) => Ok(cloud),
        None => Err(absent(app, tenant, id).await),
    }
}

/// Why there is no such cloud: it was erased, or never here.
async fn absent(app: &AppState, tenant: &Tenant, id: &CloudId) -> ApiError {
    ApiError::absent("cloud", app.store.of(tenant).cloud_tombstone(id).await)
}
