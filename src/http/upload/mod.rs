//! Reads request bodies: a raw file, a form, or JSON. Every wait for a client has a limit.

pub(in crate::http) mod bodies;
pub(in crate::http) mod parts;
mod sink;
pub(in crate::http) mod spool;

use std::os::unix::fs::FileExt;
use std::time::Duration;

use axum::body::{Body, BodyDataStream};
use axum::extract::multipart::{Field, MultipartError};
use axum::extract::{FromRequest, Multipart, Request};
use axum::http::header::{CONTENT_ENCODING, CONTENT_LENGTH, CONTENT_TYPE};
use axum::http::{HeaderMap, StatusCode};
use bytes::{Bytes, BytesMut};
use futures_util::StreamExt;
use tokio::sync::OwnedSemaphorePermit;

use crate::folder::UPLOADS;
use crate::http::AppState;
use crate::http::upload::bodies::{BATCH, Gathered, JSON_LIMIT, Pace};
use crate::http::upload::spool::{Encoding, Spool, Spooled, too_large};
use crate::http::wire::error::{ApiError, Code, Result};
use crate::http::wire::extract::header;
use crate::reconstruction::cloud::Format;

/// An uploaded file that is not a cloud yet.
#[derive(Debug)]
pub(in crate::http) struct Upload {
    /// The file.
    pub(in crate::http) spooled: Spooled,
    /// Format suggested by media type or file name, for contents that do not show theirs.
    pub(in crate::http) hint: Option<Format>,
    /// Whether a label map without an orientation is taken as it lies.
    pub(in crate::http) assume_orientation: bool,
    /// Whether patient and study are taken over into its meshes.
    pub(in crate::http) keep_identifiers: bool,
    /// Whether it came as the fields of a page's form, which curl says of what it sends with `-d`.
    pub(in crate::http) as_fields: bool,
}

impl Upload {
    /// A refusal of its content, with what clients that send no cloud at all may have meant.
    pub(in crate::http) fn explain(&self, error: ApiError) -> ApiError {
        let mut begin = [0; 64];
        let file = self.spooled.file.as_file();
        let read = file.read_at(&mut begin, 0).unwrap_or_default();
        if begin[..read].trim_ascii_start().starts_with(b"{") {
            error.and("a job as JSON is sent to /v1/jobs with Content-Type: application/json")
        } else if self.as_fields {
            error.and("curl sends a file as it is with --data-binary; -d leaves out its line ends")
        } else {
            error
        }
    }
}

/// What a request carries.
#[derive(Debug)]
pub(in crate::http) enum Payload {
    /// A JSON document.
    Json(Gathered),
    /// A file, and the `job` part of the form that it came in.
    File(Upload, Option<Gathered>),
}

/// The parts that a form may have.
#[derive(Debug, Clone, Copy)]
struct Parts {
    /// Name of a file, of which there is one or more.
    file: &'static str,
    /// Most files.
    most: usize,
    /// Name of the part of JSON, of which there may be one.
    json: &'static str,
}

/// What a form brought: files, and the part of JSON.
type Brought = (Vec<Upload>, Option<Gathered>);

/// Reads a body: a form or JSON if `Content-Type` says so, otherwise a raw file.
///
/// # Errors
/// What is wrong with headers, form, encoding, size or pace.
pub(in crate::http) async fn receive(app: &AppState, request: Request) -> Result<Payload> {
    let content_type = header(request.headers(), &CONTENT_TYPE)?.unwrap_or_default();
    let essence = content_type.split(';').next().unwrap_or_default().trim();
    match essence.to_ascii_lowercase().as_str() {
        "application/json" => json(app, request, JSON_LIMIT).await.map(Payload::Json),
        "multipart/form-data" => {
            let parts = Parts {
                file: "file",
                most: 1,
                json: "job",
            };
            let (mut files, job) = form(app, request, parts).await?;
            let only = files.pop();
            let only =
                only.ok_or_else(|| ApiError::internal("a form without a file was let in"))?;
            Ok(Payload::File(only, job))
        }
        essence => {
            let hint = Format::from_media_type(essence);
            let (parts, body) = request.into_parts();
            let spooled = raw(app, &parts.headers, body).await?;
            if spooled.bytes == 0 {
                let detail = "the body is empty: send the file itself, as curl does with \
                              --data-binary @cloud.ply";
                return Err(ApiError::new(Code::CloudEmpty, detail));
            }
            let as_fields = essence == "application/x-www-form-urlencoded";
            let upload = Upload {
                spooled,
                hint,
                as_fields,
                assume_orientation: false,
                keep_identifiers: false,
            };
            Ok(Payload::File(upload, None))
        }
    }
}

