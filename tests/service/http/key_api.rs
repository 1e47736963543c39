//! Keys that are made and taken out of use over HTTP.

use axum::body::Body;
use axum::http::Request;
use meshway::identity::{Keyring, Scope, Secret};
use serde_json::{Value, json};

use crate::http::contract::expect_contract;
use crate::http::support::{Answer, Service, json_request};
use crate::http::tenants::{Held, configure};

async fn make(service: &Service, key: &Held, body: Value) -> Answer {
    service.ask(key, json_request("/v1/keys", &body)).await
}

fn held(answer: &Answer) -> Held {
    let secret: Secret = answer.json()["key"].as_str().unwrap().parse().unwrap();
    Held {
        secret,
        block: String::new(),
    }
}

async fn take_out(service: &Service, key: &Held, id: &str) -> Answer {
    let path = format!("/v1/keys/{id}");
    let answer = service
        .ask(key, Request::delete(&path).body(Body::empty()).unwrap())
        .await;
    expect_contract(&answer, "delete", "/v1/keys/{id}");
    answer
}

#[tokio::test]
async fn a_key_that_was_made_opens_its_tenant_until_it_is_taken_out_of_use() {
    let service = Service::new().await;
    let (ours, theirs) = (Held::all("radiology"), Held::all("surgery"));
    configure(&service, &[&ours, &theirs]);
    let asked = json!({"name": "pacs", "scopes": ["read"], "limits": {"requests_per_minute": 50}});
    let made = make(&service, &ours, asked.clone()).await.expect(201);
    expect_contract(&made, "post", "/v1/keys");
    assert_eq!(made.header("cache-control"), "no-store");
    let (key, id) = (held(&made), made.json()["id"].as_str().unwrap().to_owned());
    assert_eq!(made.json()["tenant"], "radiology");
    let answer = service.fetch(&key, "/v1/jobs").await.expect(200);
    assert_eq!(answer.header("ratelimit"), "\"key-requests\";r=49;t=60");
    service
        .fetch(&key, "/v1/keys")
        .await
        .expect_problem(403, "forbidden");
    let same = make(&service, &ours, asked.clone()).await;
    same.expect_problem(409, "key_name");
    // The same name is another tenant's to give.
    make(&service, &theirs, asked).await.expect(201);

    let listed = service.fetch(&ours, "/v1/keys").await.expect(200);
    let text = String::from_utf8(listed.body.clone()).unwrap();
    assert!(!text.contains(key.secret.reveal()), "{text}");
    let items = listed.json()["items"].as_array().unwrap().clone();
    let made_here: Vec<_> = items.iter().filter(|key| key["in_file"] == false).collect();
    assert_eq!(
        (items.len(), made_here[0]["id"].as_str()),
        (2, Some(id.as_str()))
    );

    // SIGHUP leaves it, and a restart finds it.
    configure(&service, &[&ours, &theirs]);
    service.fetch(&key, "/v1/jobs").await.expect(200);
    let kept = service.store().keys().await.unwrap();
    assert!(kept.iter().any(|kept| kept.hash == key.secret.hash()));

    // For another tenant it is as one that never was.
    let foreign = take_out(&service, &theirs, &id)
        .await
        .expect_problem(404, "not_found");
    let missing = take_out(&service, &theirs, "00000000").await;
    let missing = missing.expect_problem(404, "not_found");
    assert_eq!(foreign["detail"], missing["detail"]);
    service.fetch(&key, "/v1/jobs").await.expect(200);

    take_out(&service, &ours, &id).await.expect(204);
    service
        .fetch(&key, "/v1/jobs")
        .await
        .expect_problem(401, "unauthenticated");
    take_out(&service, &ours, &id)
        .await
        .expect_problem(404, "not_found");
    assert_eq!(service.store().keys().await.unwrap().len(), 1);
    let in_file = ours.secret.hash().id();
    take_out(&service, &ours, &in_file)
        .await
        .expect_problem(409, "key_in_file");

    let trail = service.store().audit_after(0, 100).await.unwrap();
    let acts: Vec<_> = trail.iter().filter(|row| row.object == id).collect();
    let names: Vec<_> = acts.iter().map(|row| row.event.as_str()).collect();
    assert_eq!(names, ["key.create", "key.delete"]);
    assert_eq!(acts[0].tenant.as_deref(), Some("radiology"));
}

#[tokio::test]
async fn nobody_makes_a_key_that_opens_more_than_his_own() {
    let service = Service::new().await;
    let admin = Held::new("radiology", &[Scope::Admin]);
    configure(&service, &[&admin]);
    let wide = make(
        &service,
        &admin,
        json!({"name": "a", "scopes": ["admin", "read"]}),
    )
    .await;
    assert_eq!(wide.expect_problem(403, "forbidden")["scope"], "read");
    let same = make(&service, &admin, json!({"name": "a", "scopes": ["admin"]})).await;
    expect_contract(&same.expect(201), "post", "/v1/keys");
    for (body, pointer) in [
        (json!({"scopes": ["admin"]}), "/name"),
        (json!({"name": "b c", "scopes": ["admin"]}), "/name"),
        (json!({"name": "b"}), "/scopes"),
        (json!({"name": "b", "scopes": []}), "/scopes"),
        (json!({"name": "b", "scopes": ["all"]}), "/scopes"),
        (
            json!({"name": "b", "scopes": ["admin"], "tenant": "surgery"}),
            "/tenant",
        ),
        (
            json!({"name": "b", "scopes": ["admin"], "networks": ["x"]}),
            "/networks",
        ),
        (
            json!({"name": "b", "scopes": ["admin"], "expires_at": "soon"}),
            "/expires_at",
        ),
        (
            json!({"name": "b", "scopes": ["admin"], "limits": {"stored_mib": 1}}),
            "/limits",
        ),
        (
            json!({"name": "b", "scopes": ["admin"], "limits": {"queued_jobs": -1}}),
            "/limits",
        ),
    ] {
        let problem = make(&service, &admin, body.clone()).await;
        let problem = problem.expect_problem(422, "request_invalid");
        assert_eq!(problem["errors"][0]["pointer"], pointer, "{body} {problem}");
    }
}

#[tokio::test]
async fn the_first_key_comes_from_the_file() {
    let service = Service::new().await;
    let body = json!({"name": "a", "scopes": ["admin"]});
    let answer = service.post_json("/v1/keys", &body).await;
    answer.expect_problem(409, "key_in_file");
    assert!(service.app.config.keys.is_empty() && Keyring::default().is_empty());
}
