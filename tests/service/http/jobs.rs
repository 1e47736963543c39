//! Jobs as a client meets them.

use axum::body::Body;
use axum::http::Request;
use meshway::reconstruction::Preset;
use serde_json::{Value, json};

use crate::http::contract::expect_contract;
use crate::http::support::{Service, form_request, job_id, sphere_xyz};
use crate::who::ours;

fn with(mut request: Request<Body>, name: &'static str, value: &str) -> Request<Body> {
    request.headers_mut().insert(name, value.parse().unwrap());
    request
}

#[tokio::test]
async fn a_job_is_submitted_polled_cancelled_and_erased() {
    let service = Service::new().await;
    let cloud_id = service.upload().await;
    let asked = json!({
        "cloud_id": cloud_id, "preset": "fast", "labels": {"ward": "3"},
        "settings": {"training": {"seed": 7}},
    });
    let answer = service.post_json("/v1/jobs", &asked).await.expect(202);
    let job = answer.json();
    let url = job["links"]["self"].as_str().unwrap().to_owned();
    assert_eq!(
        (answer.header("location"), answer.header("retry-after")),
        (url.as_str(), "1")
    );
    assert_eq!(
        (&job["status"], &job["queue_position"]),
        (&json!("queued"), &json!(1))
    );
    assert_eq!(
        (&job["settings"]["training"]["seed"], &job["labels"]),
        (&json!(7), &json!({"ward": "3"}))
    );
    assert_eq!(job["settings"]["surface"]["resolution"], 128);
    let second = service
        .post_json("/v1/jobs", &asked)
        .await
        .expect(202)
        .json();
    assert_eq!(second["queue_position"], 2);

    let polled = service.get(&url).await.expect(200);
    assert_eq!(polled.json(), job);
    assert!(polled.header("etag").starts_with("W/\""));
    let same = with(
        Request::get(&url).body(Body::empty()).unwrap(),
        "if-none-match",
        polled.header("etag"),
    );
    let same = service.send(same).await.expect(304);
    assert!(same.body.is_empty() && same.headers.contains_key("retry-after"));
    service.claim().await;
    let running = with(
        Request::get(&url).body(Body::empty()).unwrap(),
        "if-none-match",
        polled.header("etag"),
    );
    let running = service.send(running).await.expect(200).json();
    assert_eq!(
        (&running["status"], &running["attempt"]),
        (&json!("running"), &json!(1))
    );
    assert_eq!(running["queue_position"], Value::Null);

    let cancel = format!("{url}/cancel");
    let cancelling = service
        .post_json(&cancel, &json!({}))
        .await
        .expect(200)
        .json();
    assert_eq!(
        (&cancelling["status"], &cancelling["cancel_requested"]),
        (&json!("running"), &json!(true))
    );
    service
        .store()
        .cancelled(&claim_of(&service, &url).await)
        .await
        .unwrap();
    for _ in 0..2 {
        let cancelled = service
            .send(Request::post(&cancel).body(Body::empty()).unwrap())
            .await;
        assert_eq!(cancelled.expect(200).json()["status"], "cancelled");
    }
    assert!(!service.get(&url).await.headers.contains_key("retry-after"));

    service.delete(&url).await.expect(204);
    let problem = service.get(&url).await.expect_problem(410, "gone");
    assert_eq!(problem["reason"], "deleted");
    assert!(problem["deleted_at"].as_str().unwrap().ends_with('Z'));
    service.delete(&url).await.expect_problem(410, "gone");
    service
        .post_json(&cancel, &json!({}))
        .await
        .expect_problem(410, "gone");
}

/// The claim that a running job's worker holds.
async fn claim_of(service: &Service, url: &str) -> meshway::jobs::Claim {
    let id = job_id(url.rsplit('/').next().unwrap());
    let job = service
        .store()
        .of(ours())
        .job(&id)
        .await
        .unwrap()
        .found()
        .unwrap();
    meshway::jobs::Claim {
        attempt: job.attempt,
        worked: std::time::Duration::ZERO,
        job,
    }
}

#[tokio::test]
async fn a_cloud_may_come_with_its_job() {
    let service = Service::new().await;
    let raw = Request::post("/v1/jobs?preset=fast")
        .body(sphere_xyz(60, 0.0).into())
        .unwrap();
    let job = service.send(raw).await.expect(202).json();
    assert_eq!(job["preset"], "fast");
    let points = sphere_xyz(60, 0.0);
    let parts: [(&str, &str, &[u8]); 2] = [
        (
            "job",
            "",
            br#"{"settings": {"surface": {"resolution": 40}}}"#,
        ),
        ("file", "; filename=\"a.xyz\"", points.as_bytes()),
    ];
    let form = service
        .send(form_request("/v1/jobs?preset=fine", &parts))
        .await
        .expect(202)
        .json();
    assert_eq!(
        (&form["preset"], &form["settings"]["surface"]["resolution"]),
        (&json!("fine"), &json!(40))
    );
    assert_eq!(form["cloud_id"], job["cloud_id"]);
}