/// Reads a body with files, at most so many: a form, or JSON, which brings none.
///
/// # Errors
/// As [`receive`].
pub(in crate::http) async fn receive_several(
    app: &AppState,
    request: Request,
    most: usize,
) -> Result<Brought> {
    let content_type = header(request.headers(), &CONTENT_TYPE)?.unwrap_or_default();
    let essence = content_type.split(';').next().unwrap_or_default().trim();
    match essence.to_ascii_lowercase().as_str() {
        "application/json" => Ok((Vec::new(), Some(json(app, request, JSON_LIMIT).await?))),
        "multipart/form-data" => {
            let parts = Parts {
                file: "cloud",
                most,
                json: "request",
            };
            form(app, request, parts).await
        }
        _ => {
            let detail = "send a form with a part cloud for each file, as curl does with \
                          -F cloud=@a.ply -F cloud=@b.ply, or JSON that names clouds";
            Err(ApiError::new(Code::UnsupportedFormat, detail))
        }
    }
}

/// Reads a whole JSON body of at most `limit` bytes. An absent body gives no bytes.
///
/// # Errors
/// [`Code::BodyTooLarge`], [`Code::UnsupportedEncoding`], [`Code::UploadTimeout`],
/// [`Code::BodyBrokenOff`].
pub(in crate::http) async fn json(
    app: &AppState,
    request: Request,
    limit: usize,
) -> Result<Gathered> {
    let encoding = header(request.headers(), &CONTENT_ENCODING)?;
    if Encoding::of(encoding)? != Encoding::Identity {
        let detail = "a JSON body is taken without Content-Encoding";
        return Err(ApiError::new(Code::UnsupportedEncoding, detail));
    }
    let declared = length(request.headers())?;
    let mut body = app.bodies.gather(declared, limit).await?;
    let mut pace = pace(app);
    let mut stream = request.into_body().into_data_stream();
    while let Some(chunk) = next(&mut pace, &mut stream).await? {
        body.push(&chunk)?;
    }
    Ok(body)
}

async fn raw(app: &AppState, headers: &HeaderMap, body: Body) -> Result<Spooled> {
    let encoding = Encoding::of(header(headers, &CONTENT_ENCODING)?)?;
    let declared = length(headers)?.unwrap_or(0);
    let mut pace = pace(app);
    let mut receiver = Receiver::new(app, encoding, declared)?;
    let mut stream = body.into_data_stream();
    while let Some(chunk) = next(&mut pace, &mut stream).await? {
        receiver.push(&chunk).await?;
    }
    receiver.finish().await
}

async fn form(app: &AppState, request: Request, known: Parts) -> Result<Brought> {
    let encoding = header(request.headers(), &CONTENT_ENCODING)?;
    if Encoding::of(encoding)? != Encoding::Identity {
        let detail = "a form is taken without Content-Encoding; send the file itself encoded";
        return Err(ApiError::new(Code::UnsupportedEncoding, detail));
    }
    // Checked here too: a form is a little larger than its file.
    let declared = length(request.headers())?.unwrap_or(0);
    let mut pace = pace(app);
    app.disk.check(declared)?;
    let mut form = Multipart::from_request(request, &())
        .await
        .map_err(|error| ApiError::new(Code::MalformedMultipart, error.body_text()))?;
    let (mut files, mut document) = (Vec::new(), None);
    while let Some(mut part) = pace
        .wait(form.next_field())
        .await?
        .map_err(|error| broken(&error))?
    {
        let name = part.name().unwrap_or_default().to_owned();
        match name.as_str() {
            name if name == known.file && files.len() < known.most => {
                files.push(file_part(app, &mut pace, part).await?);
            }
            name if name == known.json && document.is_none() => {
                let mut body = app.bodies.gather(None, JSON_LIMIT).await?;
                while let Some(chunk) = next_of(&mut pace, &mut part).await? {
                    body.push(&chunk)?;
                }
                document = Some(body);
            }
            _ => {
                let Parts { file, most, json } = known;
                let files = match most {
                    1 => format!("one part named {file}"),
                    most => format!("1 to {most} parts named {file}"),
                };
                let detail =
                    format!("part {name:.40}: {files} and at most one named {json} are taken");
                return Err(ApiError::new(Code::MalformedMultipart, detail));
            }
        }
    }
    if files.is_empty() {
        let detail = format!("the form has no part {}", known.file);
        return Err(ApiError::new(Code::MalformedMultipart, detail));
    }
    Ok((files, document))
}

