//! The path below which a proxy offers the service: requests lose it, addresses in answers get it.
//!
//! Handlers know their own paths only. So does what is kept of their answers, and the base may
//! change between two starts.

use axum::Router;
use axum::body::{Body, HttpBody};
use axum::extract::{Request, State};
use axum::http::header::{ACCEPT_ENCODING, CONTENT_LENGTH, CONTENT_TYPE, LINK, LOCATION};
use axum::http::uri::PathAndQuery;
use axum::http::{HeaderMap, HeaderValue, Uri};
use axum::middleware::Next;
use axum::response::Response;
use bytes::Bytes;
use futures_util::StreamExt;
use serde_json::Value;
use tower::util::MapRequest;

use crate::config::Config;
use crate::http::AppState;
use crate::http::wire::error::{ApiError, Result};

/// The service with its base path and without.
pub(in crate::http) fn mounted(config: &Config, router: Router) -> Router {
    if config.base_path.is_empty() {
        return router;
    }
    let config = config.clone();
    let without = move |mut request: Request| {
        if let Some(below) = below(&config, request.uri()) {
            *request.uri_mut() = below;
        }
        request
    };
    Router::new().fallback_service(MapRequest::new(router, without))
}

/// The same address without the base path, where it has that.
fn below(config: &Config, uri: &Uri) -> Option<Uri> {
    let path = config.below_base(uri.path());
    let query = uri
        .query()
        .map_or(String::new(), |query| format!("?{query}"));
    let mut parts = uri.clone().into_parts();
    parts.path_and_query = Some(PathAndQuery::try_from(format!("{path}{query}")).ok()?);
    Uri::from_parts(parts).ok()
}

/// The layer that puts the base path before the addresses in an answer: of its header, of members
/// `link` and `links` in JSON and in events, and of links in pages.
pub(in crate::http) async fn addresses(
    State(app): State<AppState>,
    mut request: Request,
    next: Next,
) -> Result<Response> {
    let config = app.config.clone();
    if config.base_path.is_empty() {
        return Ok(next.run(request).await);
    }
    // Files that never change name no addresses. All else must come as text; a layer around this one
    // packs it.
    if !request.uri().path().starts_with("/assets/") {
        request.headers_mut().remove(ACCEPT_ENCODING);
    }
    let mut response = next.run(request).await;
    in_header(&config, response.headers_mut());
    let kind = response.headers().get(CONTENT_TYPE);
    let kind = kind.and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    let rewrite: fn(&Config, &Bytes) -> Bytes = match kind.split(';').next().unwrap_or_default() {
        "application/json" => in_json,
        "text/html" => in_page,
        "application/yaml" => in_contract,
        "text/event-stream" => {
            return Ok(response.map(|body| {
                let frames = body.into_data_stream();
                Body::from_stream(frames.map(move |frame| frame.map(|f| in_frame(&config, &f))))
            }));
        }
        _ => return Ok(response),
    };
    let Some(length) = response.body().size_hint().exact() else {
        return Ok(response);
    };
    let (mut parts, body) = response.into_parts();
    let body = axum::body::to_bytes(body, length as usize).await;
    let body = body.map_err(ApiError::internal)?;
    parts.headers.remove(CONTENT_LENGTH);
    Ok(Response::from_parts(parts, rewrite(&config, &body).into()))
}

fn in_header(config: &Config, headers: &mut HeaderMap) {
    for (name, begin) in [(LOCATION, ""), (LINK, "<")] {
        let value = headers.get(&name).and_then(|value| value.to_str().ok());
        let path = value.and_then(|value| value.strip_prefix(begin));
        if let Some(path) = path.filter(|path| path.starts_with('/'))
            && let Ok(value) = HeaderValue::try_from(format!("{begin}{}", config.address(path)))
        {
            headers.insert(name, value);
        }
    }
}

fn in_json(config: &Config, body: &Bytes) -> Bytes {
    let Ok(mut value) = serde_json::from_slice(body) else {
        return body.clone();
    };
    in_value(config, &mut value);
    value.to_string().into()
}

fn in_value(config: &Config, value: &mut Value) {
    match value {
        Value::Array(items) => items.iter_mut().for_each(|item| in_value(config, item)),
        Value::Object(members) => {
            for (name, member) in members {
                match (name.as_str(), member) {
                    ("link", Value::String(link)) => *link = config.address(&link),
                    ("links", Value::Object(links)) => {
                        for link in links.values_mut() {
                            if let Value::String(link) = link {
                                *link = config.address(&link);
                            }
                        }
                    }
                    (_, member) => in_value(config, member),
                }
            }
        }
        _ => {}
    }
}

/// A frame of an event stream is a chunk of its own.
fn in_frame(config: &Config, frame: &Bytes) -> Bytes {
    let Ok(text) = std::str::from_utf8(frame) else {
        return frame.clone();
    };
    let lines = text.split_inclusive('\n').map(|line| {
        let data = line.strip_prefix("data: ").map(str::trim_end);
        match data.and_then(|data| serde_json::from_str(data).ok()) {
            Some(mut data) => {
                in_value(config, &mut data);
                format!("data: {data}\n")
            }
            None => line.to_owned(),
        }
    });
    lines.collect::<String>().into()
}

fn in_page(config: &Config, body: &Bytes) -> Bytes {
    let base = config.address("/");
    let links = replaced(body, "href=\"/", &format!("href=\"{base}"));
    replaced(&links, "src=\"/", &format!("src=\"{base}"))
}

fn in_contract(config: &Config, body: &Bytes) -> Bytes {
    replaced(
        body,
        "{url: /,",
        &format!("{{url: {},", config.address("/")),
    )
}

fn replaced(body: &Bytes, what: &str, with: &str) -> Bytes {
    String::from_utf8_lossy(body).replace(what, with).into()
}
