//! What a job would cost, held against the memory of a worker.

use serde_json::{Value, json};

use crate::http::support::Service;

#[tokio::test]
async fn what_no_worker_has_room_for_is_refused_with_what_fits() {
    let service = Service::with(&["--worker-memory-mib=288"]).await;
    let ask = async |settings: Value| {
        let body = json!({"preset": "fast", "settings": settings});
        service.post_json("/v1/jobs?dry_run=true", &body).await
    };
    ask(json!({})).await.expect(200);
    let grid = ask(json!({"surface": {"resolution": 300}})).await;
    let problem = grid.expect_problem(422, "grid_too_large");
    let detail = problem["detail"].as_str().unwrap();
    assert!(detail.contains("66 MiB of the 32 MiB"), "{detail}");
    let largest = json!({"surface": {"resolution": problem["largest"]}});
    ask(largest).await.expect(200);
    let wide = json!({"network": {"width": 256}, "training": {"history": 400}});
    let training = ask(wide.clone()).await;
    let problem = training.expect_problem(422, "training_too_large");
    assert!(problem["memory_bytes"].as_u64() > problem["limit_bytes"].as_u64());
    assert!(
        problem["detail"]
            .as_str()
            .unwrap()
            .contains("lower training.history"),
        "{problem}"
    );
    assert_eq!(
        problem["errors"][0]["pointer"],
        "/settings/training/history"
    );
    let network = json!({"width": 512, "hidden_layers": 32});
    let deep = json!({"network": network, "training": {"optimizer": "adam"}});
    let problem = ask(deep).await.expect_problem(422, "training_too_large");
    assert_eq!(problem["errors"][0]["pointer"], "/settings/network/width");

    let cloud = service.upload().await;
    let job = json!({"cloud_id": cloud, "preset": "fast", "settings": wide});
    let refused = service.post_json("/v1/jobs", &job).await;
    refused.expect_problem(422, "training_too_large");
}
