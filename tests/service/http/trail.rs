//! What the audit trail tells of requests.

use axum::body::Body;
use axum::http::Request;
use serde_json::json;

use crate::http::contract::expect_contract;
use crate::http::support::{Service, sphere_xyz};
use crate::http::tenants::{Held, configure, finish};
use crate::http::walk::{NOWHERE, filled, request};

#[tokio::test]
async fn each_act_leaves_one_row_and_each_read_of_a_surface() {
    let service = Service::new().await;
    let ours = Held::all("radiology");
    configure(&service, &[&ours]);
    let job = service.submit_as(&ours, sphere_xyz(100, 0.0), "fast").await;
    finish(&service).await;
    let (cloud, job) = (
        job["cloud_id"].as_str().unwrap(),
        job["id"].as_str().unwrap(),
    );
    let mut ids = NOWHERE;
    (ids[0].1, ids[1].1) = (cloud, job);
    for (path, header) in [
        ("/v1/jobs/{id}/mesh.ply", ("accept", "*/*")),
        ("/v1/jobs/{id}/mesh.obj", ("range", "bytes=0-3")),
        ("/v1/jobs/{id}/mesh.stl", ("if-none-match", "*")),
        ("/v1/jobs/{id}/snapshots/5.ply", ("accept", "*/*")),
        ("/v1/jobs/{id}/model", ("accept", "*/*")),
        ("/v1/jobs/{id}/report", ("accept", "*/*")),
        ("/v1/clouds/{id}/content", ("accept", "*/*")),
        ("/v1/clouds/{id}/points", ("accept", "*/*")),
        ("/v1/jobs/{id}", ("accept", "*/*")),
    ] {
        let request = Request::get(filled(path, &ids)).header(header.0, header.1);
        let answer = service
            .ask(&ours, request.body(Body::empty()).unwrap())
            .await;
        assert!(answer.status.as_u16() < 400, "{path}: {answer:?}");
    }
    for (method, path) in [
        ("POST", format!("/v1/jobs/{job}/cancel")),
        ("DELETE", format!("/v1/jobs/{job}")),
        ("DELETE", format!("/v1/clouds/{cloud}")),
    ] {
        let answer = service.ask(&ours, request(method, &path)).await;
        assert!(answer.status.is_success(), "{path}: {answer:?}");
    }
    service.get("/v1/jobs").await.expect(401);
    let rows = service.store().audit_after(0, 100).await.unwrap();
    let told: Vec<_> = rows
        .iter()
        .map(|row| (row.event.as_str(), row.object.as_str()))
        .collect();
    let expected = [
        ("cloud.create", cloud),
        ("job.create", job),
        ("mesh.read", job),
        ("mesh.read", job),
        ("mesh.read", job),
        ("model.read", job),
        ("cloud.read", cloud),
        ("cloud.read", cloud),
        ("job.cancel", job),
        ("job.delete", job),
        ("cloud.delete", cloud),
        ("auth.fail", "GET /v1/jobs"),
    ];
    assert_eq!(told, expected);
    assert_eq!(
        rows[0].key.as_deref(),
        Some(ours.secret.hash().id().as_str())
    );
    let head = service.store().audit_verify(&[]).await.unwrap().unwrap();
    assert_eq!(head.seq, 12);
    let page = service.fetch(&ours, "/v1/audit?limit=2").await.expect(200);
    expect_contract(&page, "get", "/v1/audit");
    let items = &page.json()["items"];
    assert_eq!(
        (&items[0]["event"], &items[1]["event"]),
        (&json!("audit.read"), &json!("cloud.delete"))
    );
    let cursor = page.json()["next_cursor"].as_str().unwrap().to_owned();
    let next = service
        .fetch(&ours, &format!("/v1/audit?limit=2&cursor={cursor}"))
        .await;
    assert_eq!(next.expect(200).json()["items"][0]["event"], "job.delete");
}
