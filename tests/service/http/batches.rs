//! Batches: made whole or not at all.

use axum::body::Body;
use axum::http::Request;
use meshway::identity::Scope;
use serde_json::{Value, json};

use crate::http::contract::expect_contract;
use crate::http::support::{
    Answer, Service, form_request, json_request, sphere_xyz, upload_request,
};
use crate::http::tenants::{Held, configure, finish};
use crate::server::{PATIENCE, until};

/// A form with a sphere for each shift.
pub(super) fn spheres(shifts: &[f64], request: &Value) -> Request<Body> {
    let clouds: Vec<String> = shifts.iter().map(|shift| sphere_xyz(100, *shift)).collect();
    let request = request.to_string();
    let mut parts: Vec<(&str, &str, &[u8])> = vec![("request", "", request.as_bytes())];
    parts.extend(clouds.iter().map(|cloud| ("cloud", "", cloud.as_bytes())));
    form_request("/v1/batches", &parts)
}

pub(super) fn ids(batch: &Value) -> Vec<String> {
    let jobs = batch["jobs"].as_array().unwrap().iter();
    jobs.map(|job| job["id"].as_str().unwrap().to_owned())
        .collect()
}

pub(super) fn own(batch: &Value) -> String {
    batch["links"]["self"].as_str().unwrap().to_owned()
}

pub(super) async fn submit(service: &Service, shifts: &[f64]) -> Value {
    let request = spheres(shifts, &json!({"preset": "fast", "labels": {"study": "x"}}));
    service.send(request).await.expect(202).json()
}

pub(super) async fn show(service: &Service, path: &str) -> Value {
    let answer = service.get(path).await.expect(200);
    expect_contract(&answer, "get", "/v1/batches/{id}");
    answer.json()
}

pub(super) async fn number(service: &Service, list: &str) -> usize {
    let list = service.get(list).await.expect(200).json();
    list["items"].as_array().unwrap().len()
}

#[track_caller]
fn expect_place(answer: Answer, code: &str, place: u64) -> Value {
    expect_contract(&answer, "post", "/v1/batches");
    let problem = answer.expect_problem(422, code);
    assert_eq!(problem["cloud"], place, "{problem}");
    let said = problem["detail"].as_str().unwrap();
    assert!(said.starts_with(&format!("cloud {place}: ")), "{said}");
    problem
}

#[tokio::test]
async fn a_form_with_several_files_makes_a_job_of_each() {
    let service = Service::new().await;
    let request = spheres(
        &[0.0, 5.0],
        &json!({"preset": "fast", "labels": {"study": "x"}, "priority": 2}),
    );
    let answer = service.send(request).await.expect(202);
    expect_contract(&answer, "post", "/v1/batches");
    let batch = answer.json();
    assert_eq!(answer.header("location"), own(&batch));
    assert_eq!(answer.header("retry-after"), "2");
    assert_eq!(batch["status"], "queued");
    assert_eq!(batch["labels"], json!({"study": "x"}));
    assert_eq!(batch["counts"]["queued"], 2);
    let jobs = ids(&batch);
    for (id, job) in jobs.iter().zip(batch["jobs"].as_array().unwrap()) {
        let whole = service.get(job["link"].as_str().unwrap()).await;
        expect_contract(&whole, "get", "/v1/jobs/{id}");
        let whole = whole.expect(200).json();
        assert_eq!(whole["id"], *id);
        assert_eq!(whole["batch_id"], batch["id"]);
        assert_eq!(whole["links"]["batch"], batch["links"]["self"]);
        assert_eq!(whole["preset"], "fast");
        assert_eq!(whole["priority"], 2);
        let cloud = service.get(whole["links"]["cloud"].as_str().unwrap()).await;
        let middle = &cloud.json()["bounds"]["max"][0];
        let shift = if *id == jobs[0] { 1.0 } else { 6.0 };
        assert!((middle.as_f64().unwrap() - shift).abs() < 0.2, "{middle}");
    }
    // Another job is in no batch and not in its list.
    service.submit().await;
    let of_batch = batch["links"]["jobs"].as_str().unwrap();
    assert_eq!(number(&service, of_batch).await, 2);
    assert_eq!(number(&service, "/v1/jobs").await, 3);
    let list = service.get("/v1/batches").await.expect(200);
    expect_contract(&list, "get", "/v1/batches");
    assert_eq!(list.json()["items"][0]["id"], batch["id"]);
    assert!(list.json()["items"][0].get("jobs").is_none());
    finish(&service).await;
    let shown = show(&service, &own(&batch)).await;
    assert_eq!(shown["status"], "running");
    assert_eq!(shown["progress"], 0.5);
    assert_eq!(shown["jobs"][0]["verdict"], "good");
    let claim = service.claim().await;
    service.fail(&claim, "no_surface").await;
    let shown = show(&service, &own(&batch)).await;
    assert_eq!(shown["status"], "ended");
    assert_eq!(shown["progress"], 1.0);
    assert_eq!(shown["jobs"][1]["error"], "no_surface");
    assert_eq!(shown["counts"]["failed"], 1);
}

