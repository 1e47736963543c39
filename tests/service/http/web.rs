//! The dashboard as the program hands it out; all of this holds for a program that was built
//! without it, too.

use std::io::Read;

use axum::body::Body;
use axum::http::Request;
use flate2::read::GzDecoder;

use crate::http::contract::expect_contract;
use crate::http::support::Service;

/// Addresses of the files that a page names.
fn assets(html: &str) -> Vec<&str> {
    let parts = html.split('"');
    parts.filter(|part| part.starts_with("/assets/")).collect()
}

#[tokio::test]
async fn the_page_and_its_files_come_packed_and_plain() {
    let service = Service::new().await;
    let plain = service.get("/").await.expect(200);
    let html = String::from_utf8(plain.body.clone()).unwrap();
    let built = html.contains("/assets/");
    for path in ["/"].into_iter().chain(assets(&html)) {
        let plain = service.get(path).await.expect(200);
        let asked = Request::get(path).header("accept-encoding", "gzip, br");
        let packed = service.send(asked.body(Body::empty()).unwrap()).await;
        let packed = packed.expect(200);
        if built {
            assert_eq!(packed.header("content-encoding"), "gzip", "{path}");
            assert!(!plain.headers.contains_key("content-encoding"), "{path}");
            assert_eq!(packed.header("vary"), "accept-encoding");
            let mut unpacked = Vec::new();
            GzDecoder::new(packed.body.as_slice())
                .read_to_end(&mut unpacked)
                .unwrap();
            assert!(unpacked == plain.body, "{path}");
        }
        if path != "/" {
            expect_contract(&plain, "get", "/assets/{file}");
            assert!(plain.header("cache-control").contains("immutable"));
            assert_eq!(plain.header("x-content-type-options"), "nosniff");
        }
    }
}

#[tokio::test]
async fn the_page_is_asked_for_again_and_kept() {
    let service = Service::new().await;
    let page = service.get("/").await.expect(200);
    if assets(&String::from_utf8_lossy(&page.body)).is_empty() {
        return;
    }
    assert_eq!(page.header("cache-control"), "no-cache");
    let policy = page.header("content-security-policy");
    assert!(!policy.contains("unsafe") && policy.contains("connect-src 'self'"));
    let known = Request::get("/").header("if-none-match", page.header("etag"));
    let known = service.send(known.body(Body::empty()).unwrap()).await;
    assert!(known.expect(304).body.is_empty());
}

#[tokio::test]
async fn there_are_no_other_files() {
    let service = Service::new().await;
    for name in ["index.html", "stamp", "main.js", "%2e%2e%2fCargo.toml"] {
        let answer = service.get(&format!("/assets/{name}")).await;
        answer.expect_problem(404, "not_found");
    }
}
