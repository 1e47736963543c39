//! Versions of JSON: what is read again and again is not sent again while it is the same.

use axum::body::{Body, HttpBody};
use axum::extract::Request;
use axum::http::header::{
    CACHE_CONTROL, CONTENT_ENCODING, CONTENT_LENGTH, CONTENT_TYPE, ETAG, HeaderValue,
};
use axum::http::{Method, StatusCode};
use axum::middleware::Next;
use axum::response::Response;
use sha2::{Digest, Sha256};

use crate::http::wire::download::{hex, none_match};
use crate::http::wire::error::{ApiError, Result};

/// The layer: JSON that is whole gets a strong `ETag`, and is not sent to who has it already.
/// Labels may be in it: no cache may give it to somebody else.
pub(in crate::http) async fn tag(request: Request, next: Next) -> Result<Response> {
    let reads = matches!(*request.method(), Method::GET | Method::HEAD);
    let conditions = request.headers().clone();
    let mut response = next.run(request).await;
    let json = response.headers().get(CONTENT_TYPE);
    let json = json.is_some_and(|kind| kind == "application/json");
    if !reads || !json || response.status() != StatusCode::OK {
        return Ok(response);
    }
    let private = HeaderValue::from_static("private, no-cache");
    let headers = response.headers_mut();
    let stored = headers.entry(CACHE_CONTROL).or_insert(private);
    if stored.as_bytes() == b"no-store" || headers.contains_key(ETAG) {
        return Ok(response);
    }
    let Some(length) = response.body().size_hint().exact() else {
        return Ok(response);
    };
    let (mut parts, body) = response.into_parts();
    let body = axum::body::to_bytes(body, length as usize).await;
    let body = body.map_err(ApiError::internal)?;
    let tag = format!("\"{}\"", hex(Sha256::digest(&body)));
    let held = none_match(&conditions, &tag);
    parts.headers.insert(
        ETAG,
        HeaderValue::try_from(tag).map_err(ApiError::internal)?,
    );
    if !held {
        return Ok(Response::from_parts(parts, Body::from(body)));
    }
    parts.status = StatusCode::NOT_MODIFIED;
    parts.headers.remove(CONTENT_TYPE);
    parts.headers.remove(CONTENT_LENGTH);
    Ok(Response::from_parts(parts, Body::empty()))
}

/// What is compressed on its way is not the same bytes any more: its tag becomes a weak one.
pub(in crate::http) async fn weaken(mut response: Response) -> Response {
    let headers = response.headers_mut();
    let tag = headers.get(ETAG).and_then(|tag| tag.to_str().ok());
    if headers.contains_key(CONTENT_ENCODING)
        && let Some(tag) = tag.filter(|tag| !tag.starts_with("W/"))
        && let Ok(weak) = HeaderValue::try_from(format!("W/{tag}"))
    {
        headers.insert(ETAG, weak);
    }
    response
}
