//! Which requests of a browser on the operator's machine are accepted.
//!
//! Without keys the address is the only guard, and a web page of anyone can make a browser send
//! requests to it. A page whose name is made to resolve to this machine (DNS rebinding) shows its
//! own name in `Host`; a page that sends a form or a script's request across shows itself in
//! `Origin` or `Sec-Fetch-Site`. Reads across sites pass: without CORS headers, which only the
//! origins that the operator allows get, the browser keeps their answers from the page. Reads with a
//! cookie do not pass: [`check_cookie`].

use std::net::IpAddr;

use axum::extract::{Request, State};
use axum::http::header::{HOST, ORIGIN};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderName, Method, Uri};
use axum::middleware::Next;
use axum::response::Response;

use crate::config::Config;
use crate::http::AppState;
use crate::http::door::head;
use crate::http::wire::error::{ApiError, Code, Result};
use crate::http::wire::extract::header;

const SEC_FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");

/// The layer.
pub(in crate::http) async fn guard(
    State(app): State<AppState>,
    request: Request,
    next: Next,
) -> Result<Response> {
    head::check(&request)?;
    check(&app.config, &request)?;
    Ok(next.run(request).await)
}

fn check(config: &Config, request: &Request) -> Result<()> {
    let headers = request.headers();
    let named = header(headers, &HOST)?;
    // A target with an authority counts before Host (RFC 9112 section 3.2.2).
    let host = request.uri().authority().map(Authority::as_str).or(named);
    // Every browser names a host; a client that names none is no browser.
    if let Some(host) = host
        && !answers_to(config, host)
    {
        let detail = format!(
            "the service does not answer to the host {:.200}; its operator can add it with \
             --allowed-hosts",
            without_port(host)
        );
        return Err(ApiError::new(Code::HostNotAllowed, detail));
    }
    if matches!(
        *request.method(),
        Method::GET | Method::HEAD | Method::OPTIONS
    ) {
        return Ok(());
    }
    refuse_foreign(config, headers, request.uri(), &["cross-site"])
}

/// Refuses a request that a browser sends with a cookie for a page of another origin, be it a read: a
/// page of the same site, which may be another port of this machine, gets the cookie sent along.
///
/// # Errors
/// [`Code::CrossOriginRefused`].
pub(in crate::http) fn check_cookie(config: &Config, headers: &HeaderMap, uri: &Uri) -> Result<()> {
    refuse_foreign(config, headers, uri, &["cross-site", "same-site"])
}

fn refuse_foreign(config: &Config, headers: &HeaderMap, uri: &Uri, sites: &[&str]) -> Result<()> {
    let host = uri.authority().map(Authority::as_str);
    let host = host.or(header(headers, &HOST)?);
    let across = header(headers, &SEC_FETCH_SITE)?.is_some_and(|site| sites.contains(&site));
    let origin = header(headers, &ORIGIN)?;
    if origin.is_some_and(|origin| config.origins().any(|allowed| allowed == origin)) {
        return Ok(());
    }
    let elsewhere = origin.is_some_and(|origin| {
        let authority = origin.split_once("://").map(|(_, authority)| authority);
        !authority
            .zip(host)
            .is_some_and(|(authority, host)| authority.eq_ignore_ascii_case(host))
    });
    if across || elsewhere {
        let detail = format!(
            "a page of {:.200} sent this to {:.200}; requests that change something, and those with \
             a cookie, are taken from pages of this service, and from clients that are no browser; a \
             proxy before it must pass Host on, and --allowed-hosts name it",
            origin.unwrap_or("another site"),
            host.unwrap_or("a service without a name")
        );
        return Err(ApiError::new(Code::CrossOriginRefused, detail));
    }
    Ok(())
}

/// Whether this is a name of the service. The port is ignored.
fn answers_to(config: &Config, host: &str) -> bool {
    let name = without_port(host).trim_end_matches('.');
    let literal = name.trim_start_matches('[').trim_end_matches(']');
    if let Ok(ip) = literal.parse::<IpAddr>() {
        let listening = config.listen.ip().to_canonical();
        let ip = ip.to_canonical();
        // A name can be made to resolve to this machine, an address cannot.
        if ip.is_loopback() || ip == listening || !listening.is_loopback() {
            return true;
        }
    }
    let name = name.to_ascii_lowercase();
    name == "localhost"
        || name.ends_with(".localhost")
        || config
            .hosts()
            .any(|allowed| allowed == "*" || without_port(allowed).eq_ignore_ascii_case(&name))
}

