//! Requests that are sent again with their key.

use axum::body::{Body, Bytes};
use axum::http::Request;
use futures_util::{StreamExt, stream};
use meshway::jobs::IdempotencyState;
use serde_json::json;

use crate::http::support::{Service, json_request, sphere_xyz, upload_request};
use crate::server::{PATIENCE, until};
use crate::who::us;

fn keyed(mut request: Request<Body>, key: &str) -> Request<Body> {
    request
        .headers_mut()
        .insert("idempotency-key", key.parse().unwrap());
    request
}

#[tokio::test]
async fn a_repeated_submission_makes_one_job_and_gets_the_first_answer() {
    let service = Service::new().await;
    let cloud_id = service.upload().await;
    let request = || {
        keyed(
            json_request("/v1/jobs", &json!({"cloud_id": cloud_id})),
            "a",
        )
    };
    let first = service.send(request()).await.expect(202);
    assert!(!first.headers.contains_key("idempotency-replayed"));
    let again = service.send(request()).await.expect(202);
    assert_eq!(again.header("idempotency-replayed"), "true");
    assert_eq!(again.json(), first.json());
    for header in ["location", "etag", "retry-after", "content-type"] {
        assert_eq!(again.header(header), first.header(header));
    }
    service
        .send(keyed(
            json_request("/v1/jobs", &json!({"cloud_id": cloud_id, "preset": "fast"})),
            "a",
        ))
        .await
        .expect_problem(422, "idempotency_mismatch");
    // The address is part of the request.
    service
        .send(keyed(
            json_request("/v1/jobs?dry_run=1", &json!({"cloud_id": cloud_id})),
            "a",
        ))
        .await
        .expect_problem(422, "idempotency_mismatch");
    service
        .send(keyed(
            json_request("/v1/jobs", &json!({"cloud_id": cloud_id})),
            "b",
        ))
        .await
        .expect(202);
    assert_eq!(
        service.get("/v1/jobs").await.json()["items"]
            .as_array()
            .unwrap()
            .len(),
        2
    );
}

#[tokio::test]
async fn uploads_cancels_and_retries_have_keys_too() {
    let service = Service::new().await;
    let upload = || keyed(upload_request(sphere_xyz(100, 0.0)), "k");
    let first = service.send(upload()).await.expect(201).json();
    let again = service.send(upload()).await.expect(201);
    assert_eq!(
        (again.json(), again.header("idempotency-replayed")),
        (first, "true")
    );
    service
        .send(keyed(upload_request(sphere_xyz(101, 0.0)), "k"))
        .await
        .expect_problem(422, "idempotency_mismatch");

    let id = service.submit().await;
    let cancel = || {
        keyed(
            json_request(&format!("/v1/jobs/{id}/cancel"), &json!({})),
            "k",
        )
    };
    let first = service.send(cancel()).await.expect(200).json();
    assert_eq!(service.send(cancel()).await.expect(200).json(), first);
    let retry = || {
        keyed(
            json_request(&format!("/v1/jobs/{id}/retry"), &json!({})),
            "k",
        )
    };
    let first = service.send(retry()).await.expect(202).json();
    assert_eq!(service.send(retry()).await.expect(202).json(), first);
}

#[tokio::test]
async fn a_refused_request_does_not_use_its_key_up() {
    let service = Service::new().await;
    let missing = json!({"cloud_id": format!("cld_{}", "0".repeat(32))});
    service
        .send(keyed(json_request("/v1/jobs", &missing), "a"))
        .await
        .expect_problem(422, "cloud_missing");
    let cloud_id = service.upload().await;
    // The key is forgotten in the background.
    until("the key is forgotten", PATIENCE, async || {
        let job = json_request("/v1/jobs", &json!({"cloud_id": cloud_id}));
        let answer = service.send(keyed(job, "a")).await;
        (answer.status == 202).then_some(())
    })
    .await;
}

#[tokio::test]
async fn a_second_request_while_the_first_runs_is_told_to_wait() {
    let service = Service::new().await;
    // What the first request, still at work, has written.
    let hash = {
        use sha2::{Digest, Sha256};
        let mut hash = Sha256::new();
        for part in [&b""[..], b"{}"] {
            hash.update((part.len() as u64).to_le_bytes());
            hash.update(part);
        }
        hex::encode(hash.finalize())
    };
    let path = format!("/v1/jobs/{}/cancel", service.submit().await);
    let scope = format!("POST {path}");
    let begun = service
        .store()
        .by(us())
        .idempotency_begin("a", &scope, &hash)
        .await
        .unwrap();
    assert_eq!(begun, IdempotencyState::New);
    let answer = service
        .send(keyed(json_request(&path, &json!({})), "a"))
        .await;
    assert_eq!(answer.header("retry-after"), "1");
    answer.expect_problem(409, "idempotency_in_flight");
}

#[tokio::test]
async fn an_upload_that_broke_off_may_be_tried_again() {
    let service = Service::new().await;
    let start = stream::iter([Ok::<_, std::io::Error>(Bytes::from_static(b"0 0 0\n"))]);
    let never_ends = Body::from_stream(start.chain(stream::pending()));
    let first = tokio::spawn(service.send(keyed(upload_request(never_ends), "a")));
    service
        .until("the upload has begun", |service| {
            !service.files("tmp").is_empty()
        })
        .await;
    first.abort();
    service
        .until("its file is gone", |service| {
            service.files("tmp").is_empty()
        })
        .await;
    service
        .send(keyed(upload_request(sphere_xyz(100, 0.0)), "a"))
        .await
        .expect(201);
}

#[tokio::test]
async fn keys_have_a_form() {
    let service = Service::new().await;
    for key in ["", &"k".repeat(256)] {
        let request = keyed(json_request("/v1/jobs", &json!({})), key);
        service
            .send(request)
            .await
            .expect_problem(400, "bad_header");
    }
}

#[tokio::test]
async fn an_answered_key_is_answered_while_no_new_work_is_taken() {
    let service = Service::new().await;
    let upload = || keyed(upload_request(sphere_xyz(100, 0.0)), "k");
    let first = service.send(upload()).await.expect(201).json();
    let job = json!({ "cloud_id": first["id"] });
    let submit = |key| keyed(json_request("/v1/jobs", &job), key);
    let submitted = service.send(submit("k")).await.expect(202).json();
    service.app.shutdown.cancel();
    assert_eq!(service.send(upload()).await.expect(201).json(), first);
    let again = service.send(submit("k")).await.expect(202);
    assert_eq!(again.json(), submitted);
    service
        .send(submit("new"))
        .await
        .expect_problem(503, "draining");
}

#[tokio::test]
async fn a_key_outlives_its_job() {
    let service = Service::new().await;
    let cloud_id = service.upload().await;
    let submit = || {
        keyed(
            json_request("/v1/jobs", &json!({"cloud_id": cloud_id})),
            "k",
        )
    };
    let id = service.send(submit()).await.expect(202).json()["id"].clone();
    let job = format!("/v1/jobs/{}", id.as_str().unwrap());
    let cancel = || keyed(json_request(&format!("{job}/cancel"), &json!({})), "c");
    service.send(cancel()).await.expect(200);
    service.delete(&job).await.expect(204);
    for request in [submit(), cancel()] {
        let problem = service.send(request).await.expect_problem(410, "gone");
        assert_eq!(problem["reason"], "deleted");
    }
    let left = service.get("/v1/jobs").await.json();
    assert_eq!(left["items"], json!([]));
}
