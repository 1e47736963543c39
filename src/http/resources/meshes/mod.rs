//! What a job made: its mesh and snapshots in every format, its report, its network.

pub(in crate::http) mod cache;
mod rendition;

use axum::Json;
use axum::extract::{FromRequestParts, State};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Uri, header};
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};

use rendition::{Look, Rendition};

use crate::http::AppState;
use crate::http::api;
use crate::http::resources::jobs::found::{Found, Succeeded, found};
use crate::http::resources::retention::counted;
use crate::http::resources::witness::witnessed;
use crate::http::wire::accept::preferred;
use crate::http::wire::download::{Content, Download};
use crate::http::wire::error::{ApiError, Code, Result};
use crate::http::wire::extract::{NoQuery, Query};
use crate::identity::Caller;
use crate::jobs::{Act, Job, MeshInfo, Verdict};
use crate::reconstruction::mesh::write::{Colors, Format};
use crate::reconstruction::space::Frame;

/// Header that says how far the mesh can be relied on.
const VERDICT: HeaderName = HeaderName::from_static("meshway-verdict");

/// Media types of meshes for `Accept`, the default first. PLY, OFF and VTP have no registered type,
/// so several are understood.
const OFFERS: [(&str, Format); 10] = [
    ("application/x-ply", Format::PlyBinary),
    ("model/ply", Format::PlyBinary),
    ("model/obj", Format::Obj),
    ("model/stl", Format::Stl),
    ("application/x-off", Format::Off),
    ("model/gltf-binary", Format::Glb),
    ("model/3mf", Format::ThreeMf),
    ("application/x-vtp", Format::Vtp),
    ("application/dicom", Format::Dicom),
    ("application/octet-stream", Format::PlyBinary),
];

/// File endings in addresses.
const ENDINGS: [(&str, Format); 8] = [
    ("ply", Format::PlyBinary),
    ("obj", Format::Obj),
    ("stl", Format::Stl),
    ("off", Format::Off),
    ("glb", Format::Glb),
    ("3mf", Format::ThreeMf),
    ("vtp", Format::Vtp),
    ("dcm", Format::Dicom),
];

/// GET /v1/jobs/{id}/mesh
pub(in crate::http) async fn negotiated(
    State(app): State<AppState>,
    caller: Caller,
    view: View,
    Succeeded(job): Succeeded,
    headers: HeaderMap,
) -> Result<Response> {
    let asked = (accepted(&headers)?, view);
    let response = respond(&app, &job, 0, asked, &headers).await.map(varies)?;
    let response = counted(&app, &job, response);
    witnessed(&app, &caller, (Act::MeshRead, job.id.as_str()), response).await
}

/// GET /v1/jobs/{id}/mesh.{format}
pub(in crate::http) async fn result(
    State(app): State<AppState>,
    caller: Caller,
    view: View,
    Succeeded(job): Succeeded,
    parts: Parts,
) -> Result<Response> {
    let (_, ending) = last_segment(&parts.uri);
    let format = ending.and_then(by_ending).ok_or_else(no_format)?;
    let response = respond(&app, &job, 0, (format, view), &parts.headers).await?;
    let response = counted(&app, &job, response);
    witnessed(&app, &caller, (Act::MeshRead, job.id.as_str()), response).await
}

/// GET /v1/jobs/{id}/mask.nii.gz
pub(in crate::http) async fn mask(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Succeeded(job): Succeeded,
    headers: HeaderMap,
) -> Result<Response> {
    let report = job.report.as_ref().unwrap_or(&Value::Null);
    let missing = |why| ApiError::new(Code::NotFound, format!("the job has no mask: {why}"));
    let grid = serde_json::from_value(report["grid"].clone());
    let grid = grid.map_err(|_| missing("its cloud is no label map, so there are no voxels"))?;
    if report["mesh"]["closed"] != json!(true) {
        return Err(missing("its mesh is not closed, so it has no inside"));
    }
    let mesh = stored(&app, &job, 0).await?;
    let rendition = Rendition::Mask(grid, job.id.to_string());
    let (content, sha256) = app.meshes.get(&app.store, &job, &mesh, rendition).await?;
    let download = Download {
        content,
        sha256,
        media_type: "application/gzip",
        file_name: format!("{}.nii.gz", job.id),
    };
    let response = deliver(&app, &job, download, &headers).await?;
    witnessed(&app, &caller, (Act::MeshRead, job.id.as_str()), response).await
}

/// GET /v1/jobs/{id}/snapshots
pub(in crate::http) async fn snapshots(
    State(app): State<AppState>,
    _: NoQuery,
    Found(job): Found,
) -> Result<Response> {
    let snapshots = app.store.of(&job.tenant).snapshots(&job.id).await?;
    let body = api::JobItems {
        job_id: &job.id,
        items: snapshots.iter().map(|mesh| describe(&job, mesh)).collect(),
    };
    Ok(Json(body).into_response())
}

