//! Webhooks as their owner sees them: made, changed, removed, and the messages to them.

use axum::body::Body;
use axum::http::Request;
use meshway::identity::Scope;
use serde_json::{Value, json};

use crate::http::contract::expect_contract;
use crate::http::support::{Answer, Service, json_request};
use crate::http::tenants::{Held, configure};

async fn make(service: &Service, body: Value) -> Answer {
    let answer = service.post_json("/v1/webhooks", &body).await;
    expect_contract(&answer, "post", "/v1/webhooks");
    answer
}

fn patch(path: &str, body: &Value) -> Request<Body> {
    let request = Request::patch(path).header("content-type", "application/json");
    request.body(Body::from(body.to_string())).unwrap()
}

#[tokio::test]
async fn a_webhook_is_made_changed_and_removed() {
    let service = Service::new().await;
    let made = make(&service, json!({"url": "https://ris.example.org/hook"})).await;
    let made = made.expect(201);
    assert_eq!(made.header("cache-control"), "no-store");
    let path = made.header("location").to_owned();
    let made = made.json();
    let secret = made["secret"].as_str().unwrap();
    assert!(
        secret.starts_with("whsec_") && secret.len() == 50,
        "{secret}"
    );
    assert_eq!(made["state"], "enabled");
    assert_eq!(
        made["events"],
        json!([
            "job.succeeded",
            "job.failed",
            "job.cancelled",
            "batch.ended"
        ])
    );

    let shown = service.get(&path).await.expect(200);
    expect_contract(&shown, "get", "/v1/webhooks/{id}");
    let listed = service.get("/v1/webhooks").await.expect(200);
    expect_contract(&listed, "get", "/v1/webhooks");
    assert_eq!(listed.json()["items"], json!([shown.json()]));
    for answer in [&shown, &listed] {
        assert!(!String::from_utf8_lossy(&answer.body).contains("secret"));
    }

    let change =
        json!({"url": "https://ris.example.org/other", "events": ["job.failed"], "enabled": false});
    let changed = service.send(patch(&path, &change)).await.expect(200);
    expect_contract(&changed, "patch", "/v1/webhooks/{id}");
    assert_eq!(changed.json()["url"], change["url"]);
    assert_eq!(changed.json()["events"], change["events"]);
    assert_eq!(changed.json()["state"], "disabled");

    let renewed = service
        .post_json(&format!("{path}/secret"), &json!({}))
        .await;
    let renewed = renewed.expect(200);
    expect_contract(&renewed, "post", "/v1/webhooks/{id}/secret");
    assert_ne!(renewed.json()["secret"], made["secret"]);

    service.delete(&path).await.expect(204);
    service.get(&path).await.expect_problem(404, "not_found");
    service.delete(&path).await.expect_problem(404, "not_found");
}

#[tokio::test]
async fn what_is_wrong_with_a_webhook_is_told_at_once() {
    let service = Service::with(&["--webhook-networks=10.20.0.0/16", "--webhook-ports=4430"]).await;
    for (body, pointers) in [
        (json!({}), &["/url"][..]),
        (json!({"url": "ris"}), &["/url"]),
        (
            json!({"url": "http://example.com:22/", "events": []}),
            &["/url", "/events"],
        ),
        (json!({"url": "https://127.0.0.1/"}), &["/url"]),
        (json!({"url": "http://8.8.8.8/"}), &["/url"]),
        (
            json!({"url": "https://a.example/", "events": ["job.started"]}),
            &["/events"],
        ),
        (
            json!({"url": "https://a.example/", "events": ["webhook.test"]}),
            &["/events"],
        ),
        (
            json!({"url": "https://a.example/", "secret": "x"}),
            &["/secret"],
        ),
    ] {
        let answer = make(&service, body.clone()).await;
        let problem = answer.expect_problem(422, "request_invalid");
        let faults = problem["errors"].as_array().unwrap();
        let told: Vec<_> = faults
            .iter()
            .map(|f| f["pointer"].as_str().unwrap())
            .collect();
        assert_eq!(told, pointers, "{body}: {problem}");
    }
    for good in [
        "http://10.20.0.7:8080/a?b=c",
        "https://a.example:4430/",
        "http://ris.local/",
    ] {
        make(&service, json!({"url": good})).await.expect(201);
    }
    assert_eq!(
        service.get("/v1/webhooks").await.json()["items"]
            .as_array()
            .unwrap()
            .len(),
        3
    );
}

