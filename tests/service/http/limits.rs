//! What tenants and keys may take.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use axum::body::Body;
use axum::http::Request;
use meshway::identity::{Keyring, Scope};
use meshway::jobs::{Options, Store};
use serde_json::{Value, json};

use crate::http::contract::expect_contract;
use crate::http::support::{Answer, Service, sphere_xyz};
use crate::http::tenants::{Held, finish};

const DAY_MS: i64 = 86_400_000;

fn configure(service: &Service, keys: &[&Held], more: &str) {
    let blocks: Vec<_> = keys.iter().map(|key| key.block.as_str()).collect();
    let keyring = Keyring::of_file(&(blocks.concat() + more)).unwrap();
    service.app.config.keys.replace(&keyring).unwrap();
}

fn of_tenant(limits: &str) -> String {
    format!("[[tenants]]\nname = \"radiology\"\nlimits = {{ {limits} }}\n")
}

fn submit(shift: f64) -> Request<Body> {
    let request = Request::post("/v1/jobs?preset=fast");
    request.body(Body::from(sphere_xyz(100, shift))).unwrap()
}

/// A service whose clock stands until it is moved.
async fn standing(now: i64) -> (Service, Arc<AtomicI64>) {
    let clock = Arc::new(AtomicI64::new(now));
    let seen = Arc::clone(&clock);
    let options = Options {
        clock: Some(Arc::new(move || seen.load(Ordering::SeqCst))),
        ..Options::default()
    };
    (Service::over(&[], options).await, clock)
}

#[track_caller]
fn expect_quota(answer: Answer, policy: &str) -> Value {
    let said = answer.header("ratelimit").to_owned();
    assert!(said.starts_with(&format!("\"{policy}\";r=0")), "{said}");
    assert!(answer.header("ratelimit-policy").contains(policy));
    expect_contract(&answer, "post", "/v1/jobs");
    let problem = answer.expect_problem(429, "quota");
    assert_eq!(problem["violated-policies"], json!([policy]));
    problem
}

#[tokio::test]
async fn requests_of_a_minute_are_counted_for_key_and_tenant() {
    let (service, clock) = standing(1_000_000).await;
    let mut ours = Held::new("radiology", &[Scope::Read]);
    ours.block += "limits = { requests_per_minute = 2 }\n";
    let other = Held::new("radiology", &[Scope::Read]);
    configure(
        &service,
        &[&ours, &other],
        &of_tenant("requests_per_minute = 4"),
    );
    for left in [1, 0] {
        let answer = service.fetch(&ours, "/v1/jobs").await.expect(200);
        let said = format!(
            "\"tenant-requests\";r={};t=60, \"key-requests\";r={left};t=60",
            left + 2
        );
        assert_eq!(answer.header("ratelimit"), said);
        let policies = "\"tenant-requests\";q=4;w=60, \"key-requests\";q=2;w=60";
        assert_eq!(answer.header("ratelimit-policy"), policies);
    }
    clock.store(1_020_000, Ordering::SeqCst);
    let refused = service.fetch(&ours, "/v1/jobs").await;
    assert_eq!(refused.header("retry-after"), "40");
    let problem = refused.expect_problem(429, "rate_limited");
    assert_eq!(problem["violated-policies"], json!(["key-requests"]));
    // The refused one counted for the tenant, too.
    service.fetch(&other, "/v1/jobs").await.expect(200);
    let problem = service.fetch(&other, "/v1/jobs").await;
    let problem = problem.expect_problem(429, "rate_limited");
    assert_eq!(problem["violated-policies"], json!(["tenant-requests"]));
    clock.store(1_060_000, Ordering::SeqCst);
    service.fetch(&ours, "/v1/jobs").await.expect(200);
    // Nothing is said where nothing is limited.
    configure(&service, &[&other], "");
    let answer = service.fetch(&other, "/v1/jobs").await.expect(200);
    assert!(!answer.headers.contains_key("ratelimit"));
}