/// GET /v1/jobs/{id}/snapshots/{file}: an evaluation, and the ending of a format.
pub(in crate::http) async fn snapshot(
    State(app): State<AppState>,
    caller: Caller,
    view: View,
    Found(job): Found,
    parts: Parts,
) -> Result<Response> {
    let (stem, ending) = last_segment(&parts.uri);
    let no_snapshot = || ApiError::not_found("snapshot");
    let evaluation: u64 = stem.parse().map_err(|_| no_snapshot())?;
    if evaluation == 0 {
        return Err(no_snapshot());
    }
    let format = match ending {
        None => accepted(&parts.headers)?,
        Some(ending) => by_ending(ending).ok_or_else(no_format)?,
    };
    let mut response = respond(&app, &job, evaluation, (format, view), &parts.headers).await?;
    if ending.is_none() {
        response = varies(response);
    }
    witnessed(&app, &caller, (Act::MeshRead, job.id.as_str()), response).await
}

/// GET /v1/jobs/{id}/report
pub(in crate::http) async fn report(_: NoQuery, Succeeded(job): Succeeded) -> Response {
    Json(job.report).into_response()
}

/// GET /v1/jobs/{id}/model
pub(in crate::http) async fn model(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Succeeded(job): Succeeded,
    headers: HeaderMap,
) -> Result<Response> {
    let model = app.store.of(&job.tenant).model(&job.id).await?;
    let (bytes, sha256) = model.ok_or_else(|| ApiError::not_found("model"))?;
    let download = Download {
        content: Content::Memory(bytes.into()),
        sha256,
        media_type: "application/octet-stream",
        file_name: format!("{}.safetensors", job.id),
    };
    let response = download.respond(&headers).await?;
    witnessed(&app, &caller, (Act::ModelRead, job.id.as_str()), response).await
}

/// How a mesh is asked for, whatever its format.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::http) struct View {
    /// `space`; none for the frame of the cloud.
    frame: Option<Frame>,
    /// `colors`: by the distances to the points.
    colors: bool,
}

impl View {
    /// With the format and the scale of colours that the job's report gives.
    ///
    /// # Errors
    /// [`Code::RequestInvalid`] where the format, or the job as it is now, does not have what is asked for.
    fn in_format(self, format: Format, job: &Job) -> Result<Look> {
        let refused = |name, detail| Err(ApiError::fault(Code::RequestInvalid, name, detail));
        if format == Format::Dicom && self.frame == Some(Frame::Ras) {
            return refused("/space", "a DICOM file is in lps, always");
        }
        let mut look = Look {
            format,
            frame: self.frame,
            colors: None,
        };
        if !self.colors {
            return Ok(look);
        }
        if !format.has_colors() {
            return refused("/colors", "only ply and glb have colours");
        }
        let report = job.report.as_ref();
        let most = report.and_then(|report| report["surface"]["support_distance"].as_f64());
        look.colors = most.and_then(Colors::up_to);
        if look.colors.is_none() {
            let detail = "the scale of the colours is `surface.support_distance` of the report, which is not there; \
                          a job that succeeds has it at its end";
            return refused("/colors", detail);
        }
        Ok(look)
    }
}

impl FromRequestParts<AppState> for View {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, app: &AppState) -> Result<Self> {
        let mut query = Query::from_request_parts(parts, app).await?;
        let frame = query.take("space", |name| match name.as_str() {
            "source" => Ok(None),
            "lps" => Ok(Some(Frame::Lps)),
            "ras" => Ok(Some(Frame::Ras)),
            _ => Err("must be one of source, lps, ras".to_owned()),
        });
        let colors = query.take("colors", |name| match name.as_str() {
            "none" => Ok(false),
            "distance" => Ok(true),
            _ => Err("must be one of none, distance".to_owned()),
        });
        query.finish()?;
        Ok(Self {
            frame: frame.flatten(),
            colors: colors.unwrap_or_default(),
        })
    }
}

