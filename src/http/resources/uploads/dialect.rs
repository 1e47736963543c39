//! The two protocols that one resource speaks: tus 1.0 (<https://tus.io/protocols/resumable-upload>) and
//! the draft of the IETF (draft-ietf-httpbis-resumable-upload). They differ in what a request says and
//! in when an upload is complete: with tus when all bytes are there, with the draft when the client
//! says so. Answers have the headers of both.

use axum::http::header::{ACCEPT, CACHE_CONTROL, CONTENT_LENGTH, CONTENT_TYPE};
use axum::http::{HeaderMap, HeaderName, HeaderValue};
use axum::response::Response;

use crate::http::AppState;
use crate::http::api;
use crate::http::wire::error::{ApiError, Code, Result};
use crate::http::wire::extract::header;
use crate::jobs::Upload;
use crate::reconstruction::cloud::Format;

pub(super) const OFFSET: HeaderName = HeaderName::from_static("upload-offset");
const LENGTH: HeaderName = HeaderName::from_static("upload-length");
const DEFER_LENGTH: HeaderName = HeaderName::from_static("upload-defer-length");
const COMPLETE: HeaderName = HeaderName::from_static("upload-complete");
const LIMIT: HeaderName = HeaderName::from_static("upload-limit");
const EXPIRES: HeaderName = HeaderName::from_static("upload-expires");
const METADATA: HeaderName = HeaderName::from_static("upload-metadata");
const CONTENT_DISPOSITION: HeaderName = HeaderName::from_static("content-disposition");
const TUS: HeaderName = HeaderName::from_static("tus-resumable");
const TUS_VERSION: HeaderName = HeaderName::from_static("tus-version");
const TUS_EXTENSION: HeaderName = HeaderName::from_static("tus-extension");
const TUS_MAX_SIZE: HeaderName = HeaderName::from_static("tus-max-size");
const ACCEPT_PATCH: HeaderName = HeaderName::from_static("accept-patch");

const VERSION: &str = "1.0.0";
const EXTENSIONS: &str =
    "creation,creation-with-upload,creation-defer-length,expiration,termination";

/// Media types of a part of a file: that of tus, and that of the draft.
const TUS_PART: &str = "application/offset+octet-stream";
const DRAFT_PART: &str = "application/partial-upload";

/// What a request says of an upload.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Asked {
    /// Whether it speaks tus.
    pub(super) tus: bool,
    /// Where its bytes belong; 0 for the first ones.
    pub(super) offset: u64,
    /// Number of all bytes, where it is told.
    pub(super) length: Option<u64>,
    /// Number of its own bytes, where it is told.
    pub(super) own: Option<u64>,
    /// Whether it says that its bytes are the last ones. With tus that is counted.
    pub(super) last: bool,
}

impl Asked {
    /// Reads a request that begins an upload.
    ///
    /// # Errors
    /// [`Code::BadHeader`], [`Code::PreconditionFailed`] for another version of tus,
    /// [`Code::UnsupportedFormat`] for tus with another media type.
    pub(super) fn creation(headers: &HeaderMap) -> Result<Self> {
        let asked = Self::of(headers, Some(0))?;
        if !asked.tus {
            return Ok(asked);
        }
        let deferred = header(headers, &DEFER_LENGTH)? == Some("1");
        if asked.length.is_none() && !deferred {
            let detail = "tus begins an upload with Upload-Length, or with Upload-Defer-Length: 1";
            return Err(ApiError::new(Code::BadHeader, detail));
        }
        if header(headers, &CONTENT_TYPE)?.is_some() {
            check_part(headers, TUS_PART)?;
        }
        Ok(asked)
    }

    /// Reads a request that goes on with an upload.
    ///
    /// # Errors
    /// As [`Asked::creation`].
    pub(super) fn append(headers: &HeaderMap) -> Result<Self> {
        let asked = Self::of(headers, None)?;
        check_part(headers, if asked.tus { TUS_PART } else { DRAFT_PART })?;
        Ok(asked)
    }

    fn of(headers: &HeaderMap, offset: Option<u64>) -> Result<Self> {
        let version = header(headers, &TUS)?;
        if version.is_some_and(|version| version != VERSION) {
            let detail = format!("Tus-Resumable {VERSION} is spoken here");
            let problem = ApiError::new(Code::PreconditionFailed, detail);
            return Err(problem.with_header(TUS_VERSION, HeaderValue::from_static(VERSION)));
        }
        let tus = version.is_some();
        let complete = header(headers, &COMPLETE)?;
        let last = match complete.map(str::trim) {
            _ if tus => false,
            Some("?1") => true,
            Some("?0") => false,
            _ => {
                let detail = "send Upload-Complete: ?0 while bytes are missing and ?1 with the last \
                              ones, or speak tus with Tus-Resumable: 1.0.0";
                return Err(ApiError::new(Code::BadHeader, detail));
            }
        };
        let missing = || ApiError::new(Code::BadHeader, "Upload-Offset is missing");
        Ok(Self {
            tus,
            offset: match offset {
                Some(offset) => offset,
                None => number(headers, &OFFSET)?.ok_or_else(missing)?,
            },
            length: number(headers, &LENGTH)?,
            own: number(headers, &CONTENT_LENGTH)?,
            last,
        })
    }