#[tokio::test]
async fn waiting_jobs_are_limited_for_key_and_tenant_and_a_new_file_counts_at_once() {
    let service = Service::new().await;
    let mut ours = Held::all("radiology");
    ours.block += "limits = { queued_jobs = 1 }\n";
    let (other, theirs) = (Held::all("radiology"), Held::all("surgery"));
    configure(
        &service,
        &[&ours, &other, &theirs],
        &of_tenant("queued_jobs = 2"),
    );
    service.ask(&ours, submit(0.0)).await.expect(202);
    expect_quota(service.ask(&ours, submit(0.0)).await, "key-queued-jobs");
    service.ask(&other, submit(0.0)).await.expect(202);
    expect_quota(service.ask(&other, submit(0.0)).await, "tenant-queued-jobs");
    service.ask(&theirs, submit(0.0)).await.expect(202);
    let counts = service.store().counts().await.unwrap();
    assert_eq!(counts.get(meshway::jobs::Status::Queued), 3);
    configure(
        &service,
        &[&ours, &other, &theirs],
        &of_tenant("queued_jobs = 3"),
    );
    service.ask(&other, submit(0.0)).await.expect(202);
    service.claim().await;
    service.claim().await;
    service.ask(&ours, submit(0.0)).await.expect(202);
}

#[tokio::test]
async fn stored_bytes_are_those_of_clouds_and_results_and_a_refused_upload_leaves_nothing() {
    let service = Service::new().await;
    let ours = Held::all("radiology");
    configure(&service, &[&ours], &of_tenant("stored_mib = 0"));
    let upload = || Request::post("/v1/clouds").body(Body::from(sphere_xyz(100, 0.0)));
    let refused = service.ask(&ours, upload().unwrap()).await;
    let problem = refused.expect_problem(429, "quota");
    assert_eq!(problem["violated-policies"], json!(["tenant-stored-bytes"]));
    assert!(service.files("clouds").is_empty() && service.files("tmp").is_empty());
    configure(&service, &[&ours], &of_tenant("stored_mib = 1"));
    let cloud = service
        .ask(&ours, upload().unwrap())
        .await
        .expect(201)
        .json();
    let submit = || {
        let body = json!({"cloud_id": cloud["id"], "preset": "fast"}).to_string();
        let request = Request::post("/v1/jobs").header("content-type", "application/json");
        request.body(Body::from(body)).unwrap()
    };
    let job = service.ask(&ours, submit()).await.expect(202).json();
    finish(&service).await;
    // What is there may be had again, and nothing is lost.
    configure(&service, &[&ours], &of_tenant("stored_mib = 0"));
    service.ask(&ours, upload().unwrap()).await.expect(200);
    expect_quota(service.ask(&ours, submit()).await, "tenant-stored-bytes");
    let mesh = format!("/v1/jobs/{}/mesh.ply", job["id"].as_str().unwrap());
    service.fetch(&ours, &mesh).await.expect(200);
}

#[tokio::test]
async fn seconds_of_workers_are_counted_by_days_and_over_restarts_and_erasures() {
    let noon = 20_000 * DAY_MS + DAY_MS / 2;
    let (service, clock) = standing(noon).await;
    let mut ours = Held::all("radiology");
    ours.block += "limits = { compute_seconds_per_day = 5 }\n";
    configure(&service, &[&ours], "");
    let job = service.ask(&ours, submit(0.0)).await.expect(202).json();
    let claim = service.claim().await;
    clock.fetch_add(6_000, Ordering::SeqCst);
    service.fail(&claim, "no_surface").await;
    let erase = format!("/v1/jobs/{}", job["id"].as_str().unwrap());
    let erase = Request::delete(erase).body(Body::empty()).unwrap();
    service.ask(&ours, erase).await.expect(204);
    let refused = service.ask(&ours, submit(0.0)).await;
    assert_eq!(
        refused.header("retry-after"),
        (12 * 3_600 - 6 + 1).to_string()
    );
    expect_quota(refused, "key-compute-seconds");
    // Another process reads the same.
    let seen = Arc::clone(&clock);
    let options = Options {
        clock: Some(Arc::new(move || seen.load(Ordering::SeqCst))),
        ..Options::default()
    };
    let again = Store::open(service.dir.path(), options).await.unwrap();
    let keys = &service.app.config.keys;
    let caller = keys.identify(&ours.secret, None, 0).unwrap();
    let cloud = again.of(&caller.tenant).list_clouds(None, 1).await.unwrap();
    let new = meshway::jobs::NewJob {
        cloud_id: cloud[0].id.clone(),
        preset: meshway::reconstruction::Preset::Fast,
        settings: meshway::reconstruction::Preset::Fast.settings(),
        labels: std::collections::BTreeMap::new(),
        source: None,
        derived_from: None,
        priority: 0,
        cost_seconds: 1.0,
        keep: meshway::jobs::Keep::default(),
    };
    let refused = again.by(&caller).submit(new, None).await.unwrap_err();
    assert_eq!(refused.code(), "quota");
    clock.fetch_add(DAY_MS / 2, Ordering::SeqCst);
    service.ask(&ours, submit(0.0)).await.expect(202);
}