#[tokio::test]
async fn a_manifest_names_clouds_and_may_wait() {
    let service = Service::new().await;
    let mut clouds = Vec::new();
    for shift in [0.0, 3.0] {
        let cloud = service
            .send(upload_request(sphere_xyz(100, shift)))
            .await
            .expect(201);
        clouds.push(cloud.json()["id"].clone());
    }
    let manifest = json!({"clouds": [clouds[1], clouds[0], clouds[1]], "preset": "fast"});
    let mut request = json_request("/v1/batches", &manifest);
    let wait = "wait=60".parse().unwrap();
    request.headers_mut().insert("prefer", wait);
    let waits = tokio::spawn(service.send(request));
    for _ in 0..3 {
        let queued = async || service.store().oldest_queued().await.unwrap();
        until("a job waits", PATIENCE, queued).await;
        finish(&service).await;
    }
    let answer = waits.await.unwrap().expect(200);
    expect_contract(&answer, "post", "/v1/batches");
    assert_eq!(answer.header("preference-applied"), "wait=60");
    let batch = answer.json();
    assert_eq!(batch["counts"]["succeeded"], 3);
    let of = |job: usize| batch["jobs"][job]["cloud_id"].clone();
    assert_eq!([of(0), of(1)], [clouds[1].clone(), clouds[0].clone()]);
}

#[tokio::test]
async fn one_bad_cloud_refuses_all_by_its_place() {
    let service = Service::new().await;
    let good = sphere_xyz(100, 0.0);
    let form = form_request(
        "/v1/batches",
        &[
            ("cloud", "; filename=\"a.xyz\"", good.as_bytes()),
            ("cloud", "; filename=\"jane_doe.xyz\"", b"1 2 3\n"),
        ],
    );
    let problem = expect_place(service.send(form).await, "cloud_too_few_points", 2);
    assert!(!problem.to_string().contains("jane_doe"), "{problem}");
    let part = json!({"source": "label:all"});
    expect_place(
        service.send(spheres(&[0.0], &part)).await,
        "source_unknown",
        1,
    );
    let here = service.upload().await;
    let nowhere = "cld_00000000000000000000000000000000";
    let manifest = json!({"clouds": [here, nowhere]});
    let answer = service.post_json("/v1/batches", &manifest).await;
    let problem = expect_place(answer, "cloud_missing", 2);
    assert_eq!(problem["errors"][0]["pointer"], "/clouds/1");
    assert_eq!(number(&service, "/v1/jobs").await, 0);
    assert_eq!(number(&service, "/v1/batches").await, 0);
    assert_eq!(number(&service, "/v1/clouds").await, 1);
    assert_eq!(service.files("clouds").len(), 1);
    let spools = |service: &Service| service.files("tmp").is_empty();
    service.until("spooled files are gone", spools).await;
}

#[tokio::test]
async fn requests_that_are_none_are_told_what_is_missing() {
    let service = Service::new().await;
    let cloud = service.upload().await;
    for (body, pointer) in [
        (json!({}), "/clouds"),
        (json!({"clouds": []}), "/clouds"),
        (json!({"clouds": vec![&cloud; 257]}), "/clouds"),
        (json!({"clouds": [cloud], "cloud_id": cloud}), "/cloud_id"),
        (json!({"clouds": [cloud], "source": []}), "/source"),
        (json!({"clouds": [cloud], "source": "label:1,"}), "/source"),
        (json!({"clouds": [cloud], "cluds": 1}), "/cluds"),
    ] {
        let answer = service.post_json("/v1/batches", &body).await;
        expect_contract(&answer, "post", "/v1/batches");
        let problem = answer.expect_problem(422, "request_invalid");
        assert_eq!(problem["errors"][0]["pointer"], pointer, "{problem}");
    }
    let both = spheres(&[0.0], &json!({"clouds": [cloud]}));
    let both = service.send(both).await;
    both.expect_problem(422, "request_invalid");
    let raw = Request::post("/v1/batches").body(Body::from(sphere_xyz(100, 0.0)));
    let raw = service.send(raw.unwrap()).await;
    raw.expect_problem(415, "unsupported_format");
    let empty = form_request("/v1/batches", &[("request", "", b"{}")]);
    let empty = service.send(empty).await;
    empty.expect_problem(400, "malformed_multipart");
    // A job makes one surface; who asks for several is sent here.
    for (path, source) in [
        ("/v1/jobs", json!([{"label": 1}, {"label": 3}])),
        ("/v1/jobs", json!("label:1,3")),
        ("/v1/jobs", json!("label:all")),
        ("/v1/jobs?source=label:1,3", Value::Null),
        ("/v1/jobs?source=label:all", Value::Null),
    ] {
        let body = json!({"cloud_id": cloud, "source": source});
        let problem = service.post_json(path, &body).await;
        let problem = problem.expect_problem(422, "request_invalid");
        assert_eq!(problem["errors"][0]["pointer"], "/source");
        let said = problem["detail"].as_str().unwrap();
        assert!(said.contains("/v1/batches"), "{said}");
    }
}

#[tokio::test]
async fn there_is_room_for_all_jobs_or_none_is_made() {
    let service = Service::with(&["--queue-limit=2"]).await;
    let full = spheres(&[0.0, 1.0, 2.0], &json!({"preset": "fast"}));
    let full = service.send(full).await;
    expect_contract(&full, "post", "/v1/batches");
    full.expect_problem(503, "queue_full");
    assert_eq!(number(&service, "/v1/jobs").await, 0);
    assert_eq!(number(&service, "/v1/batches").await, 0);

    let service = Service::new().await;
    let mut ours = Held::new("radiology", &[Scope::Read, Scope::Write]);
    ours.block += "limits = { queued_jobs = 2 }\n";
    configure(&service, &[&ours]);
    let three = spheres(&[0.0, 1.0, 2.0], &json!({"preset": "fast"}));
    let refused = service.ask(&ours, three).await;
    let problem = refused.expect_problem(429, "quota");
    assert_eq!(problem["violated-policies"], json!(["key-queued-jobs"]));
    let two = spheres(&[0.0, 1.0], &json!({"preset": "fast"}));
    service.ask(&ours, two).await.expect(202);
}
