//! The dashboard: what `make web` built in `web/dist`, out of the program itself. A program that was
//! built without it shows the plain start page.

use std::io::Read;

use axum::http::header::{
    ACCEPT_ENCODING, CACHE_CONTROL, CONTENT_ENCODING, CONTENT_SECURITY_POLICY, CONTENT_TYPE, ETAG,
    REFERRER_POLICY, VARY, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use flate2::read::GzDecoder;

use super::{docs, page};
use crate::http::wire::download::none_match;
use crate::http::wire::error::{ApiError, Result};
use crate::http::wire::extract::NoQuery;

// FILES: name and gzipped bytes of each file, sorted by name; STAMP: hash of what they were built from.
include!(concat!(env!("OUT_DIR"), "/dashboard.rs"));

const OPENER_POLICY: HeaderName = HeaderName::from_static("cross-origin-opener-policy");
const PERMISSIONS_POLICY: HeaderName = HeaderName::from_static("permissions-policy");
const RESOURCE_POLICY: HeaderName = HeaderName::from_static("cross-origin-resource-policy");

/// What the pages may load and do: things of this service alone, nothing that stands in the page itself.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; \
img-src 'self' data: blob:; connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; \
form-action 'self'";

/// GET /: the dashboard, else the plain page.
pub(in crate::http) async fn start(_: NoQuery, headers: HeaderMap) -> Result<Response> {
    let Some(packed) = file("index.html") else {
        return Ok(page(docs::start()));
    };
    let etag = format!("W/\"{STAMP}\"");
    let mut response = if none_match(&headers, &etag) {
        StatusCode::NOT_MODIFIED.into_response()
    } else {
        unpacked_if_needed(packed, "text/html; charset=utf-8", &headers)?
    };
    let etag = HeaderValue::from_str(&etag).map_err(ApiError::internal)?;
    response.headers_mut().insert(ETAG, etag);
    set(
        &mut response,
        &[
            (CACHE_CONTROL, "no-cache"),
            (CONTENT_SECURITY_POLICY, POLICY),
            (REFERRER_POLICY, "no-referrer"),
            (OPENER_POLICY, "same-origin"),
            (
                PERMISSIONS_POLICY,
                "camera=(), geolocation=(), microphone=()",
            ),
        ],
    );
    Ok(response)
}

/// GET /assets/{file}: a part of the dashboard. Its name has the hash of its content, so that it
/// never changes.
pub(in crate::http) async fn asset(_: NoQuery, uri: Uri, headers: HeaderMap) -> Result<Response> {
    let name = uri.path().trim_start_matches("/assets/");
    let kind = match name.rsplit_once('.').map(|(_, ending)| ending) {
        Some("js") => "text/javascript; charset=utf-8",
        Some("css") => "text/css; charset=utf-8",
        Some("svg") => "image/svg+xml",
        // The page itself is not under this address.
        _ => return Err(ApiError::not_found("file of the dashboard")),
    };
    let packed = file(name).ok_or_else(|| ApiError::not_found("file of the dashboard"))?;
    let mut response = unpacked_if_needed(packed, kind, &headers)?;
    set(
        &mut response,
        &[(CACHE_CONTROL, "public, max-age=31536000, immutable")],
    );
    Ok(response)
}

fn file(name: &str) -> Option<&'static [u8]> {
    let at = FILES.binary_search_by_key(&name, |(name, _)| *name).ok()?;
    Some(FILES[at].1)
}

/// The bytes as they are for who takes gzip, as every browser does.
fn unpacked_if_needed(
    packed: &'static [u8],
    kind: &'static str,
    headers: &HeaderMap,
) -> Result<Response> {
    let mut response = if takes_gzip(headers) {
        let gzip = HeaderValue::from_static("gzip");
        ([(CONTENT_ENCODING, gzip)], packed).into_response()
    } else {
        let mut bytes = Vec::new();
        let read = GzDecoder::new(packed).read_to_end(&mut bytes);
        read.map_err(ApiError::internal)?;
        bytes.into_response()
    };
    set(
        &mut response,
        &[
            (CONTENT_TYPE, kind),
            (VARY, "accept-encoding"),
            (X_CONTENT_TYPE_OPTIONS, "nosniff"),
            (RESOURCE_POLICY, "same-origin"),
        ],
    );
    Ok(response)
}

fn set(response: &mut Response, headers: &[(HeaderName, &'static str)]) {
    for (name, value) in headers {
        let value = HeaderValue::from_static(value);
        response.headers_mut().insert(name, value);
    }
}

fn takes_gzip(headers: &HeaderMap) -> bool {
    let values = headers.get_all(ACCEPT_ENCODING).iter();
    values
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .any(|coding| {
            let (name, weight) = coding.split_once(';').unwrap_or((coding, "q=1"));
            let weight = weight.trim().trim_start_matches("q=").parse::<f32>();
            name.trim().eq_ignore_ascii_case("gzip") && weight.is_ok_and(|weight| weight > 0.0)
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_takes_gzip_is_told_by_the_header() {
        let takes = |value: &'static str| {
            takes_gzip(&HeaderMap::from_iter([(
                ACCEPT_ENCODING,
                HeaderValue::from_static(value),
            )]))
        };
        assert!(takes("gzip, deflate, br"));
        assert!(takes("br, GZIP;q=0.5"));
        assert!(!takes("gzip;q=0, br"));
        assert!(!takes("br"));
        assert!(!takes_gzip(&HeaderMap::new()));
    }

    #[test]
    fn files_are_sorted_by_name() {
        assert!(FILES.is_sorted_by_key(|(name, _)| *name));
    }
}
