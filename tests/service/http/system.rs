//! The service about itself: presets, limits, health, metrics, pages.

use meshway::jobs::{NewEvent, Record, Workers};
use meshway::reconstruction::Phase;

use crate::http::contract::expect_contract;
use crate::http::support::Service;
use crate::server::{PATIENCE, until};
use crate::store::support::success;

const BUSY: Workers = Workers {
    busy: 1,
    idle: 2,
    starting: 0,
    restarts: 5,
};

#[tokio::test]
async fn what_may_be_asked_for_is_told() {
    let service = Service::new().await;
    for path in ["/v1/presets", "/v1/limits", "/v1/version", "/livez"] {
        let answer = service.get(path).await.expect(200);
        expect_contract(&answer, "get", path);
    }
    let limits = service.get("/v1/limits").await.json();
    assert_eq!(limits["points"], 5_000_000);
    assert_eq!(limits["header_bytes"], 65_536);
    assert_eq!(limits["settings_bytes"], 65_536);
    assert_eq!(limits["decompression_ratio"], 100);
    assert_eq!(limits["wait_seconds"], 60);
    assert_eq!(limits["least_points"], 16);
    assert_eq!(limits["upload_bytes_per_second"], 1_024);
    assert_eq!(limits["event_streams_per_client"], 500);
    // What the worker may use less what it needs besides.
    let grid = limits["grid_bytes"].as_u64().unwrap();
    assert!(grid < limits["worker_memory_bytes"].as_u64().unwrap() && grid > 1 << 30);
    assert_eq!(limits["settings"]["/surface/resolution"]["maximum"], 1024.0);
    let presets = service.get("/v1/presets").await.json();
    assert_eq!(presets["items"][0]["name"], "balanced");
    assert_eq!(presets["items"][0]["default"], true);
    let problem = service.get("/v1/presets?x=1").await;
    problem.expect_problem(422, "request_invalid");
}

#[tokio::test]
async fn ready_says_what_is_missing() {
    let service = Service::new().await;
    let answer = service.get("/readyz").await;
    expect_contract(&answer, "get", "/readyz");
    let problem = answer.expect_problem(503, "not_ready");
    assert_eq!(problem["checks"]["workers"]["ok"], false);
    assert_eq!(problem["checks"]["database"]["ok"], true);
    service.workers.send_replace(BUSY);
    let answer = service.get("/readyz").await.expect(200);
    expect_contract(&answer, "get", "/readyz");
    service.app.shutdown.cancel();
    let problem = service
        .get("/readyz")
        .await
        .expect_problem(503, "not_ready");
    assert_eq!(problem["checks"]["not_draining"]["ok"], false);
    service.get("/livez").await.expect(200);
}

#[tokio::test]
async fn a_disk_below_its_reserve_is_not_ready() {
    // More than any disk has.
    let service = Service::with(&["--disk-reserve-mib=1000000000000"]).await;
    service.workers.send_replace(BUSY);
    let problem = service
        .get("/readyz")
        .await
        .expect_problem(503, "not_ready");
    assert_eq!(problem["checks"]["disk"]["ok"], false);
    assert_eq!(problem["checks"]["workers"]["ok"], true);
}

#[tokio::test]
async fn prometheus_gets_every_name_and_no_job() {
    let service = Service::new().await;
    service.workers.send_replace(BUSY);
    let id = service.submit().await;
    let claim = service.claim().await;
    let record = Record {
        loss: Some(0.25),
        evaluations: Some(12),
        events: vec![
            NewEvent::Phase {
                phase: Phase::Training,
            },
            NewEvent::Phase {
                phase: Phase::Surface,
            },
        ],
        ..Record::default()
    };
    service.store().record(&claim, record).await.unwrap();
    let text = scrape(&service).await;
    assert!(
        text.contains("meshway_training_loss{slot=\"0\"} 0.25"),
        "{text}"
    );
    service.store().succeed(&claim, success()).await.unwrap();
    service.submit().await;
    // Counters follow the events, a moment later.
    let text = until("the end is counted", PATIENCE, async || {
        let text = scrape(&service).await;
        let line = "meshway_jobs_finished_total{status=\"succeeded\",code=\"\"} 1";
        text.contains(line).then_some(text)
    });
    let text = text.await;
    for line in [
        "meshway_build_info{version=",
        "meshway_http_requests_total{method=\"POST\",route=\"/v1/jobs\",status=\"202\"} 2",
        "meshway_http_request_duration_seconds_bucket{",
        "meshway_jobs{status=\"queued\"} 1",
        "meshway_jobs{status=\"succeeded\"} 1",
        "meshway_jobs_finished_total{status=\"succeeded\",code=\"\"} 1",
        "meshway_job_queue_wait_seconds_count 1",
        "meshway_job_phase_seconds_count{phase=\"training\"} 1",
        "meshway_job_attempts_total{reason=\"first\"} 1",
        "meshway_queue_oldest_age_seconds ",
        "meshway_workers{state=\"idle\"} 2",
        "meshway_worker_restarts_total 5",
        "meshway_training_evaluations_total{scheme=\"sqrhw\",engine=\"auto\"} ",
        "meshway_mesh_triangles_count 1",
        "meshway_storage_bytes{kind=\"database\"} ",
        "meshway_storage_free_bytes ",
        "meshway_sse_streams 0",
        "meshway_database_busy_total 0",
        "meshway_job_attempts_total{reason=\"lease_expired\"} 0",
        "meshway_jobs_finished_total{status=\"failed\",code=\"out_of_memory\"} 0",
        "process_cpu_seconds_total ",
        "process_resident_memory_bytes ",
        "process_virtual_memory_bytes ",
        "process_open_fds ",
        "process_max_fds ",
        "process_start_time_seconds ",
        "# EOF",
    ] {
        assert!(text.contains(line), "{line} is missing in\n{text}");
    }
    assert!(!text.contains(&id) && !text.contains("job_0"), "{text}");
}

async fn scrape(service: &Service) -> String {
    let answer = service.get("/metrics").await.expect(200);
    expect_contract(&answer, "get", "/metrics");
    String::from_utf8(answer.body).unwrap()
}

#[tokio::test]
async fn pages_stand_alone() {
    let service = Service::new().await;
    for path in ["/", "/docs"] {
        let answer = service.get(path).await.expect(200);
        expect_contract(&answer, "get", path);
        assert!(
            answer
                .header("content-security-policy")
                .contains("default-src 'none'")
        );
        let html = String::from_utf8(answer.body).unwrap();
        assert!(html.starts_with("<!doctype html>"));
        // The dashboard, where there is one, loads files of its own: see `http_web`.
        let own = html
            .replace("src=\"/assets/", "")
            .replace("<script type=\"module\"", "");
        for foreign in ["http://", "https://", "<script", "src="] {
            assert!(!own.contains(foreign), "{path} has {foreign}");
        }
    }
    let docs = String::from_utf8(service.get("/docs").await.body).unwrap();
    for (method, path, _) in meshway::http::operations() {
        assert!(docs.contains(path), "{method} {path} is not on the page");
    }
    let contract = service.get("/openapi.yaml").await.expect(200);
    assert_eq!(contract.body, meshway::http::OPENAPI.as_bytes());
}
