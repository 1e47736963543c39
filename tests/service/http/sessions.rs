//! Browsers that keep a key.

use axum::body::Body;
use axum::http::Request;
use meshway::identity::Scope;
use serde_json::{Value, json};

use crate::http::contract::expect_contract;
use crate::http::support::Service;
use crate::http::tenants::{Held, configure};

#[tokio::test]
async fn a_browser_that_signed_in_asks_with_its_cookie_until_it_signs_out() {
    let service = Service::new().await;
    let key = Held::new("radiology", &[Scope::Read]);
    configure(&service, &[&key]);
    let post = |origin: &str| {
        let request = Request::post("/v1/session").header("origin", origin);
        request.body(Body::empty()).unwrap()
    };
    service
        .send(post("http://localhost"))
        .await
        .expect_problem(401, "unauthenticated");
    let answer = service
        .ask(&key, post("http://localhost"))
        .await
        .expect(204);
    expect_contract(&answer, "post", "/v1/session");
    let cookie = answer.header("set-cookie").to_owned();
    for part in ["HttpOnly", "SameSite=Strict", "Path=/;", "Max-Age=43200"] {
        assert!(cookie.contains(part), "{cookie}");
    }
    assert!(!cookie.contains("Secure"), "{cookie}");
    let (pair, _) = cookie.split_once(';').unwrap();
    let get = |path: &str| Request::get(path).header("cookie", pair);
    let jobs = get("/v1/jobs").body(Body::empty()).unwrap();
    service.send(jobs).await.expect(200);
    let own = get("/v1/session").body(Body::empty()).unwrap();
    let own = service.send(own).await.expect(200);
    expect_contract(&own, "get", "/v1/session");
    let name = format!("radiology-{}", key.secret.hash().id());
    assert_eq!(
        own.json(),
        json!({"name": name, "tenant": "radiology", "scopes": ["read"]})
    );
    // The cookie opens what the key opens, and no more.
    let keys = get("/v1/keys").body(Body::empty()).unwrap();
    service.send(keys).await.expect_problem(403, "forbidden");
    let out = Request::delete("/v1/session").header("origin", "http://localhost");
    let answer = service
        .send(out.body(Body::empty()).unwrap())
        .await
        .expect(204);
    expect_contract(&answer, "delete", "/v1/session");
    let emptied = answer.header("set-cookie");
    assert!(
        emptied.starts_with("meshway-key=;") && emptied.contains("Max-Age=0"),
        "{emptied}"
    );
}

#[tokio::test]
async fn a_page_that_came_over_tls_gets_a_cookie_that_stays_on_it() {
    let service = Service::new().await;
    let key = Held::new("radiology", &[Scope::Read]);
    configure(&service, &[&key]);
    let request = Request::post("/v1/session").header("origin", "https://localhost");
    let answer = service
        .ask(&key, request.body(Body::empty()).unwrap())
        .await;
    assert!(
        answer
            .expect(204)
            .header("set-cookie")
            .ends_with("; Secure")
    );
}

#[tokio::test]
async fn without_keys_anybody_may_do_everything() {
    let answer = Service::new().await.get("/v1/session").await.expect(200);
    expect_contract(&answer, "get", "/v1/session");
    let own = answer.json();
    assert_eq!(own["name"], Value::Null);
    assert_eq!(
        own["scopes"],
        json!(["read", "write", "delete", "audit", "admin"])
    );
}

#[tokio::test]
async fn other_sites_cannot_sign_anybody_out() {
    let service = Service::new().await;
    let out = Request::delete("/v1/session").header("origin", "http://elsewhere.example");
    let answer = service.send(out.body(Body::empty()).unwrap()).await;
    answer.expect_problem(403, "cross_origin_refused");
}
