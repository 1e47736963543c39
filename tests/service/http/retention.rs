//! How long clouds and jobs are kept, what holds them, and what is left of them.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use axum::body::Body;
use axum::http::Request;
use meshway::http::sweep;
use meshway::jobs::Options;
use serde_json::{Value, json};

use crate::erasure::holds;
use crate::http::contract::expect_contract;
use crate::http::support::{
    Answer, Service, json_request, sphere_xyz, tetrahedron, upload_request,
};
use crate::http::tenants::finish;
use crate::server::{PATIENCE, until};

const DAY_MS: i64 = 86_400_000;

/// A service whose time is in the hands of the test.
pub(crate) struct Timed {
    pub(crate) service: Service,
    now: Arc<AtomicI64>,
}

impl Timed {
    pub(crate) async fn with(flags: &[&str]) -> Self {
        let now = Arc::new(AtomicI64::new(1_000_000_000_000));
        let clock = Arc::clone(&now);
        let options = Options {
            clock: Some(Arc::new(move || clock.load(Ordering::Relaxed))),
            ..Options::default()
        };
        let service = Service::over(flags, options).await;
        Self { service, now }
    }

    /// Lets time pass, and what is due go.
    async fn pass(&self, ms: i64) {
        self.now.fetch_add(ms, Ordering::Relaxed);
        sweep(&self.service.app).await.unwrap();
    }

    pub(crate) async fn submit(&self, body: Value) -> String {
        let answer = self.service.post_json("/v1/jobs", &body).await;
        let id = answer.expect(202).json()["id"].as_str().unwrap().to_owned();
        format!("/v1/jobs/{id}")
    }

    /// A job of a cloud of its own that has ended.
    pub(crate) async fn ended(&self, shift: f64, more: Value) -> String {
        let cloud = self.cloud(shift, "").await;
        let mut body = more;
        body["cloud_id"] = cloud["id"].clone();
        let job = self.submit(body).await;
        finish(&self.service).await;
        job
    }

    async fn cloud(&self, shift: f64, query: &str) -> Value {
        let path = format!("/v1/clouds{query}");
        let request = Request::post(path).body(sphere_xyz(100, shift).into());
        let answer = self.service.send(request.unwrap()).await;
        assert!(answer.status.is_success(), "{answer:?}");
        answer.json()
    }

    pub(crate) async fn patch(&self, path: &str, body: Value) -> Answer {
        let mut request = json_request(path, &body);
        *request.method_mut() = axum::http::Method::PATCH;
        self.service.send(request).await
    }

    pub(crate) async fn show(&self, path: &str) -> Value {
        self.service.get(path).await.expect(200).json()
    }

    pub(crate) async fn expect_gone(&self, path: &str, reason: &str) {
        let gone = self.service.get(path).await.expect_problem(410, "gone");
        assert_eq!(gone["reason"], reason, "{path}");
    }
}

fn own(cloud: &Value) -> &str {
    cloud["links"]["self"].as_str().unwrap()
}

#[tokio::test]
async fn clouds_and_jobs_go_when_their_time_is_over_and_leave_nothing() {
    let timed = Timed::with(&["--cloud-ttl=2d", "--job-ttl=3d"]).await;
    let service = &timed.service;
    let limits = timed.show("/v1/limits").await;
    assert_eq!(
        (&limits["cloud_ttl"], &limits["job_ttl"]),
        (&json!("2d"), &json!("3d"))
    );
    let label = json!({"labels": {"patient": "a-name-of-somebody"}});
    let job = timed.ended(0.5, label).await;
    let shown = timed.show(&job).await;
    assert_eq!(shown["ttl"], "3d");
    assert_eq!(shown["expires_at"], "2001-09-12T01:46:40.000Z");
    let listed = service.get("/v1/jobs").await;
    expect_contract(&listed, "get", "/v1/jobs");
    assert_eq!(listed.json()["items"][0]["expires_at"], shown["expires_at"]);
    let cloud = shown["links"]["cloud"].as_str().unwrap().to_owned();
    let listed = service.get("/v1/clouds").await;
    expect_contract(&listed, "get", "/v1/clouds");
    assert_eq!(
        listed.json()["items"][0]["expires_at"],
        "2001-09-11T01:46:40.000Z"
    );
    let mesh = service
        .get(&format!("{job}/mesh.obj"))
        .await
        .expect(200)
        .body;
    let folder = service.dir.path();
    let marks = [
        b"a-name-of-somebody".to_vec(),
        mesh[mesh.len() - 60..].to_vec(),
        tetrahedron()[100..160].to_vec(),
        sphere_xyz(100, 0.5).into_bytes()[500..600].to_vec(),
    ];
    for mark in &marks {
        assert!(holds(folder, mark));
    }
    timed.pass(2 * DAY_MS - 1).await;
    timed.show(&cloud).await;
    timed.pass(1).await;
    timed.expect_gone(&cloud, "expired").await;
    assert!(service.files("clouds").is_empty());
    assert!(timed.show(&job).await["links"].get("cloud").is_none());
    timed.pass(DAY_MS).await;
    timed.expect_gone(&job, "expired").await;
    timed
        .expect_gone(&format!("{job}/mesh.obj"), "expired")
        .await;
    for mark in &marks {
        until("nothing is left", PATIENCE, async || {
            (!holds(folder, mark)).then_some(())
        })
        .await;
    }
    // Whoever has no keys has this in the trail all the same.
    let trail = service.store().audit_after(0, 10).await.unwrap();
    let told: Vec<_> = trail
        .iter()
        .map(|row| {
            (
                row.event.as_str(),
                row.actor.as_deref(),
                row.object.as_str(),
            )
        })
        .collect();
    let id = |path: &str| path.rsplit('/').next().unwrap().to_owned();
    let (cloud, job) = (id(&cloud), id(&job));
    assert_eq!(
        told,
        [
            ("cloud.delete", Some("meshway"), cloud.as_str()),
            ("job.delete", Some("meshway"), job.as_str()),
        ]
    );
}