    /// Number of all bytes, as far as this request and those before it tell.
    ///
    /// # Errors
    /// [`Code::UploadLength`] if they contradict each other, [`Code::BodyTooLarge`] beyond the limit.
    pub(super) fn length(&self, known: Option<u64>, limit: u64) -> Result<Option<u64>> {
        let end = self.own.map(|own| self.offset.saturating_add(own));
        let told = [known, self.length, end.filter(|_| self.last)];
        let mut told = told.into_iter().flatten();
        let length = told.next();
        let largest = length.max(end);
        if largest.is_some_and(|bytes| bytes > limit) {
            return Err(crate::http::upload::spool::too_large(limit).with_header(
                LIMIT,
                HeaderValue::try_from(format!("max-size={limit}")).map_err(ApiError::internal)?,
            ));
        }
        let differs = told.any(|other| Some(other) != length);
        if differs || length.zip(end).is_some_and(|(length, end)| end > length) {
            let detail = "what was said of the number of all bytes, and the bytes of this request, do \
                          not fit together";
            return Err(ApiError::new(Code::UploadLength, detail));
        }
        Ok(length)
    }
}

fn number(headers: &HeaderMap, name: &HeaderName) -> Result<Option<u64>> {
    let Some(text) = header(headers, name)? else {
        return Ok(None);
    };
    let digits = text.bytes().all(|b| b.is_ascii_digit());
    let number = text.parse().ok().filter(|_| digits);
    number.map(Some).ok_or_else(|| {
        let detail = format!("{name} must be a number of bytes");
        ApiError::new(Code::BadHeader, detail)
    })
}

fn check_part(headers: &HeaderMap, expected: &str) -> Result<()> {
    let given = header(headers, &CONTENT_TYPE)?.unwrap_or_default();
    if essence(given).eq_ignore_ascii_case(expected) {
        return Ok(());
    }
    let detail = format!("a part of an upload is sent with Content-Type: {expected}");
    Err(ApiError::new(Code::UnsupportedFormat, detail).with_header(
        ACCEPT,
        HeaderValue::try_from(expected).map_err(ApiError::internal)?,
    ))
}

fn essence(media_type: &str) -> &str {
    media_type.split(';').next().unwrap_or_default().trim()
}

/// The format that names and media types suggest. Nothing else is kept of them: there may be names of
/// people in them.
pub(super) fn hint(headers: &HeaderMap) -> Option<Format> {
    let text = |name: &HeaderName| headers.get(name)?.to_str().ok();
    let by_name = |name: &str| Format::from_extension(name.trim().trim_matches('"'));
    let metadata = text(&METADATA).unwrap_or_default();
    let mut pairs = metadata
        .split(',')
        .filter_map(|pair| pair.trim().split_once(' '));
    let told = pairs.find_map(|(name, value)| {
        let value = String::from_utf8(base64(value)?).ok()?;
        match name {
            "filename" | "name" => by_name(&value),
            "filetype" | "type" => Format::from_media_type(essence(&value)),
            _ => None,
        }
    });
    let disposition = text(&CONTENT_DISPOSITION).unwrap_or_default();
    let named = disposition
        .split(';')
        .find_map(|part| by_name(part.trim().strip_prefix("filename=")?));
    let media_type = text(&CONTENT_TYPE).map(essence);
    told.or(named)
        .or_else(|| Format::from_media_type(media_type?))
}

/// The bytes of a text in base64 (RFC 4648 section 4).
fn base64(text: &str) -> Option<Vec<u8>> {
    let digits = text.trim().trim_end_matches('=');
    let (mut bytes, mut bits, mut held) = (Vec::new(), 0_u32, 0);
    for digit in digits.bytes() {
        let value = match digit {
            b'A'..=b'Z' => digit - b'A',
            b'a'..=b'z' => digit - b'a' + 26,
            b'0'..=b'9' => digit - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return None,
        };
        bits = (bits << 6) | u32::from(value);
        held += 6;
        if held >= 8 {
            held -= 8;
            bytes.push((bits >> held) as u8);
        }
    }
    Some(bytes)
}