/// The mesh of an evaluation, 0 for the result, as a download in a format.
///
/// # Errors
/// [`Code::RequestInvalid`] of what cannot be shown, [`Code::NotFound`], [`Code::Gone`], and those of encoding and download.
pub(in crate::http) async fn respond(
    app: &AppState,
    job: &Job,
    evaluation: u64,
    (format, view): (Format, View),
    headers: &HeaderMap,
) -> Result<Response> {
    let look = view.in_format(format, job)?;
    let mesh = stored(app, job, evaluation).await?;
    // That on a result is in its report, that on a snapshot came with it.
    let verdict = match evaluation {
        0 => job.report.as_ref().and_then(Verdict::of),
        _ => mesh.verdict,
    };
    let (content, sha256) = if look.is_stored() {
        let (store, sha256) = (app.store.clone(), mesh.sha256.clone());
        let content = Content::Stored {
            store,
            object: mesh.object,
            bytes: mesh.bytes,
        };
        (content, sha256)
    } else {
        let rendition = Rendition::of(job, evaluation, look);
        app.meshes.get(&app.store, job, &mesh, rendition).await?
    };
    let stem = match evaluation {
        0 => job.id.to_string(),
        evaluation => format!("{}-{evaluation}", job.id),
    };
    let download = Download {
        content,
        sha256,
        media_type: format.media_type(),
        file_name: format!("{stem}.{}", format.extension()),
    };
    let response = deliver(app, job, download, headers).await?;
    Ok(judged(response, verdict))
}

async fn stored(app: &AppState, job: &Job, evaluation: u64) -> Result<MeshInfo> {
    let mesh = app
        .store
        .of(&job.tenant)
        .mesh_info(&job.id, evaluation)
        .await?;
    mesh.ok_or_else(|| ApiError::not_found("mesh"))
}

async fn deliver(
    app: &AppState,
    job: &Job,
    download: Download,
    headers: &HeaderMap,
) -> Result<Response> {
    match download.respond(headers).await {
        Ok(response) => Ok(response),
        // The bytes are gone where the job was erased since it was found.
        Err(error) => found(app.store.of(&job.tenant).job(&job.id).await?).and(Err(error)),
    }
}

/// The format that the client names or accepts.
///
/// # Errors
/// [`Code::NotAcceptable`] with the list of formats.
fn accepted(headers: &HeaderMap) -> Result<Format> {
    preferred(headers, &OFFERS).ok_or_else(|| not_acceptable(&[]))
}

/// The format where the client prefers a mesh to the job's own JSON.
///
/// # Errors
/// [`Code::NotAcceptable`] where it accepts neither.
pub(in crate::http) fn preferred_to_json(headers: &HeaderMap) -> Result<Option<Format>> {
    const JSON: &str = "application/json";
    let meshes = OFFERS.map(|(media_type, format)| (media_type, Some(format)));
    let offers = [&[(JSON, None)], meshes.as_slice()].concat();
    preferred(headers, &offers).ok_or_else(|| not_acceptable(&[JSON]))
}

fn not_acceptable(besides: &[&str]) -> ApiError {
    let meshes = ENDINGS.map(|(_, format)| format.media_type());
    let types = [besides, meshes.as_slice()].concat();
    let detail = format!("the answer is given as {}", types.join(", "));
    ApiError::new(Code::NotAcceptable, detail).with("acceptable", types.into())
}

fn by_ending(ending: &str) -> Option<Format> {
    let found = ENDINGS.iter().find(|(name, _)| *name == ending);
    found.map(|(_, format)| *format)
}

fn no_format() -> ApiError {
    let endings = ENDINGS.map(|(name, _)| name).join(", ");
    ApiError::new(Code::NotFound, format!("the formats are {endings}"))
}

/// A mesh with the verdict on it, where there is one.
fn judged(mut response: Response, verdict: Option<Verdict>) -> Response {
    if let Some(verdict) = verdict {
        let verdict = HeaderValue::from_static(verdict.name());
        response.headers_mut().insert(VERDICT, verdict);
    }
    response
}

/// The last segment of a path: its stem, and its ending after the dot.
fn last_segment(uri: &Uri) -> (&str, Option<&str>) {
    let segment = uri.path().rsplit('/').next().unwrap_or_default();
    match segment.split_once('.') {
        Some((stem, ending)) => (stem, Some(ending)),
        None => (segment, None),
    }
}

/// Adds `Vary`, because the answer depends on `Accept`.
pub(in crate::http) fn varies(mut response: Response) -> Response {
    let accept = HeaderValue::from_static("accept");
    response.headers_mut().insert(header::VARY, accept);
    response
}

fn describe<'a>(job: &Job, mesh: &'a MeshInfo) -> api::Snapshot<'a> {
    let evaluation = mesh.evaluation;
    let links = ENDINGS.map(|(ending, _)| {
        let link = format!("/v1/jobs/{}/snapshots/{evaluation}.{ending}", job.id);
        (ending, link)
    });
    api::Snapshot {
        evaluation,
        vertices: mesh.vertices,
        triangles: mesh.triangles,
        bytes: mesh.bytes,
        sha256: &mesh.sha256,
        created_at: api::Time(mesh.created_at),
        verdict: mesh.verdict,
        links: links.into_iter().collect(),
    }
}