async fn file_part(app: &AppState, pace: &mut Pace, mut part: Field<'_>) -> Result<Upload> {
    let hint = part
        .content_type()
        .and_then(Format::from_media_type)
        .or_else(|| Format::from_extension(part.file_name()?));
    let mut receiver = Receiver::new(app, Encoding::Identity, 0)?;
    while let Some(chunk) = next_of(pace, &mut part).await? {
        receiver.push(&chunk).await?;
    }
    let spooled = receiver.finish().await?;
    Ok(Upload {
        spooled,
        hint,
        as_fields: false,
        assume_orientation: false,
        keep_identifiers: false,
    })
}

fn broken(error: &MultipartError) -> ApiError {
    match error.status() {
        StatusCode::PAYLOAD_TOO_LARGE => {
            ApiError::new(Code::BodyTooLarge, "the form is larger than allowed")
        }
        // Reading the connection failed; the form itself is not at fault.
        StatusCode::INTERNAL_SERVER_ERROR => broken_off(error),
        _ => ApiError::new(Code::MalformedMultipart, error.body_text()),
    }
}

/// `Content-Length`, if it is given.
fn length(headers: &HeaderMap) -> Result<Option<u64>> {
    let Some(length) = header(headers, &CONTENT_LENGTH)? else {
        return Ok(None);
    };
    let bytes = length.parse();
    bytes
        .map(Some)
        .map_err(|_| ApiError::new(Code::BadHeader, "Content-Length must be a number"))
}

fn pace(app: &AppState) -> Pace {
    let seconds = app.config.upload_timeout_seconds.max(1);
    Pace::new(Duration::from_secs(seconds.into()))
}

async fn next(pace: &mut Pace, stream: &mut BodyDataStream) -> Result<Option<Bytes>> {
    let chunk = pace.wait(stream.next()).await?.transpose();
    let chunk = chunk.map_err(|error| broken_off(&error))?;
    pace.came(chunk.as_ref().map_or(0, Bytes::len));
    Ok(chunk)
}

async fn next_of(pace: &mut Pace, part: &mut Field<'_>) -> Result<Option<Bytes>> {
    let chunk = pace.wait(part.chunk()).await?;
    let chunk = chunk.map_err(|error| broken(&error))?;
    pace.came(chunk.as_ref().map_or(0, Bytes::len));
    Ok(chunk)
}

/// The client is gone or its framing is broken. Hardly anyone will read this answer.
fn broken_off(error: &dyn std::error::Error) -> ApiError {
    tracing::debug!(error.message = %error, "a body broke off");
    ApiError::new(
        Code::BodyBrokenOff,
        "the body broke off before it was complete; send it again",
    )
}

/// Collects chunks into batches, which a blocking thread writes. No thread waits for a client, so a
/// thousand slow uploads occupy none.
struct Receiver {
    /// None while a thread writes.
    spool: Option<Spool>,
    batch: BytesMut,
    /// Permit to collect a batch; without one, every chunk is written at once.
    place: Option<OwnedSemaphorePermit>,
}

impl Receiver {
    fn new(app: &AppState, encoding: Encoding, declared: u64) -> Result<Self> {
        let limit = app.config.body_limit_bytes();
        if declared > limit {
            return Err(too_large(limit));
        }
        app.disk.check(declared)?;
        let folder = app.config.data_dir.join(UPLOADS);
        Ok(Self {
            spool: Some(Spool::new(&folder, encoding, limit)?),
            batch: BytesMut::new(),
            place: app.bodies.batch(),
        })
    }

    async fn push(&mut self, chunk: &[u8]) -> Result<()> {
        self.batch.extend_from_slice(chunk);
        if self.place.is_some() && self.batch.len() < BATCH {
            return Ok(());
        }
        self.write().await
    }

    async fn write(&mut self) -> Result<()> {
        let batch = self.batch.split();
        let mut spool = self.take()?;
        let spool = blocking(move || spool.push(&batch).map(|()| spool)).await??;
        self.spool = Some(spool);
        Ok(())
    }

    async fn finish(mut self) -> Result<Spooled> {
        let batch = self.batch.split();
        let mut spool = self.take()?;
        blocking(move || {
            spool.push(&batch)?;
            spool.finish()
        })
        .await?
    }

    /// The spool. It is missing only if the caller continued after an error.
    fn take(&mut self) -> Result<Spool> {
        let spool = self.spool.take();
        spool.ok_or_else(|| ApiError::internal("an upload went on after its end"))
    }
}

/// Runs blocking work on a thread for it.
pub(in crate::http) async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T> {
    tokio::task::spawn_blocking(work)
        .await
        .map_err(ApiError::internal)
}