/// A host without its port; the colons of an IPv6 literal stand in brackets.
fn without_port(host: &str) -> &str {
    match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|b| b.is_ascii_digit()) && !name.is_empty() => name,
        _ => host,
    }
}

#[cfg(test)]
mod tests {
    use axum::body::Body;
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Flags {
        #[command(flatten)]
        config: Config,
    }

    fn config(flags: &[&str]) -> Config {
        Flags::parse_from([&["t"], flags].concat()).config
    }

    #[test]
    fn hosts_are_known_by_name_or_address() {
        let lan = ["--listen=192.168.0.5:80", "--allow-unauthenticated"];
        let named = ["--allowed-hosts=meshway, mesh.example:443"];
        let rows: [(&[&str], &str, bool); 19] = [
            (&[], "localhost", true),
            (&[], "LocalHost.:8080", true),
            (&[], "a.localhost:1", true),
            (&[], "127.0.0.1:8080", true),
            (&[], "127.9.9.9", true),
            (&[], "[::1]:8080", true),
            (&[], "[::1]", true),
            (&[], "evil.example:8080", false),
            (&[], "localhost.evil.example", false),
            (&[], "127.0.0.1.evil.example", false),
            (&[], "192.168.0.5", false),
            (&[], "", false),
            (&lan, "192.168.0.5", true),
            (&lan, "10.1.2.3:80", true),
            (&lan, "evil.example", false),
            (&named, "Meshway:8080", true),
            (&named, "mesh.example", true),
            (&named, "evil.example", false),
            (&["--allowed-hosts=*"], "evil.example", true),
        ];
        for (flags, host, expected) in rows {
            assert_eq!(
                answers_to(&config(flags), host),
                expected,
                "{flags:?} {host}"
            );
        }
    }

    #[test]
    fn what_comes_with_a_cookie_comes_from_a_page_of_this_service() {
        let rows = [
            (None, None, true),
            (None, Some("same-origin"), true),
            (None, Some("none"), true),
            (None, Some("same-site"), false),
            (None, Some("cross-site"), false),
            (Some("http://localhost:3000"), None, false),
            (Some("http://localhost:8080"), Some("same-origin"), true),
        ];
        for (origin, site, expected) in rows {
            let mut headers = HeaderMap::new();
            headers.insert(HOST, "localhost:8080".parse().unwrap());
            for (name, value) in [(ORIGIN, origin), (SEC_FETCH_SITE, site)] {
                headers.extend(value.map(|value| (name, value.parse().unwrap())));
            }
            let checked = check_cookie(&config(&[]), &headers, &Uri::from_static("/v1/jobs"));
            assert_eq!(checked.is_ok(), expected, "{origin:?} {site:?}");
        }
    }

    #[test]
    fn changes_are_taken_from_pages_of_this_service_alone() {
        let rows = [
            ("POST", None, None, true),
            (
                "POST",
                Some("http://localhost:8080"),
                Some("same-origin"),
                true,
            ),
            ("POST", Some("https://LOCALHOST:8080"), None, true),
            (
                "POST",
                Some("http://localhost:3000"),
                Some("same-site"),
                false,
            ),
            (
                "POST",
                Some("http://evil.example"),
                Some("cross-site"),
                false,
            ),
            ("POST", Some("null"), None, false),
            ("POST", None, Some("cross-site"), false),
            ("DELETE", Some("http://evil.example"), None, false),
            ("GET", Some("http://evil.example"), Some("cross-site"), true),
        ];
        for (method, origin, site, expected) in rows {
            let mut request = Request::builder().method(method).uri("/v1/jobs");
            request = request.header(HOST, "localhost:8080");
            for (name, value) in [(ORIGIN, origin), (SEC_FETCH_SITE, site)] {
                if let Some(value) = value {
                    request = request.header(name, value);
                }
            }
            let checked = check(&config(&[]), &request.body(Body::empty()).unwrap());
            assert_eq!(checked.is_ok(), expected, "{method} {origin:?} {site:?}");
            let detail = checked.map_or_else(|error| error.body(None).detail, |()| String::new());
            let named = origin.unwrap_or("another site");
            assert!(expected || detail.contains(named), "{detail}");
        }
    }
}