#[tokio::test]
async fn a_dry_run_tells_settings_and_cost_and_does_nothing() {
    let service = Service::new().await;
    let cloud_id = service.upload().await;
    let asked = json!({"cloud_id": cloud_id, "preset": "fast"});
    let dry = service
        .post_json("/v1/jobs?dry_run=true", &asked)
        .await
        .expect(200)
        .json();
    let fast = Preset::Fast.settings();
    // 100 surface points, two more for each pair of each, and the far ones.
    let samples = 100 * (1 + 2 * fast.sampling.near_pairs) + fast.sampling.far_points;
    assert_eq!(dry["estimate"]["samples"], samples);
    assert_eq!(dry["settings"], json!(fast));
    assert!(dry["estimate"]["max_training_seconds"].as_f64().unwrap() > 0.0);
    service
        .post_json("/v1/jobs?dry_run=1", &json!({}))
        .await
        .expect(200);
    assert_eq!(service.get("/v1/jobs").await.json()["items"], json!([]));
}

#[tokio::test]
async fn a_dry_run_reads_the_cloud_that_comes_with_it_and_keeps_nothing() {
    let service = Service::new().await;
    let raw = |body: String| {
        let request = Request::post("/v1/jobs?dry_run=1&preset=fast");
        request.body(body.into()).unwrap()
    };
    let points = sphere_xyz(60, 0.0);
    let far = Preset::Fast.settings().sampling.far_points;
    let job = br#"{"settings": {"sampling": {"near_pairs": 2}}}"#;
    let parts: [(&str, &str, &[u8]); 2] = [("file", "", points.as_bytes()), ("job", "", job)];
    let form = form_request("/v1/jobs?dry_run=true&preset=fast", &parts);
    for (request, pairs) in [(raw(points.clone()), 1), (form, 2)] {
        let answer = service.send(request).await.expect(200);
        expect_contract(&answer, "post", "/v1/jobs");
        let dry = answer.json();
        assert_eq!(dry["estimate"]["samples"], 60 * (1 + 2 * pairs) + far);
        assert_eq!(dry["cloud_id"], Value::Null);
    }
    let flat = raw("0 0 0\n1 0 0\n0 1 0\n".repeat(20));
    service
        .send(flat)
        .await
        .expect_problem(422, "cloud_degenerate");
    let unlabelled = Request::post("/v1/jobs?dry_run=1&preset=paper");
    service
        .send(unlabelled.body(points.into()).unwrap())
        .await
        .expect_problem(422, "settings_conflict");
    for list in ["/v1/jobs", "/v1/clouds"] {
        assert_eq!(service.get(list).await.json()["items"], json!([]));
    }
    assert!(service.files("clouds").is_empty());
    service
        .until("tmp is empty", |service| service.files("tmp").is_empty())
        .await;
}

#[tokio::test]
async fn every_fault_of_a_request_is_told_at_its_place() {
    let service = Service::with(&["--worker-memory-mib=300"]).await;
    let cloud = service.upload().await;
    let many: serde_json::Map<String, Value> =
        (0..17).map(|i| (i.to_string(), json!(""))).collect();
    let cases = [
        (json!({}), "request_invalid", vec!["/cloud_id"]),
        (json!([]), "request_invalid", vec![""]),
        (
            json!({"cloud_id": "x", "colour": 1, "preset": "slow"}),
            "request_invalid",
            vec!["/cloud_id", "/preset", "/colour"],
        ),
        (
            json!({"cloud_id": cloud, "settings": 1, "labels": many}),
            "request_invalid",
            vec!["/settings", "/labels"],
        ),
        (
            json!({"cloud_id": cloud, "labels": {"a": "x".repeat(65), "b": 1, "c": "d"}}),
            "request_invalid",
            vec!["/labels/a", "/labels/b"],
        ),
        (
            json!({"cloud_id": format!("cld_{}", "0".repeat(32))}),
            "cloud_missing",
            vec!["/cloud_id"],
        ),
        (
            json!({"cloud_id": cloud, "settings": {"network": {"width": 0}, "surface": {"colour": 1}}}),
            "settings_invalid",
            vec!["/settings/surface/colour", "/settings/network/width"],
        ),
        (
            json!({"cloud_id": cloud, "preset": "paper"}),
            "settings_conflict",
            vec!["/settings/sampling/off_surface"],
        ),
        (
            json!({"cloud_id": cloud, "settings": {"surface": {"resolution": 1000}}}),
            "grid_too_large",
            vec!["/settings/surface/resolution"],
        ),
        (
            json!({"cloud_id": cloud, "settings": {"training": {"max_evaluations": 9, "snapshot_evaluations": [9, 10]}}}),
            "settings_conflict",
            vec!["/settings/training/snapshot_evaluations"],
        ),
    ];
    for (body, code, pointers) in cases {
        let problem = service
            .post_json("/v1/jobs", &body)
            .await
            .expect_problem(422, code);
        let found: Vec<_> = problem["errors"]
            .as_array()
            .unwrap()
            .iter()
            .map(|e| e["pointer"].as_str().unwrap())
            .collect();
        assert_eq!(found, pointers, "{problem}");
    }
    assert_eq!(service.get("/v1/jobs").await.json()["items"], json!([]));
}