#[tokio::test]
async fn a_request_may_ask_for_another_time() {
    let timed = Timed::with(&["--cloud-ttl=2d", "--job-ttl=3d"]).await;
    let kept = timed.cloud(1.0, "?ttl=never").await;
    assert_eq!(kept["expires_at"], Value::Null);
    let short = timed.cloud(2.0, "?ttl=1h").await;
    assert_eq!(short["expires_at"], "2001-09-09T02:46:40.000Z");
    // The same bytes again: the longer time wins.
    let again = timed.cloud(2.0, "").await;
    assert_eq!(
        (&again["id"], again["expires_at"].as_str()),
        (&short["id"], Some("2001-09-11T01:46:40.000Z"))
    );
    let again = timed.cloud(2.0, "?ttl=1h").await;
    assert_eq!(again["expires_at"], "2001-09-11T01:46:40.000Z");
    let job = timed
        .submit(json!({"cloud_id": short["id"], "ttl": "10m"}))
        .await;
    assert_eq!(timed.show(&job).await["expires_at"], Value::Null);
    // A cloud whose time is over stays while a job needs it.
    timed.pass(5 * DAY_MS).await;
    timed.show(own(&short)).await;
    finish(&timed.service).await;
    let retry = timed
        .service
        .post_json(&format!("{job}/retry"), &json!({}))
        .await;
    assert_eq!(retry.expect(202).json()["ttl"], "10m");
    finish(&timed.service).await;
    timed.pass(599_999).await;
    timed.expect_gone(own(&short), "expired").await;
    timed.show(&job).await;
    timed.pass(1).await;
    timed.expect_gone(&job, "expired").await;
    timed.pass(400 * DAY_MS).await;
    timed.show(own(&kept)).await;
    for (query, what) in [
        ("?ttl=soon", "/v1/clouds"),
        ("?ttl=download", "/v1/clouds"),
        ("?ttl=0d", "/v1/jobs"),
    ] {
        let request = Request::post(format!("{what}{query}")).body(Body::from("1"));
        let problem = timed.service.send(request.unwrap()).await;
        let problem = problem.expect_problem(422, "request_invalid");
        assert_eq!(problem["errors"][0]["pointer"], "/ttl");
    }
}

