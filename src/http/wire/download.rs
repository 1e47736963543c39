//! Downloads that can be resumed: strong `ETag`, ranges, conditional requests (RFC 9110 sections 13
//! and 14).

use std::io::{self, SeekFrom};
use std::ops::Range;
use std::path::PathBuf;

use axum::body::Body;
use axum::http::header::{
    ACCEPT_RANGES, CACHE_CONTROL, CONTENT_DISPOSITION, CONTENT_LENGTH, CONTENT_RANGE, CONTENT_TYPE,
    ETAG, IF_MATCH, IF_NONE_MATCH, IF_RANGE, RANGE, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use futures_util::stream::{self, StreamExt};
use tokio::fs::File;
use tokio::io::{AsyncReadExt, AsyncSeekExt};
use tokio_util::io::ReaderStream;

pub(in crate::http) use hex::encode as hex;

use crate::http::wire::error::{ApiError, Code, Result};
use crate::jobs::{self, Store};

/// Bytes of a file that are read at a time.
const READ_BYTES: usize = 64 * 1024;

/// Content that never changes under its hash.
#[derive(Clone)]
pub(in crate::http) struct Download {
    /// Where the bytes are.
    pub(in crate::http) content: Content,
    /// Their SHA-256 in hexadecimal digits: the strong `ETag`.
    pub(in crate::http) sha256: String,
    /// Media type.
    pub(in crate::http) media_type: &'static str,
    /// File name for browsers; plain ASCII.
    pub(in crate::http) file_name: String,
}

/// Where the bytes are.
#[derive(Clone)]
pub(in crate::http) enum Content {
    /// A file of so many bytes.
    File {
        /// Its path.
        path: PathBuf,
        /// Its length.
        bytes: u64,
    },
    /// In memory.
    Memory(Bytes),
    /// An object: a mesh in its canonical encoding, or a cloud.
    Stored {
        /// Where it is.
        store: Store,
        /// Which one.
        object: String,
        /// Its length.
        bytes: u64,
    },
}

impl Content {
    fn bytes(&self) -> u64 {
        match self {
            Self::File { bytes, .. } | Self::Stored { bytes, .. } => *bytes,
            Self::Memory(bytes) => bytes.len() as u64,
        }
    }

    async fn read(self, range: Range<u64>) -> io::Result<Body> {
        match self {
            Self::File { path, .. } => {
                let mut file = File::open(path).await?;
                if range.start > 0 {
                    file.seek(SeekFrom::Start(range.start)).await?;
                }
                let part = file.take(range.end - range.start);
                Ok(Body::from_stream(ReaderStream::with_capacity(
                    part, READ_BYTES,
                )))
            }
            Self::Memory(bytes) => Ok(bytes.slice(range.start as usize..range.end as usize).into()),
            Self::Stored { store, object, .. } => {
                // An erased object is not started.
                let first = part(&store, &object, range.clone()).await?;
                let rest = range.start + first.len() as u64..range.end;
                let parts = stream::try_unfold(rest, move |left| {
                    let (store, object) = (store.clone(), object.clone());
                    async move {
                        if left.is_empty() {
                            return Ok::<_, io::Error>(None);
                        }
                        let part = part(&store, &object, left.clone()).await?;
                        let left = left.start + part.len() as u64..left.end;
                        Ok(Some((part, left)))
                    }
                });
                let parts = stream::once(async { Ok(first) }).chain(parts);
                Ok(Body::from_stream(parts))
            }
        }
    }
}

/// The first bytes of a non-empty range.
async fn part(store: &Store, object: &str, range: Range<u64>) -> io::Result<Bytes> {
    let part = store.object_part(object, range).await;
    let erased = || io::Error::new(io::ErrorKind::NotFound, "the object was erased");
    part.map_err(io::Error::other)?.ok_or_else(erased)
}

impl Download {
    /// The answer to a GET or HEAD with the given headers: 200, 206, 304, 412 or 416.
    ///
    /// # Errors
    /// [`Code::PreconditionFailed`], [`Code::RangeNotSatisfiable`], and `Internal` when the file cannot be read.
    pub(in crate::http) async fn respond(self, request: &HeaderMap) -> Result<Response> {
        let etag = format!("\"{}\"", self.sha256);
        if request.contains_key(IF_MATCH) && !lists(request, &IF_MATCH, |tag| tag == etag) {
            let detail = format!("the content is version {etag}");
            return Err(ApiError::new(Code::PreconditionFailed, detail));
        }
        if none_match(request, &etag) {
            return Ok((StatusCode::NOT_MODIFIED, [(ETAG, etag)]).into_response());
        }
        let total = self.content.bytes();
        let whole = 0..total;
        let (status, range) = match asked_range(request, &etag, total) {
            Asked::Whole => (StatusCode::OK, whole),
            Asked::Part(range) => (StatusCode::PARTIAL_CONTENT, range),
            Asked::Outside => {
                let detail = format!("the content has {total} bytes");
                return Err(ApiError::new(Code::RangeNotSatisfiable, detail)
                    .with_header(CONTENT_RANGE, text(&format!("bytes */{total}"))?));
            }
        };
        let body = self.content.read(range.clone()).await;
        let body = body.map_err(|error| match error.kind() {
            io::ErrorKind::NotFound => ApiError::new(
                Code::NotFound,
                "the bytes are not where they were put any more; send them, or make them, again",
            ),
            _ => match error.downcast::<jobs::Error>() {
                Ok(error) => ApiError::from(error),
                Err(error) => ApiError::internal(error),
            },
        })?;
        let mut response = Response::new(body);
        *response.status_mut() = status;
        let headers = response.headers_mut();
        headers.insert(ETAG, text(&etag)?);
        headers.insert(ACCEPT_RANGES, HeaderValue::from_static("bytes"));
        headers.insert(CONTENT_TYPE, HeaderValue::from_static(self.media_type));
        headers.insert(CONTENT_LENGTH, HeaderValue::from(range.end - range.start));
        headers.insert(
            CONTENT_DISPOSITION,
            text(&format!("attachment; filename=\"{}\"", self.file_name))?,
        );
        headers.insert(CACHE_CONTROL, HeaderValue::from_static("private, no-cache"));
        headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
        if status == StatusCode::PARTIAL_CONTENT {
            let value = format!("bytes {}-{}/{total}", range.start, range.end - 1);
            headers.insert(CONTENT_RANGE, text(&value)?);
        }
        Ok(response)
    }
}

fn text(value: &str) -> Result<HeaderValue> {
    HeaderValue::from_str(value).map_err(ApiError::internal)
}

/// Whether the client has this version already. Weak and strong tags compare equal here.
pub(in crate::http) fn none_match(request: &HeaderMap, etag: &str) -> bool {
    let opaque = |tag: &str| tag.trim().trim_start_matches("W/").to_owned();
    lists(request, &IF_NONE_MATCH, |tag| opaque(tag) == opaque(etag))
}

/// Whether a list of tags has one that fits; `*` always does.
fn lists(request: &HeaderMap, name: &HeaderName, fits: impl Fn(&str) -> bool) -> bool {
    let values = request.get_all(name).iter();
    values
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .map(str::trim)
        .any(|tag| tag == "*" || fits(tag))
}

#[derive(Debug, PartialEq, Eq)]
enum Asked {
    Whole,
    Part(Range<u64>),
    Outside,
}

/// The one range that is asked for. Several ranges, other units and malformed ones give the whole,
/// as the RFC allows; so does a range of another version (`If-Range`).
fn asked_range(request: &HeaderMap, etag: &str, total: u64) -> Asked {
    if request
        .get(IF_RANGE)
        .is_some_and(|value| value.as_bytes() != etag.as_bytes())
    {
        return Asked::Whole;
    }
    let range = request.get(RANGE).and_then(|value| value.to_str().ok());
    let Some((first, last)) = range
        .and_then(|range| range.strip_prefix("bytes="))
        .filter(|range| !range.contains(','))
        .and_then(|range| range.split_once('-'))
    else {
        return Asked::Whole;
    };
    let digits = |text: &str| text.bytes().all(|b| b.is_ascii_digit());
    if !digits(first) || !digits(last) {
        return Asked::Whole;
    }
    // A number too large for u64 is beyond every content.
    let number = |text: &str| text.parse::<u64>().unwrap_or(u64::MAX);
    let range = match (first, last) {
        ("", "") => return Asked::Whole,
        ("", suffix) => total.saturating_sub(number(suffix))..total,
        (first, "") => number(first)..total,
        (first, last) if number(last) < number(first) => return Asked::Whole,
        (first, last) => number(first)..number(last).saturating_add(1).min(total),
    };
    if range.start < range.end {
        Asked::Part(range)
    } else {
        Asked::Outside
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(range: &str, if_range: Option<&'static str>) -> Asked {
        let mut headers = HeaderMap::new();
        headers.insert(RANGE, range.parse().unwrap());
        if let Some(tag) = if_range {
            headers.insert(IF_RANGE, HeaderValue::from_static(tag));
        }
        asked_range(&headers, "\"a\"", 10)
    }

    #[test]
    fn ranges_of_the_rfc() {
        assert_eq!(asked("bytes=0-4", None), Asked::Part(0..5));
        assert_eq!(asked("bytes=4-", None), Asked::Part(4..10));
        assert_eq!(asked("bytes=4-99", None), Asked::Part(4..10));
        assert_eq!(asked("bytes=-3", None), Asked::Part(7..10));
        assert_eq!(asked("bytes=-99", None), Asked::Part(0..10));
        assert_eq!(asked("bytes=10-", None), Asked::Outside);
        assert_eq!(asked("bytes=-0", None), Asked::Outside);
        assert_eq!(asked("bytes=99999999999999999999-", None), Asked::Outside);
        for whole in [
            "bytes=4-2",
            "bytes=0-1,3-4",
            "rows=0-1",
            "bytes=a-b",
            "bytes=-",
        ] {
            assert_eq!(asked(whole, None), Asked::Whole, "{whole}");
        }
    }

    #[test]
    fn a_range_of_another_version_gives_the_whole() {
        assert_eq!(asked("bytes=4-", Some("\"a\"")), Asked::Part(4..10));
        assert_eq!(asked("bytes=4-", Some("\"b\"")), Asked::Whole);
        assert_eq!(asked("bytes=4-", Some("W/\"a\"")), Asked::Whole);
    }
}