#[tokio::test]
async fn a_tenant_has_so_many_webhooks_and_no_more() {
    let service = Service::new().await;
    let url = json!({"url": "https://a.example/"});
    for _ in 0..20 {
        make(&service, url.clone()).await.expect(201);
    }
    make(&service, url)
        .await
        .expect_problem(409, "webhook_limit");
}

#[tokio::test]
async fn messages_are_written_with_the_end_of_a_job_and_listed() {
    let service = Service::new().await;
    let ask = json!({"url": "https://a.example/", "events": ["job.failed", "job.cancelled"]});
    let path = make(&service, ask)
        .await
        .expect(201)
        .header("location")
        .to_owned();
    let failed = service.submit().await;
    service.fail(&service.claim().await, "no_surface").await;
    let cancelled = service.submit().await;
    let cancel = format!("/v1/jobs/{cancelled}/cancel");
    service.post_json(&cancel, &json!({})).await.expect(200);
    let test = service.post_json(&format!("{path}/test"), &json!({})).await;
    let test = test.expect(202);
    expect_contract(&test, "post", "/v1/webhooks/{id}/test");
    let at = test.header("location").to_owned();
    let shown = service.get(&at).await.expect(200);
    expect_contract(&shown, "get", "/v1/deliveries/{id}");
    assert_eq!(shown.json(), test.json());

    let list = format!("{path}/deliveries");
    let first = service.get(&format!("{list}?limit=2")).await.expect(200);
    expect_contract(&first, "get", "/v1/webhooks/{id}/deliveries");
    let cursor = first.json()["next_cursor"].as_str().unwrap().to_owned();
    let rest = service
        .get(&format!("{list}?cursor={cursor}"))
        .await
        .expect(200);
    let items = [first.json(), rest.json()].map(|page| page["items"].as_array().unwrap().clone());
    let items = items.concat();
    let told: Vec<_> = items
        .iter()
        .map(|i| (i["event"].as_str().unwrap(), &i["data"]["job_id"]))
        .collect();
    let (failed, cancelled) = (json!(failed), json!(cancelled));
    assert_eq!(
        told,
        [
            ("webhook.test", &Value::Null),
            ("job.cancelled", &cancelled),
            ("job.failed", &failed)
        ]
    );
    assert_eq!(
        items[2]["data"]["error"],
        json!({"code": "no_surface", "retryable": false})
    );
    assert_eq!(
        (&items[2]["state"], &items[2]["tries"]),
        (&json!("waiting"), &json!(0))
    );

    let again = service
        .post_json(&format!("{at}/redeliver"), &json!({}))
        .await;
    expect_contract(&again.expect(202), "post", "/v1/deliveries/{id}/redeliver");
    service.delete(&path).await.expect(204);
    service.get(&at).await.expect_problem(404, "not_found");
}

#[tokio::test]
async fn what_is_done_to_webhooks_is_in_the_trail() {
    let service = Service::new().await;
    let admin = Held::new("radiology", &[Scope::Admin]);
    configure(&service, &[&admin]);
    let ask = json_request("/v1/webhooks", &json!({"url": "https://a.example/"}));
    let made = service.ask(&admin, ask).await.expect(201).json();
    let id = made["id"].as_str().unwrap();
    let path = format!("/v1/webhooks/{id}");
    let test = json_request(&format!("{path}/test"), &json!({}));
    service.ask(&admin, test).await.expect(202);
    service
        .ask(&admin, patch(&path, &json!({"enabled": false})))
        .await
        .expect(200);
    let erase = Request::delete(&path).body(Body::empty()).unwrap();
    service.ask(&admin, erase).await.expect(204);
    let trail = service.store().audit_after(0, 100).await.unwrap();
    let told: Vec<_> = trail
        .iter()
        .map(|row| (row.event.as_str(), row.object.as_str()))
        .collect();
    assert_eq!(
        told,
        [
            ("webhook.create", id),
            ("webhook.send", id),
            ("webhook.change", id),
            ("webhook.delete", id),
        ]
    );
}
