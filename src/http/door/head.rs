//! The line and the headers of a request, as far as they can be refused before anything is read of
//! them: how large they are, and whether they name one host.

use axum::extract::Request;
use axum::http::Version;
use axum::http::header::HOST;

use crate::http::wire::error::{ApiError, Code, Result};

/// Most bytes of a request's line and headers.
pub(in crate::http) const MAX_BYTES: usize = 64 * 1024;

/// Refuses what is too large or names no host, or two (RFC 9112 section 3.2).
///
/// # Errors
/// [`Code::HeadTooLarge`], [`Code::BadHeader`].
pub(super) fn check(request: &Request) -> Result<()> {
    if bytes(request) > MAX_BYTES {
        return Err(too_large());
    }
    let refuse = |detail: &str| Err(ApiError::new(Code::BadHeader, detail));
    match request.headers().get_all(HOST).iter().count() {
        0 if request.version() == Version::HTTP_11 && request.uri().authority().is_none() => {
            refuse("Host is missing")
        }
        0 | 1 => Ok(()),
        _ => refuse("Host is given twice"),
    }
}

/// The problem of a request with a larger head.
pub(super) fn too_large() -> ApiError {
    let detail = format!("the line and the headers of a request have at most {MAX_BYTES} bytes");
    ApiError::new(Code::HeadTooLarge, detail)
}

/// What a client sends before the body, but for spaces that mean nothing.
fn bytes(request: &Request) -> usize {
    // A space, a space and the version, and the end of the line; the empty line at the end.
    const AROUND: usize = " ".len() + " HTTP/1.1\r\n".len() + "\r\n".len();
    let headers = request.headers().iter();
    let headers = headers.map(|(name, value)| name.as_str().len() + value.len() + ": \r\n".len());
    let target = request.uri().to_string().len();
    request.method().as_str().len() + target + AROUND + headers.sum::<usize>()
}

#[cfg(test)]
mod tests {
    use axum::body::Body;

    use super::*;

    fn refused(request: &Request) -> Option<Code> {
        check(request).err().map(|error| error.code())
    }

    #[test]
    fn the_limit_is_that_of_the_bytes() {
        let of = |length: usize| {
            // `GET /livez HTTP/1.1`, `host: a`, `x: …` and an empty line.
            let around = 21 + 9 + 5 + 2;
            Request::get("/livez")
                .header(HOST, "a")
                .header("x", "a".repeat(length - around))
                .body(Body::empty())
                .unwrap()
        };
        assert_eq!(bytes(&of(1_000)), 1_000);
        assert_eq!(refused(&of(MAX_BYTES)), None);
        assert_eq!(refused(&of(MAX_BYTES + 1)), Some(Code::HeadTooLarge));
    }

    #[test]
    fn a_request_names_one_host() {
        let with = |hosts: &[&str], version| {
            let request = Request::get("/").version(version);
            let request = hosts.iter().fold(request, |r, host| r.header(HOST, *host));
            request.body(Body::empty()).unwrap()
        };
        assert_eq!(refused(&with(&["a"], Version::HTTP_11)), None);
        assert_eq!(refused(&with(&[], Version::HTTP_10)), None);
        for hosts in [&[] as &[&str], &["a", "a"]] {
            let found = refused(&with(hosts, Version::HTTP_11));
            assert_eq!(found, Some(Code::BadHeader), "{hosts:?}");
        }
    }
}
