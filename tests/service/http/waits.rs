//! Clients that wait for the end of their job.

use axum::body::Body;
use axum::http::Request;
use meshway::jobs::{NewMesh, Record, Success};
use serde_json::json;

use crate::http::contract::expect_contract;
use crate::http::support::{Service, json_request, tetrahedron};
use crate::server::{PATIENCE, until};

fn success() -> Success {
    Success {
        mesh: NewMesh::new(4, 4, tetrahedron()),
        report: json!({}),
        model: vec![1],
        last: Record::default(),
    }
}

fn with(mut request: Request<Body>, name: &'static str, value: &str) -> Request<Body> {
    request.headers_mut().insert(name, value.parse().unwrap());
    request
}

#[tokio::test]
async fn a_wait_is_answered_when_the_job_ends() {
    let service = Service::new().await;
    let cloud_id = service.upload().await;
    let body = json!({"cloud_id": cloud_id});
    let waiting = with(json_request("/v1/jobs", &body), "prefer", "wait=60");
    let answer = tokio::spawn(service.send(waiting));
    let claim = claim_when_there(&service).await;
    service.store().succeed(&claim, success()).await.unwrap();
    let answer = answer.await.unwrap().expect(200);
    assert_eq!(answer.json()["status"], "succeeded");
    assert_eq!(answer.header("preference-applied"), "wait=60");

    let waiting = with(json_request("/v1/jobs", &body), "prefer", "wait=60");
    let answer = tokio::spawn(service.send(with(waiting, "accept", "model/obj")));
    service
        .fail(&claim_when_there(&service).await, "no_surface")
        .await;
    answer.await.unwrap().expect_problem(422, "no_surface");

    let late = with(json_request("/v1/jobs", &body), "prefer", "wait=1");
    let late = service.send(late).await.expect(202);
    assert_eq!(
        (&late.json()["status"], late.header("preference-applied")),
        (&json!("queued"), "wait=1")
    );
}

#[tokio::test]
async fn a_mesh_that_answers_says_where_its_job_is() {
    let service = Service::new().await;
    let body = json!({"cloud_id": service.upload().await});
    for (accept, media_type) in [
        ("model/obj", "model/obj"),
        ("model/stl;q=0.9, application/json;q=0.1", "model/stl"),
        ("model/stl;q=0.1, application/json", "application/json"),
        ("*/*", "application/json"),
    ] {
        let waiting = with(json_request("/v1/jobs", &body), "prefer", "wait=60");
        let answer = tokio::spawn(service.send(with(waiting, "accept", accept)));
        let claim = claim_when_there(&service).await;
        service.store().succeed(&claim, success()).await.unwrap();
        let answer = answer.await.unwrap().expect(200);
        expect_contract(&answer, "post", "/v1/jobs");
        assert_eq!(answer.header("content-type"), media_type);
        let url = format!("/v1/jobs/{}", claim.job.id);
        assert_eq!(answer.header("location"), url);
        assert_eq!(answer.header("preference-applied"), "wait=60");
        if media_type != "application/json" {
            let link = format!("<{url}>; rel=\"describedby\"");
            assert_eq!(answer.header("link"), link);
            assert_eq!(answer.header("vary"), "accept");
        }
    }
}

#[tokio::test]
async fn what_cannot_be_given_is_refused_before_there_is_a_job() {
    let service = Service::new().await;
    let body = json!({"cloud_id": service.upload().await});
    let png = with(json_request("/v1/jobs", &body), "accept", "image/png");
    let problem = service
        .send(with(png, "prefer", "wait=60"))
        .await
        .expect_problem(406, "not_acceptable");
    assert_eq!(problem["acceptable"][0], "application/json");
    assert_eq!(problem["acceptable"].as_array().unwrap().len(), 9);
    assert_eq!(service.get("/v1/jobs").await.json()["items"], json!([]));
}

#[tokio::test]
async fn a_preference_that_is_not_understood_is_ignored() {
    let service = Service::new().await;
    let body = json!({"cloud_id": service.upload().await});
    let request = with(json_request("/v1/jobs", &body), "prefer", "wait=long");
    let answer = service.send(request).await.expect(202);
    assert!(!answer.headers.contains_key("preference-applied"));
}

async fn claim_when_there(service: &Service) -> meshway::jobs::Claim {
    until("a job is submitted", PATIENCE, async || {
        service.store().claim("worker", 60_000).await.unwrap()
    })
    .await
}

#[tokio::test]
async fn a_client_that_hangs_up_cancels_nothing() {
    let service = Service::new().await;
    let cloud_id = service.upload().await;
    let waiting = with(
        json_request("/v1/jobs", &json!({"cloud_id": cloud_id})),
        "prefer",
        "wait=60",
    );
    let waiting = tokio::spawn(service.send(waiting));
    let claim = claim_when_there(&service).await;
    waiting.abort();
    assert!(waiting.await.unwrap_err().is_cancelled());
    service.store().succeed(&claim, success()).await.unwrap();
}
