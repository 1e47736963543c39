//! People who sign in with a name and a password.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use axum::body::Body;
use axum::http::Request;
use axum::http::request::Builder;
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use meshway::identity::{Keyring, Password};
use meshway::jobs::Options;

use crate::http::contract::expect_contract;
use crate::http::support::{Answer, Service};

const RIGHT: &str = "correct horse: ä";

async fn service() -> (Service, Arc<AtomicI64>) {
    let clock = Arc::new(AtomicI64::new(1_000_000));
    let seen = Arc::clone(&clock);
    let options = Options {
        clock: Some(Arc::new(move || seen.load(Ordering::SeqCst))),
        ..Options::default()
    };
    let service = Service::over(&[], options).await;
    let password = Password::of(RIGHT).unwrap();
    let file = format!(
        "[[users]]\nname = \"anna\"\ntenant = \"radiology\"\npassword = \"{password}\"\nscopes = [\"read\"]\n"
    );
    let keyring = Keyring::of_file(&file).unwrap();
    service.app.config.keys.replace(&keyring).unwrap();
    (service, clock)
}

fn basic(request: Builder, name: &str, password: &str) -> Request<Body> {
    let pair = BASE64_STANDARD.encode(format!("{name}:{password}"));
    let request = request.header("authorization", format!("Basic {pair}"));
    request.body(Body::empty()).unwrap()
}

async fn sign_in(service: &Service, name: &str, password: &str) -> Answer {
    let request = Request::post("/v1/session").header("origin", "http://localhost");
    let answer = service.send(basic(request, name, password)).await;
    expect_contract(&answer, "post", "/v1/session");
    answer
}

fn pair(answer: &Answer) -> String {
    let cookie = answer.header("set-cookie");
    for part in ["HttpOnly", "SameSite=Strict", "Path=/;", "Max-Age=43200"] {
        assert!(cookie.contains(part), "{cookie}");
    }
    let (pair, _) = cookie.split_once(';').unwrap();
    assert!(pair.starts_with("meshway-session="), "{pair}");
    pair.to_owned()
}

async fn with_cookie(service: &Service, request: Builder, cookie: &str) -> Answer {
    let request = request.header("cookie", cookie);
    service.send(request.body(Body::empty()).unwrap()).await
}

#[tokio::test]
async fn a_person_signs_in_with_a_password_and_out_again() {
    let (service, clock) = service().await;
    let first = pair(&sign_in(&service, "anna", RIGHT).await.expect(204));
    let second = pair(&sign_in(&service, "anna", RIGHT).await.expect(204));
    assert_ne!(first, second);
    let jobs = async |cookie: &str| with_cookie(&service, Request::get("/v1/jobs"), cookie).await;
    jobs(&first).await.expect(200);
    let keys = with_cookie(&service, Request::get("/v1/keys"), &first).await;
    keys.expect_problem(403, "forbidden");
    let out = Request::delete("/v1/session").header("origin", "http://localhost");
    let out = with_cookie(&service, out, &first).await.expect(204);
    let emptied: Vec<_> = out.headers.get_all("set-cookie").iter().collect();
    assert_eq!(emptied.len(), 2);
    // A copy of the cookie is worth nothing, and the other session goes on.
    jobs(&first).await.expect_problem(401, "unauthenticated");
    jobs(&second).await.expect(200);
    clock.fetch_add(30 * 60_000, Ordering::SeqCst);
    jobs(&second).await.expect_problem(401, "unauthenticated");

    let trail = service.store().audit_after(0, 100).await.unwrap();
    let signed: Vec<_> = trail
        .iter()
        .filter(|row| row.event == "session.create")
        .collect();
    assert_eq!(signed.len(), 2);
    assert_eq!(signed[0].actor.as_deref(), Some("anna"));
    let denied = trail.iter().find(|row| row.event == "auth.deny").unwrap();
    assert_eq!(denied.actor.as_deref(), Some("anna"));
}

#[tokio::test]
async fn wrong_passwords_tell_nothing_and_are_slowed_down() {
    let (service, clock) = service().await;
    let mut told = Vec::new();
    for name in ["anna", "nobody"] {
        let answer = sign_in(&service, name, "wrong horse").await;
        told.push(answer.expect_problem(401, "unauthenticated")["detail"].clone());
    }
    assert_eq!(told[0], told[1]);
    for _ in 2..10 {
        let answer = sign_in(&service, "nobody", "wrong horse").await;
        answer.expect_problem(401, "unauthenticated");
    }
    let refused = sign_in(&service, "anna", RIGHT).await;
    assert_eq!(refused.header("retry-after"), "60");
    refused.expect_problem(429, "rate_limited");
    clock.fetch_add(60_000, Ordering::SeqCst);
    sign_in(&service, "anna", RIGHT).await.expect(204);
}

#[tokio::test]
async fn a_name_is_guessed_at_thirty_times_in_five_minutes_at_most() {
    let (service, clock) = service().await;
    for _ in 0..3 {
        for _ in 0..10 {
            let answer = sign_in(&service, "anna", "wrong horse").await;
            answer.expect_problem(401, "unauthenticated");
        }
        clock.fetch_add(60_000, Ordering::SeqCst);
    }
    let refused = sign_in(&service, "anna", "wrong horse").await;
    assert_eq!(refused.header("retry-after"), "120");
    refused.expect_problem(429, "rate_limited");
    clock.fetch_add(120_000, Ordering::SeqCst);
    sign_in(&service, "anna", RIGHT).await.expect(204);
}

#[tokio::test]
async fn a_password_opens_a_session_and_nothing_else() {
    let (service, _) = service().await;
    for path in ["/v1/jobs", "/v1/keys", "/v1/audit"] {
        let answer = service.send(basic(Request::get(path), "anna", RIGHT)).await;
        answer.expect_problem(401, "unauthenticated");
    }
}

#[tokio::test]
async fn a_cookie_is_taken_from_pages_of_this_service_for_reads_as_well() {
    let (service, _) = service().await;
    let cookie = pair(&sign_in(&service, "anna", RIGHT).await.expect(204));
    let read = async |name: &str, value: &str| {
        let request = Request::get("/v1/jobs").header(name, value);
        with_cookie(&service, request, &cookie).await
    };
    for (name, value) in [
        ("sec-fetch-site", "cross-site"),
        ("sec-fetch-site", "same-site"),
        ("origin", "http://localhost:3000"),
        ("origin", "null"),
    ] {
        let answer = read(name, value).await;
        answer.expect_problem(403, "cross_origin_refused");
    }
    read("sec-fetch-site", "same-origin").await.expect(200);
    read("sec-fetch-site", "none").await.expect(200);
}
