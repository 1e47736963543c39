//! `GET /v1/clouds/{id}/points`: some of the points of a cloud, to look at.

use axum::extract::State;
use axum::http::{HeaderMap, HeaderName, HeaderValue};
use axum::response::Response;
use sha2::{Digest, Sha256};

use super::{files, find};
use crate::http::AppState;
use crate::http::resources::witness::witnessed;
use crate::http::wire::download::{Content, Download, hex};
use crate::http::wire::error::{ApiError, Result};
use crate::http::wire::extract::{Id, Query, text};
use crate::identity::Caller;
use crate::intake::{File, Subset};
use crate::jobs::{Act, CloudId};

/// Points of an answer that are enough for a picture.
const ENOUGH: usize = 100_000;

/// Most points of an answer: 16 bytes each.
const MOST: usize = 1_000_000;

/// What the coordinates are counted from.
const ORIGIN: HeaderName = HeaderName::from_static("meshway-origin");

/// `GET /v1/clouds/{id}/points`: at most `max` of them, as binary numbers.
pub(in crate::http) async fn subset(
    State(app): State<AppState>,
    caller: Caller,
    mut query: Query,
    Id(id): Id<CloudId>,
    headers: HeaderMap,
) -> Result<Response> {
    let most = query.take("max", |value| match text::<usize>(value) {
        Ok(most @ 1..=MOST) => Ok(most),
        _ => Err(format!("must be a number from 1 to {MOST}")),
    });
    query.finish()?;
    let most = most.unwrap_or(ENOUGH);
    let cloud = find(&app, &caller.tenant, &id).await?;
    let local = files::local(&app, &cloud).await?;
    let file = File {
        path: local.path(),
        bytes: cloud.bytes,
        hint: Some(cloud.summary.format),
        // Whoever uploaded the file had to allow it.
        assume_orientation: true,
    };
    let Subset { origin, rows } = app.reader.subset(file, most).await?;
    let download = Download {
        sha256: hex(Sha256::digest(&rows)),
        content: Content::Memory(rows.into()),
        media_type: "application/octet-stream",
        file_name: format!("{id}.f32"),
    };
    let mut response = download.respond(&headers).await?;
    let [x, y, z] = origin;
    let origin = HeaderValue::from_str(&format!("{x},{y},{z}")).map_err(ApiError::internal)?;
    response.headers_mut().insert(ORIGIN, origin);
    witnessed(&app, &caller, (Act::CloudRead, id.as_str()), response).await
}