#[tokio::test]
async fn what_is_held_is_not_erased() {
    let timed = Timed::with(&["--cloud-ttl=1d", "--job-ttl=1d"]).await;
    let job = timed.ended(0.0, json!({})).await;
    let cloud = timed.show(&job).await["links"]["cloud"]
        .as_str()
        .unwrap()
        .to_owned();
    for path in [&job, &cloud] {
        let held = timed.patch(path, json!({"hold": true})).await;
        let route = if *path == job {
            "/v1/jobs/{id}"
        } else {
            "/v1/clouds/{id}"
        };
        expect_contract(&held, "patch", route);
        assert_eq!(held.expect(200).json()["hold"], true);
    }
    timed.pass(9 * DAY_MS).await;
    for path in [&job, &cloud] {
        timed.show(path).await;
        timed.service.delete(path).await.expect_problem(409, "held");
    }
    // Kept for another time, of which the hold is forgotten first.
    let lifted = timed.patch(&job, json!({"hold": false, "ttl": "2d"})).await;
    assert_eq!(
        lifted.expect(200).json()["expires_at"],
        "2001-09-20T01:46:40.000Z"
    );
    timed
        .patch(&cloud, json!({"ttl": "never"}))
        .await
        .expect(200);
    timed
        .patch(&cloud, json!({"hold": false}))
        .await
        .expect(200);
    timed.pass(2 * DAY_MS).await;
    timed.expect_gone(&job, "expired").await;
    timed.show(&cloud).await;
    timed.service.delete(&cloud).await.expect(204);
    timed.expect_gone(&cloud, "deleted").await;
    for (path, body) in [
        (&job, json!({"hold": true})),
        (&cloud, json!({"hold": true})),
    ] {
        timed.patch(path, body).await.expect_problem(410, "gone");
    }
    let other = timed.cloud(1.0, "").await;
    for wrong in [
        json!({}),
        json!({"hold": 1}),
        json!({"ttl": "download"}),
        json!({"held": true}),
    ] {
        timed
            .patch(own(&other), wrong)
            .await
            .expect_problem(422, "request_invalid");
    }
}

#[tokio::test]
async fn a_job_that_is_held_holds_its_cloud() {
    let timed = Timed::with(&["--cloud-ttl=1d"]).await;
    let job = timed.ended(0.0, json!({})).await;
    let cloud = timed.show(&job).await["links"]["cloud"].clone();
    let cloud = cloud.as_str().unwrap();
    timed.patch(&job, json!({"hold": true})).await.expect(200);
    let refused = timed.service.delete(cloud).await;
    expect_contract(&refused, "delete", "/v1/clouds/{id}");
    refused.expect_problem(409, "held");
    timed.pass(2 * DAY_MS).await;
    timed.show(cloud).await;
    timed.patch(&job, json!({"hold": false})).await.expect(200);
    timed.pass(1).await;
    timed.expect_gone(cloud, "expired").await;
}

#[tokio::test]
async fn a_job_goes_once_its_mesh_was_fetched_whole() {
    let timed = Timed::with(&[]).await;
    let job = timed.ended(0.0, json!({"ttl": "download"})).await;
    assert_eq!(timed.show(&job).await["ttl"], "download");
    let mesh = format!("{job}/mesh.ply");
    let part = Request::get(&mesh)
        .header("range", "bytes=0-")
        .body(Body::empty());
    timed.service.send(part.unwrap()).await.expect(206);
    let head = Request::head(&mesh).body(Body::empty());
    timed.service.send(head.unwrap()).await.expect(200);
    timed
        .service
        .get(&format!("{job}/snapshots/5.ply"))
        .await
        .expect(200);
    timed.pass(90 * DAY_MS).await;
    assert_eq!(timed.show(&job).await["expires_at"], Value::Null);
    timed.service.get(&mesh).await.expect(200);
    until("the download is noted", PATIENCE, async || {
        timed.show(&job).await["expires_at"]
            .is_string()
            .then_some(())
    })
    .await;
    // For a while, in case the last bytes were lost on the way.
    timed.pass(59_000).await;
    timed.service.get(&mesh).await.expect(200);
    timed.pass(1_000).await;
    timed.expect_gone(&job, "expired").await;
    // The mesh as the answer to the submission counts as well.
    let (service, now) = (&timed.service, &timed.now);
    let request = Request::post("/v1/jobs?ttl=download")
        .header("prefer", "wait=30")
        .header("accept", "model/obj")
        .body(sphere_xyz(100, 3.0).into())
        .unwrap();
    let (answer, _) = tokio::join!(service.send(request), async {
        until("the job waits", PATIENCE, async || {
            service.store().oldest_queued().await.unwrap()
        })
        .await;
        finish(service).await
    });
    let location = answer.expect(200).header("location").to_owned();
    until("the download is noted", PATIENCE, async || {
        timed.show(&location).await["expires_at"]
            .is_string()
            .then_some(())
    })
    .await;
    now.fetch_add(60_000, Ordering::Relaxed);
    timed.pass(0).await;
    timed.expect_gone(&location, "expired").await;
}

#[tokio::test]
async fn what_was_there_before_stays() {
    let timed = Timed::with(&[]).await;
    let cloud = timed
        .service
        .send(upload_request(sphere_xyz(100, 0.0)))
        .await;
    let cloud = cloud.expect(201).json();
    timed.pass(36_500 * DAY_MS).await;
    let shown = timed.show(own(&cloud)).await;
    assert_eq!(
        (&shown["expires_at"], &shown["hold"]),
        (&Value::Null, &json!(false))
    );
}