/// Puts the state of an upload into the headers of an answer, for clients of both protocols.
///
/// # Errors
/// None that occurs: numbers and dates are values of headers.
pub(super) fn told(app: &AppState, upload: &Upload, mut response: Response) -> Result<Response> {
    let left_ms = (upload.expires_at - app.store.now()).max(0);
    let size = app.config.body_limit_bytes();
    let limit = format!("max-size={size}, max-age={}", left_ms / 1_000);
    let complete = if upload.complete { "?1" } else { "?0" };
    let all = [
        (TUS, VERSION.to_owned()),
        (OFFSET, upload.bytes.to_string()),
        (COMPLETE, complete.to_owned()),
        (LIMIT, limit),
        (EXPIRES, api::Time(upload.expires_at).http_date()),
        (CACHE_CONTROL, "no-store".to_owned()),
        match upload.length {
            Some(length) => (LENGTH, length.to_string()),
            None => (DEFER_LENGTH, "1".to_owned()),
        },
    ];
    for (name, value) in all {
        let value = HeaderValue::try_from(value).map_err(ApiError::internal)?;
        response.headers_mut().insert(name, value);
    }
    Ok(response)
}

/// What may be sent, for those who ask with OPTIONS.
pub(super) fn offered(app: &AppState) -> Vec<(HeaderName, String)> {
    let size = app.config.body_limit_bytes();
    let age = app.config.upload_keep_ms() / 1_000;
    vec![
        (TUS, VERSION.to_owned()),
        (TUS_VERSION, VERSION.to_owned()),
        (TUS_EXTENSION, EXTENSIONS.to_owned()),
        (TUS_MAX_SIZE, size.to_string()),
        (LIMIT, format!("max-size={size}, max-age={age}")),
        (ACCEPT_PATCH, format!("{DRAFT_PART}, {TUS_PART}")),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(pairs: &[(&'static str, &str)]) -> HeaderMap {
        let pairs = pairs.iter().map(|(name, value)| {
            let value = HeaderValue::from_str(value).unwrap();
            (HeaderName::from_static(name), value)
        });
        pairs.collect()
    }

    #[test]
    fn lengths_have_to_agree() {
        let asked = |offset, length, own, last| Asked {
            tus: false,
            offset,
            length,
            own,
            last,
        };
        let code = |asked: Asked, known| asked.length(known, 100).map_err(|error| error.code());
        assert_eq!(code(asked(0, None, None, false), None), Ok(None));
        assert_eq!(code(asked(0, Some(9), Some(4), false), None), Ok(Some(9)));
        assert_eq!(code(asked(5, None, Some(4), true), None), Ok(Some(9)));
        assert_eq!(code(asked(5, None, Some(4), true), Some(9)), Ok(Some(9)));
        for (wrong, known) in [
            (asked(5, None, Some(3), true), Some(9)),
            (asked(5, None, Some(5), false), Some(9)),
            (asked(0, Some(8), None, false), Some(9)),
        ] {
            assert_eq!(code(wrong, known), Err(Code::UploadLength));
        }
        for wrong in [
            asked(0, Some(101), None, false),
            asked(99, None, Some(2), false),
        ] {
            assert_eq!(code(wrong, None), Err(Code::BodyTooLarge));
        }
    }

    #[test]
    fn names_give_a_format_and_nothing_else() {
        let metadata = headers(&[(
            "upload-metadata",
            "relativePath bnVsbA==,filename c2Nhbi5wbHk=",
        )]);
        assert_eq!(hint(&metadata), Format::from_extension("scan.ply"));
        let named = headers(&[("content-disposition", "inline; filename=\"a.stl\"")]);
        assert_eq!(hint(&named), Format::from_extension("a.stl"));
        assert!(hint(&metadata).is_some() && hint(&named).is_some());
        assert_eq!(hint(&headers(&[("upload-metadata", "filename !!")])), None);
        assert_eq!(base64("aGk=").unwrap(), b"hi");
    }

    #[test]
    fn requests_are_told_apart() {
        let tus = Asked::append(&headers(&[
            ("tus-resumable", "1.0.0"),
            ("upload-offset", "7"),
            ("content-type", TUS_PART),
        ]));
        assert!(tus.is_ok_and(|asked| asked.tus && asked.offset == 7 && !asked.last));
        let draft = Asked::append(&headers(&[
            ("upload-complete", "?1"),
            ("upload-offset", "7"),
            ("content-type", DRAFT_PART),
        ]));
        assert!(draft.is_ok_and(|asked| !asked.tus && asked.last));
        for (wrong, code) in [
            (vec![("tus-resumable", "0.2.2")], Code::PreconditionFailed),
            (vec![], Code::BadHeader),
            (
                vec![("upload-complete", "?1"), ("upload-offset", "+7")],
                Code::BadHeader,
            ),
            (
                vec![("upload-complete", "?1"), ("upload-offset", "7")],
                Code::UnsupportedFormat,
            ),
        ] {
            assert_eq!(Asked::append(&headers(&wrong)).unwrap_err().code(), code);
        }
    }
}
