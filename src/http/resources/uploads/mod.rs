//! Uploads that may go on after they were cut: begun, asked for, continued, given up. When all bytes
//! are there, one becomes a cloud as `POST /v1/clouds` would make it.

mod dialect;
pub(in crate::http) mod settle;

use axum::Json;
use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::header::{CONTENT_ENCODING, LINK, LOCATION};
use axum::http::{HeaderValue, Method, StatusCode};
use axum::response::{IntoResponse, Response};

use crate::http::AppState;
use crate::http::api;
use crate::http::resources::clouds;
use crate::http::upload::parts::{self, Held, Target};
use crate::http::upload::spool::Encoding;
use crate::http::wire::error::{ApiError, Code, Result};
use crate::http::wire::extract::{Id, NoQuery, Query, header, switch};
use crate::http::wire::request_id;
use crate::identity::{Caller, Tenant};
use crate::jobs::{NewUpload, Reason, Step, Upload, UploadEnd, UploadId};
use dialect::{Asked, OFFSET, told};
use tracing::Instrument;

/// Most uploads of a tenant that are not complete.
pub(in crate::http) const MOST_OPEN: u32 = 256;

/// `OPTIONS /v1/uploads`: what is spoken here.
pub(in crate::http) async fn options(State(app): State<AppState>) -> Result<Response> {
    let mut response = StatusCode::NO_CONTENT.into_response();
    for (name, value) in dialect::offered(&app) {
        let value = HeaderValue::try_from(value).map_err(ApiError::internal)?;
        response.headers_mut().insert(name, value);
    }
    Ok(response)
}

/// `POST /v1/uploads`: begins an upload, with its first bytes or without.
pub(in crate::http) async fn create(
    State(app): State<AppState>,
    caller: Caller,
    mut query: Query,
    request: Request,
) -> Result<Response> {
    let assume_orientation = query.take("assume_orientation", switch).unwrap_or(false);
    query.finish()?;
    let (head, body) = request.into_parts();
    let asked = Asked::creation(&head.headers)?;
    check_plain(&head.headers)?;
    app.check_accepting()?;
    let length = asked.length(None, app.config.body_limit_bytes())?;
    app.disk.check(length.unwrap_or(0))?;
    let id = UploadId::at(app.store.now());
    parts::make(&app, &id).await?;
    let new = NewUpload {
        id: id.clone(),
        length,
        hint: dialect::hint(&head.headers),
        assume_orientation,
        keep_ms: app.config.upload_keep_ms(),
    };
    let begun = app.store.by(&caller).begin_upload(new, MOST_OPEN).await;
    let Some(upload) = begun? else {
        parts::remove(&app, &id).await;
        let detail = format!(
            "{MOST_OPEN} uploads are open; finish some, erase them, or wait for their ends"
        );
        return Err(ApiError::new(Code::Quota, detail).retry_after(60));
    };
    promise(&app).await;
    let turn = app.turns.take(&id).await?;
    let to = id.clone();
    let mut response = detached(async move {
        let received = receive(&app, &caller, (upload, &asked), (body, &turn)).await;
        if received.is_err() {
            // Nobody knows its name yet.
            give_up(&app, &caller, &to, Reason::Deleted).await?;
        }
        let answered = answer(&app, &caller, &asked, received?).await;
        drop(turn);
        answered
    })
    .await?;
    // What came of the whole file has an address of its own.
    if !response.headers().contains_key(LOCATION) {
        if response.status() == StatusCode::NO_CONTENT {
            *response.status_mut() = StatusCode::CREATED;
        }
        let location = HeaderValue::try_from(format!("/v1/uploads/{id}"));
        let location = location.map_err(ApiError::internal)?;
        response.headers_mut().insert(LOCATION, location);
    }
    Ok(response)
}

/// `GET /v1/uploads/{id}`, and `HEAD`, which ends a request that still brings bytes: the offset of its
/// answer stays true.
pub(in crate::http) async fn show(
    State(app): State<AppState>,
    caller: Caller,
    method: Method,
    _: NoQuery,
    Id(id): Id<UploadId>,
) -> Result<Response> {
    let mut upload = find(&app, &caller.tenant, &id).await?;
    if method == Method::HEAD {
        let turn = app.turns.take(&id).await?;
        upload = find(&app, &caller.tenant, &id).await?;
        drop(turn);
    }
    let response = Json(api::Upload::from(&upload)).into_response();
    told(&app, &upload, response)
}

/// `PATCH /v1/uploads/{id}`: goes on behind what is there.
pub(in crate::http) async fn append(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Id(id): Id<UploadId>,
    request: Request,
) -> Result<Response> {
    find(&app, &caller.tenant, &id).await?;
    let (head, body) = request.into_parts();
    let asked = Asked::append(&head.headers)?;
    check_plain(&head.headers)?;
    if app.shutdown.is_cancelled() {
        app.check_accepting()?;
    }
    detached(async move {
        let turn = app.turns.take(&id).await?;
        let upload = find(&app, &caller.tenant, &id).await?;
        if asked.offset != upload.bytes {
            return Err(elsewhere(&asked, &upload));
        }
        let received = receive(&app, &caller, (upload, &asked), (body, &turn)).await?;
        let answered = answer(&app, &caller, &asked, received).await;
        drop(turn);
        answered
    })
    .await
}

/// `DELETE /v1/uploads/{id}`: gives it up. A cloud that came of it stays.
pub(in crate::http) async fn erase(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Id(id): Id<UploadId>,
) -> Result<StatusCode> {
    find(&app, &caller.tenant, &id).await?;
    let _turn = app.turns.take(&id).await?;
    if give_up(&app, &caller, &id, Reason::Deleted).await? {
        Ok(StatusCode::NO_CONTENT)
    } else {
        Err(absent(&app, &caller.tenant, &id).await)
    }
}