#[tokio::test]
async fn what_cannot_be_read_as_a_request_is_told_by_its_part() {
    let service = Service::new().await;
    let cloud = service.upload().await;
    let malformed = Request::post("/v1/jobs")
        .header("content-type", "application/json")
        .body("{".into());
    service
        .send(malformed.unwrap())
        .await
        .expect_problem(400, "malformed_json");
    let long = json!({"labels": {"a": "x".repeat(70_000)}});
    service
        .post_json("/v1/jobs", &long)
        .await
        .expect_problem(413, "body_too_large");
    let query = service.post_json("/v1/jobs?dry_rum=1", &json!({})).await;
    let problem = query.expect_problem(422, "request_invalid");
    let detail = "is unknown; known are: dry_run, preset, source, assume_orientation, keep, ttl; did you mean dry_run?";
    assert_eq!(problem["errors"][0]["detail"], detail);
    let body = sphere_xyz(60, 0.0);
    let broken = [("file", "", body.as_bytes()), ("job", "", b"{".as_slice())];
    let problem = service
        .send(form_request("/v1/jobs", &broken))
        .await
        .expect_problem(400, "malformed_json");
    assert!(
        problem["detail"]
            .as_str()
            .unwrap()
            .starts_with("part job: "),
        "{problem}"
    );
    let both = json!({"cloud_id": cloud}).to_string();
    let both = form_request(
        "/v1/jobs",
        &[("file", "", body.as_bytes()), ("job", "", both.as_bytes())],
    );
    service
        .send(both)
        .await
        .expect_problem(422, "request_invalid");
    assert_eq!(service.get("/v1/jobs").await.json()["items"], json!([]));
}

#[tokio::test]
async fn a_refused_setting_says_what_it_is_and_what_it_may_be() {
    let service = Service::new().await;
    let cloud = service.upload().await;
    let settings = json!({"network": {"width": "wide", "scheme": "highwy"}});
    let problem = service
        .post_json(
            "/v1/jobs",
            &json!({"cloud_id": cloud, "settings": settings}),
        )
        .await
        .expect_problem(422, "settings_invalid");
    assert_eq!(
        problem["errors"],
        json!([
            {
                "pointer": "/settings/network/scheme",
                "detail": "is \"highwy\", must be one of plain, resnet, highway, hw, sqrhw, \
                           gated; \
                           did you mean highway?",
            },
            {
                "pointer": "/settings/network/width",
                "detail": "is \"wide\", must be an integer from 1 to 512",
            },
        ])
    );
}

#[tokio::test]
async fn a_retry_is_a_new_job_with_the_settings_of_the_old_one() {
    let service = Service::new().await;
    let id = service.submit().await;
    let retry = format!("/v1/jobs/{id}/retry");
    service
        .post_json(&retry, &json!({}))
        .await
        .expect_problem(409, "result_not_ready");
    service
        .fail(&service.claim().await, "training_diverged")
        .await;
    let failed = service.get(&format!("/v1/jobs/{id}")).await.json();
    assert_eq!(
        (&failed["error"]["code"], &failed["error"]["status"]),
        (&json!("training_diverged"), &json!(422))
    );

    let change = json!({"settings": {"training": {"learning_rate": 0.5}}});
    let job = service.post_json(&retry, &change).await.expect(202).json();
    assert_eq!(
        (&job["derived_from"], &job["cloud_id"]),
        (&json!(id), &failed["cloud_id"])
    );
    let mut settings = failed["settings"].clone();
    settings["training"]["learning_rate"] = json!(0.5);
    assert_eq!(job["settings"], settings);
    let preset = service
        .post_json(&retry, &json!({"preset": "fast"}))
        .await
        .expect(202)
        .json();
    assert_eq!(preset["settings"]["surface"]["resolution"], 128);
    service
        .post_json(&retry, &json!({"cloud_id": "x"}))
        .await
        .expect_problem(422, "request_invalid");
    let missing = format!("/v1/jobs/job_{}/retry", "0".repeat(32));
    service
        .post_json(&missing, &json!({}))
        .await
        .expect_problem(404, "not_found");
}
