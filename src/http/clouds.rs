//! Clouds: uploaded, listed, described, fetched, erased.

use axum::Json;
use axum::extract::{Request, State};
use axum::http::header::{LINK, LOCATION};
use axum::http::{HeaderMap, StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};

use super::AppState;
use super::cloud_files;
use super::download::{Content, Download};
use super::error::{ApiError, Code, Result};
use super::extract::{Id, NoQuery, Query, switch};
use super::idempotency::{self, Begun};
use super::page::{Page, PageOf};
use super::time::rfc3339;
use super::upload::{Payload, receive};
use crate::jobs::{Cloud, CloudDeletion, CloudId, Subject};
use crate::reconstruction::cloud::Format;
use crate::reconstruction::space::Frame;

/// `POST /v1/clouds`: 201, or 200 when the same bytes are here already.
pub(super) async fn create(
    State(app): State<AppState>,
    mut query: Query,
    request: Request,
) -> Result<Response> {
    let assume_orientation = query.take("assume_orientation", switch).unwrap_or(false);
    query.finish()?;
    let mut key = idempotency::Request::new(request.headers(), request.uri())?;
    key.admit(&app).await?;
    let Payload::File(mut upload, None) = receive(&app, request).await? else {
        let detail = "send a point cloud, raw or as the only part, file, of a form";
        return Err(ApiError::new(Code::UnsupportedFormat, detail));
    };
    upload.assume_orientation = assume_orientation;
    key.content(upload.spooled.sha256.as_bytes());
    let attempt = match key.begin(&app).await? {
        Begun::Replay(response) => return Ok(response),
        Begun::New(attempt) => attempt,
    };
    let (cloud, created) = cloud_files::keep(&app, upload).await?;
    let status = if created {
        StatusCode::CREATED
    } else {
        StatusCode::OK
    };
    let location = [(LOCATION, format!("/v1/clouds/{}", cloud.id))];
    let response = (status, location, Json(represent(&cloud))).into_response();
    attempt.keep(response, Some(Subject::Cloud(cloud.id))).await
}

/// `GET /v1/clouds`: newest first.
pub(super) async fn list(
    State(app): State<AppState>,
    uri: Uri,
    mut query: Query,
) -> Result<Response> {
    let page = Page::<CloudId>::of(&mut query);
    query.finish()?;
    let page = page?;
    let found = app
        .store
        .list_clouds(page.before.as_ref(), page.limit + 1)
        .await?;
    let PageOf { items, next } = page.cut(found, |cloud| cloud.id.as_str());
    let items: Vec<Value> = items.iter().map(represent).collect();
    let body = Json(json!({"items": items, "next_cursor": next.cursor()}));
    Ok(match next.link(&uri) {
        Some(link) => ([(LINK, link)], body).into_response(),
        None => body.into_response(),
    })
}

/// `GET /v1/clouds/{id}`.
pub(super) async fn show(
    State(app): State<AppState>,
    _: NoQuery,
    Id(id): Id<CloudId>,
) -> Result<Json<Value>> {
    Ok(Json(represent(&find(&app, &id).await?)))
}

/// `GET /v1/clouds/{id}/content`: the bytes as they were uploaded.
pub(super) async fn content(
    State(app): State<AppState>,
    _: NoQuery,
    Id(id): Id<CloudId>,
    headers: HeaderMap,
) -> Result<Response> {
    let cloud = find(&app, &id).await?;
    let gzipped = cloud.summary["gzipped"] == json!(true);
    let ending = if gzipped { ".gz" } else { "" };
    let file_name = format!("{}.{}{ending}", cloud.id, extension(&cloud));
    let download = Download {
        content: Content::File {
            path: cloud_files::path(&app, &cloud.sha256),
            bytes: cloud.bytes,
        },
        sha256: cloud.sha256,
        media_type: "application/octet-stream",
        file_name,
    };
    download.respond(&headers).await
}

/// `DELETE /v1/clouds/{id}`.
pub(super) async fn erase(
    State(app): State<AppState>,
    _: NoQuery,
    Id(id): Id<CloudId>,
) -> Result<StatusCode> {
    match cloud_files::erase(&app, &id).await? {
        CloudDeletion::Deleted(_) => Ok(StatusCode::NO_CONTENT),
        CloudDeletion::InUse => Err(ApiError::new(
            Code::CloudInUse,
            "a job that waits or runs needs the cloud; cancel the job first",
        )
        .retry_after(10)),
        CloudDeletion::Missing => Err(absent(&app, &id).await),
    }
}

/// The ending of the name of its file.
fn extension(cloud: &Cloud) -> &str {
    let format = Format::from_extension(&format!("cloud.{}", cloud.format));
    match format {
        Some(format) => format.extension(),
        None => &cloud.format,
    }
}

async fn find(app: &AppState, id: &CloudId) -> Result<Cloud> {
    match app.store.cloud(id).await? {
        Some(cloud) => Ok(cloud),
        None => Err(absent(app, id).await),
    }
}

/// Why there is no such cloud: it was erased, or never here.
async fn absent(app: &AppState, id: &CloudId) -> ApiError {
    match app.store.cloud_tombstone(id).await {
        Ok(Some(tombstone)) => ApiError::gone("cloud", &tombstone),
        Ok(None) => ApiError::not_found("cloud"),
        Err(error) => error.into(),
    }
}

/// A cloud as JSON: its columns, and what its reading found.
fn represent(cloud: &Cloud) -> Value {
    let summary = |name: &str| cloud.summary.get(name).cloned().unwrap_or_default();
    // Clouds of earlier versions have none of the two.
    let or_unknown = |name: &str| match summary(name) {
        Value::Null => json!(Frame::Unknown),
        known => known,
    };
    let url = format!("/v1/clouds/{}", cloud.id);
    json!({
        "id": cloud.id,
        "sha256": cloud.sha256,
        "bytes": cloud.bytes,
        "format": cloud.format,
        "gzipped": summary("gzipped"),
        "points": cloud.points,
        "bounds": summary("bounds"),
        "normals": summary("normals"),
        "labels": summary("labels"),
        "frame": or_unknown("frame"),
        "unit": or_unknown("unit"),
        "dropped_non_finite": summary("dropped_non_finite"),
        "warnings": summary("warnings"),
        "segmentation": summary("segmentation"),
        "created_at": rfc3339(cloud.created_at),
        "links": {
            "self": url,
            "content": format!("{url}/content"),
            "jobs": format!("/v1/jobs?cloud_id={}", cloud.id),
        },
    })
}