/// Runs work to its end, also where the client hangs up: what it sent is kept.
async fn detached(
    work: impl Future<Output = Result<Response>> + Send + 'static,
) -> Result<Response> {
    let id = request_id::current().unwrap_or_default();
    let work = request_id::within(id, work).in_current_span();
    tokio::spawn(work).await.map_err(ApiError::internal)?
}

/// Appends the body to an upload, which is at the place that the request names.
async fn receive(
    app: &AppState,
    caller: &Caller,
    (mut upload, asked): (Upload, &Asked),
    (body, turn): (Body, &Held),
) -> Result<Upload> {
    let most = app.config.body_limit_bytes();
    if upload.complete {
        // A last answer that was lost is asked for again by a request without bytes.
        return match asked.own {
            Some(0) => Ok(upload),
            _ => Err(ApiError::new(
                Code::UploadLength,
                "the upload is complete; no more bytes are taken",
            )),
        };
    }
    let length = asked.length(upload.length, most)?;
    app.disk.check_promised(asked.own.unwrap_or(0))?;
    let target = Target {
        caller,
        upload: &mut upload,
        length,
        cut: &turn.cut,
    };
    let outcome = match parts::append(app, target, body).await {
        Err(error) if error.code() == Code::Gone => {
            give_up(app, caller, &upload.id, Reason::Lost).await?;
            return Err(error);
        }
        appended => appended?,
    };
    promise(app).await;
    if let Err(error) = outcome {
        // More bytes than there may be: what came before them is of no use.
        if error.code() == Code::UploadLength {
            give_up(app, caller, &upload.id, Reason::Deleted).await?;
        }
        return Err(error);
    }
    let at = upload.bytes;
    let complete = if asked.tus {
        length == Some(at)
    } else {
        asked.last
    };
    if !complete {
        return Ok(upload);
    }
    if length.is_some_and(|length| length != at) {
        let detail = "the last bytes came, and fewer than were announced";
        return Err(ApiError::new(Code::UploadLength, detail));
    }
    let last = Step {
        from: at,
        to: at,
        length: Some(at),
        complete: true,
        keep_ms: app.config.upload_keep_ms(),
    };
    let upload = app
        .store
        .by(caller)
        .advance_upload(&upload.id, last)
        .await?;
    promise(app).await;
    Ok(upload)
}

/// The answer to a request that brought bytes; that to the last ones says what came of all.
async fn answer(
    app: &AppState,
    caller: &Caller,
    asked: &Asked,
    upload: Upload,
) -> Result<Response> {
    if !upload.complete {
        return told(app, &upload, StatusCode::NO_CONTENT.into_response());
    }
    let (end, created) = match settle::settle(app, caller, &upload).await {
        Ok(settled) => settled,
        Err(error) => return told(app, &upload, error.into_response()),
    };
    let cloud = match end {
        UploadEnd::Refused(problem) => {
            return told(app, &upload, ApiError::from(&problem).into_response());
        }
        UploadEnd::Cloud(id) => clouds::find(app, &caller.tenant, &id).await?,
    };
    let address = format!("/v1/clouds/{}", cloud.id);
    if asked.tus {
        let link = [(LINK, format!("<{address}>; rel=\"related\""))];
        return told(app, &upload, (StatusCode::NO_CONTENT, link).into_response());
    }
    let status = if created {
        StatusCode::CREATED
    } else {
        StatusCode::OK
    };
    let response = (
        status,
        [(LOCATION, address)],
        Json(api::Cloud::from(&cloud)),
    );
    told(app, &upload, response.into_response())
}

/// Erases an upload, row first; whether it was there.
pub(super) async fn give_up(
    app: &AppState,
    caller: &Caller,
    id: &UploadId,
    reason: Reason,
) -> Result<bool> {
    let erased = app.store.by(caller).erase_upload(id, reason).await?;
    parts::remove(app, id).await;
    promise(app).await;
    Ok(erased)
}

/// Sets room aside for what was announced and has not come.
pub(in crate::http) async fn promise(app: &AppState) {
    match app.store.announced_bytes().await {
        Ok(bytes) => app.disk.promise(bytes),
        Err(error) => tracing::warn!(error.message = %error, "announced uploads were not counted"),
    }
}

async fn find(app: &AppState, tenant: &Tenant, id: &UploadId) -> Result<Upload> {
    match app.store.of(tenant).upload(id).await? {
        Some(upload) => Ok(upload),
        None => Err(absent(app, tenant, id).await),
    }
}

/// Why there is no such upload: it was given up, its time was over, or it never was here.
async fn absent(app: &AppState, tenant: &Tenant, id: &UploadId) -> ApiError {
    ApiError::absent("upload", app.store.of(tenant).upload_tombstone(id).await)
}

fn elsewhere(asked: &Asked, upload: &Upload) -> ApiError {
    let (given, there) = (asked.offset, upload.bytes);
    let detail = format!("the upload goes on at {there}, not at {given}");
    ApiError::new(Code::UploadOffset, detail)
        .with("expected-offset", there.into())
        .with("provided-offset", given.into())
        .with_header(OFFSET, HeaderValue::from(there))
}

fn check_plain(headers: &axum::http::HeaderMap) -> Result<()> {
    if Encoding::of(header(headers, &CONTENT_ENCODING)?)? == Encoding::Identity {
        return Ok(());
    }
    let detail = "an upload that may go on is taken without Content-Encoding; gzip the file itself";
    Err(ApiError::new(Code::UnsupportedEncoding, detail))
}
