//! Erasing and cancelling by label.

use axum::body::Body;
use axum::http::Request;
use serde_json::json;

use crate::http::contract::expect_contract;
use crate::http::retention::Timed;
use crate::http::support::{form_request, sphere_xyz};
use crate::http::tenants::{Held, configure};

#[tokio::test]
async fn a_label_erases_its_jobs_and_their_clouds() {
    let timed = Timed::with(&[]).await;
    let service = &timed.service;
    let (ours, theirs) = (Held::all("radiology"), Held::all("surgery"));
    let marked = |patient: &str| json!({"labels": {"patient": patient}});
    let first = timed.ended(0.0, marked("p7")).await;
    let shown = timed.show(&first).await;
    let cloud = shown["links"]["cloud"].as_str().unwrap().to_owned();
    let second = timed.ended(1.0, marked("p7")).await;
    let shared = timed.show(&second).await["links"]["cloud"]
        .as_str()
        .unwrap()
        .to_owned();
    // Of the same bytes, for somebody else.
    let other = timed.ended(1.0, marked("p8")).await;
    let held = timed.ended(2.0, marked("p7")).await;
    timed.patch(&held, json!({"hold": true})).await.expect(200);
    let waits = timed
        .submit(json!({"cloud_id": shown["cloud_id"], "labels": {"patient": "p7"}}))
        .await;
    service
        .delete("/v1/jobs")
        .await
        .expect_problem(422, "request_invalid");
    service
        .delete("/v1/jobs?label=p7")
        .await
        .expect_problem(422, "request_invalid");
    let erased = service.delete("/v1/jobs?label=patient:p7").await;
    expect_contract(&erased, "delete", "/v1/jobs");
    assert_eq!(
        erased.expect(200).json(),
        json!({"jobs": 3, "clouds": 1, "held": 1})
    );
    for gone in [&first, &second, &waits, &cloud] {
        timed.expect_gone(gone, "deleted").await;
    }
    for stays in [&other, &held, &shared] {
        timed.show(stays).await;
    }
    let erased = service
        .delete("/v1/jobs?label=patient:p8&clouds=false")
        .await;
    assert_eq!(
        erased.expect(200).json(),
        json!({"jobs": 1, "clouds": 0, "held": 0})
    );
    timed.show(&shared).await;
    // Nobody else's.
    configure(service, &[&ours, &theirs]);
    let submit = |key| {
        let body = json!({"labels": {"patient": "p9"}}).to_string();
        let form = form_request(
            "/v1/jobs",
            &[
                ("job", "", body.as_bytes()),
                ("file", "", sphere_xyz(100, 5.0).as_bytes()),
            ],
        );
        service.ask(key, form)
    };
    submit(&ours).await.expect(202);
    let job = submit(&theirs).await.expect(202).json();
    let erase = Request::delete("/v1/jobs?label=patient:p9").body(Body::empty());
    let erased = service.ask(&ours, erase.unwrap()).await;
    assert_eq!(
        erased.expect(200).json(),
        json!({"jobs": 1, "clouds": 1, "held": 0})
    );
    let theirs_job = job["links"]["self"].as_str().unwrap();
    service.fetch(&theirs, theirs_job).await.expect(200);
    let content = format!("{}/content", job["links"]["cloud"].as_str().unwrap());
    service.fetch(&theirs, &content).await.expect(200);
}

#[tokio::test]
async fn a_label_cancels_its_jobs_that_have_not_ended() {
    let timed = Timed::with(&[]).await;
    let service = &timed.service;
    let ended = timed.ended(0.0, json!({"labels": {"patient": "p7"}})).await;
    let cloud = timed.show(&ended).await["cloud_id"].clone();
    let submit = async |patient: &str| {
        let job = json!({"cloud_id": cloud, "labels": {"patient": patient}});
        timed.submit(job).await
    };
    let running = submit("p7").await;
    let claim = service.claim().await;
    let (waits, other) = (submit("p7").await, submit("p8").await);
    let cancel = async |label: &str| {
        let path = format!("/v1/jobs/cancel?label={label}");
        service.post_json(&path, &json!({})).await
    };
    cancel("p7").await.expect_problem(422, "request_invalid");
    let asked = cancel("patient:p7").await.expect(200);
    expect_contract(&asked, "post", "/v1/jobs/cancel");
    assert_eq!(asked.json(), json!({"jobs": 2}));
    for (job, status, requested) in [
        (&ended, "succeeded", false),
        (&running, "running", true),
        (&waits, "cancelled", true),
        (&other, "queued", false),
    ] {
        let shown = timed.show(job).await;
        assert_eq!(shown["status"], status);
        assert_eq!(shown["cancel_requested"], requested, "{shown}");
    }
    // Once is enough.
    assert_eq!(cancel("patient:p7").await.json(), json!({"jobs": 0}));
    service.store().cancelled(&claim).await.unwrap();
    assert_eq!(timed.show(&running).await["status"], "cancelled");
}
