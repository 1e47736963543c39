//! Results: meshes in every format, snapshots, reports, models, fields, series.

use axum::body::Body;
use axum::http::Request;
use meshway::jobs::{Claim, NewMesh, Record, Success};
use meshway::reconstruction::Model;
use meshway::reconstruction::mesh::read;
use meshway::reconstruction::network::Ensemble;
use meshway::reconstruction::sampling::Frame;
use meshway::reconstruction::settings::Preset;
use meshway::reconstruction::training::{GradientHistogram, LayerHistogram, Metrics};
use serde_json::json;
use sha2::{Digest, Sha256};

use crate::http::contract::expect_contract;
use crate::http::support::{Answer, Service, tetrahedron};

fn mesh() -> NewMesh {
    NewMesh::new(4, 4, tetrahedron())
}

fn model() -> Model {
    let settings = Preset::Fast.settings();
    let ensemble = Ensemble::new(&settings.network, true);
    let parameters = ensemble.initial_parameters::<f32>(1);
    Model {
        parameters: parameters.into_iter().map(f64::from).collect(),
        settings,
        ensemble,
        frame: Frame {
            centre: [1.0, 2.0, 3.0],
            scale: 0.5,
        },
        blocks: None,
    }
}

fn row(evaluation: u64, loss: f64) -> Metrics {
    Metrics {
        iteration: evaluation,
        evaluation,
        loss,
        validation_loss: None,
        gradient_norm: 0.1,
        step_length: 1.0,
        weight_norms: vec![1.0, 2.0],
        blocks: None,
    }
}

/// A job that has ended well; its id.
async fn succeeded(service: &Service) -> String {
    let id = service.submit().await;
    let claim = service.claim().await;
    succeed(service, &claim).await;
    id
}

async fn succeed(service: &Service, claim: &Claim) {
    let success = Success {
        mesh: mesh(),
        report: json!({"mesh": {"closed": true}}),
        model: model().encode().unwrap(),
        last: Record::default(),
    };
    service.store().succeed(claim, success).await.unwrap();
}

async fn get_with(service: &Service, path: &str, headers: &[(&str, &str)]) -> Answer {
    let request = headers
        .iter()
        .fold(Request::get(path), |request, (name, value)| {
            request.header(*name, *value)
        });
    service.send(request.body(Body::empty()).unwrap()).await
}

#[tokio::test]
async fn a_mesh_is_the_same_in_every_format() {
    let service = Service::new().await;
    let id = succeeded(&service).await;
    for (ending, media_type) in [
        ("ply", "application/x-ply"),
        ("obj", "model/obj"),
        ("stl", "model/stl"),
        ("off", "application/x-off"),
        ("glb", "model/gltf-binary"),
    ] {
        let path = format!("/v1/jobs/{id}/mesh.{ending}");
        let answer = service.get(&path).await.expect(200);
        expect_contract(&answer, "get", "/v1/jobs/{id}/mesh.{format}");
        assert_eq!(answer.header("content-type"), media_type);
        let hash = hex::encode(Sha256::digest(&answer.body));
        assert_eq!(answer.header("etag"), format!("\"{hash}\""));
        assert_eq!(
            answer.header("content-disposition"),
            format!("attachment; filename=\"{id}.{ending}\"")
        );
        let name = format!("mesh.{ending}");
        let mesh = read::read(&answer.body, Some(&name)).unwrap();
        assert_eq!(mesh.triangles.len(), 4, "{ending}");
        let distances: &[f64] = if ending == "ply" {
            &[0.5, 0.0, 0.25, 2.0]
        } else {
            &[]
        };
        assert_eq!(mesh.distance_to_points, distances, "{ending}");
        let accept = [("accept", media_type)];
        let same = get_with(&service, &format!("/v1/jobs/{id}/mesh"), &accept).await;
        assert_eq!(same.header("vary"), "accept");
        assert_eq!(same.body, answer.body);

        // The rest of a download that broke off, and a look at what there is.
        let headers = [("range", "bytes=10-"), ("if-range", answer.header("etag"))];
        let rest = get_with(&service, &path, &headers).await.expect(206);
        assert_eq!(rest.body, answer.body[10..]);
        let headers = [("if-none-match", answer.header("etag"))];
        get_with(&service, &path, &headers).await.expect(304);
        let head = Request::head(&path).body(Body::empty()).unwrap();
        let head = service.send(head).await.expect(200);
        assert!(head.body.is_empty());
        assert_eq!(head.header("content-length"), answer.body.len().to_string());
    }
    let all = service.get(&format!("/v1/jobs/{id}/mesh")).await;
    assert_eq!(all.header("content-type"), "application/x-ply");
    assert_eq!(all.body, tetrahedron());
    let headers = [("range", "bytes=99999-")];
    get_with(&service, &format!("/v1/jobs/{id}/mesh"), &headers)
        .await
        .expect_problem(416, "range_not_satisfiable");
}

#[tokio::test]
async fn a_format_that_is_not_there_is_named() {
    let service = Service::new().await;
    let id = succeeded(&service).await;
    let path = format!("/v1/jobs/{id}/mesh");
    let refused = get_with(&service, &path, &[("accept", "image/png")]).await;
    expect_contract(&refused, "get", "/v1/jobs/{id}/mesh");
    let problem = refused.expect_problem(406, "not_acceptable");
    assert!(
        problem["acceptable"].as_array().unwrap().len() == 8,
        "{problem}"
    );
    let path = format!("/v1/jobs/{id}/mesh.3ds");
    let problem = service.get(&path).await.expect_problem(404, "not_found");
    assert!(problem["detail"].as_str().unwrap().contains("glb"));
}

#[tokio::test]
async fn results_follow_the_state_of_the_job() {
    let service = Service::new().await;
    let id = service.submit().await;
    let paths = ["mesh", "mesh.obj", "report", "model"].map(|end| format!("/v1/jobs/{id}/{end}"));
    for path in &paths {
        let answer = service.get(path).await;
        assert!(answer.header("retry-after").parse::<u32>().unwrap() > 0);
        answer.expect_problem(409, "result_not_ready");
    }
    let claim = service.claim().await;
    service.fail(&claim, "no_surface").await;
    for path in &paths {
        let problem = service.get(path).await.expect_problem(404, "not_found");
        let detail = problem["detail"].as_str().unwrap();
        assert!(detail.contains("failed (no_surface)"), "{detail}");
        assert!(detail.contains(&format!("/v1/jobs/{id}/retry")), "{detail}");
    }
    service.delete(&format!("/v1/jobs/{id}")).await.expect(204);
    for path in &paths {
        service.get(path).await.expect_problem(410, "gone");
    }
}

#[tokio::test]
async fn snapshots_are_listed_and_given_while_the_job_runs() {
    let service = Service::new().await;
    let id = service.submit().await;
    let claim = service.claim().await;
    for evaluation in [20, 5] {
        let stored = service.store().put_snapshot(&claim, evaluation, mesh());
        stored.await.unwrap();
    }
    let list = service.get(&format!("/v1/jobs/{id}/snapshots")).await;
    expect_contract(&list, "get", "/v1/jobs/{id}/snapshots");
    let list = list.json();
    assert_eq!(list["items"][0]["evaluation"], 5);
    let link = list["items"][1]["links"]["obj"].as_str().unwrap();
    assert_eq!(link, format!("/v1/jobs/{id}/snapshots/20.obj"));
    let obj = service.get(link).await.expect(200);
    assert!(
        obj.header("content-disposition")
            .contains(&format!("{id}-20.obj"))
    );
    let ply = service.get(&format!("/v1/jobs/{id}/snapshots/5")).await;
    assert_eq!(ply.expect(200).body, tetrahedron());
    for missing in ["0", "6", "x", "5.3ds", "5.ply.gz"] {
        let path = format!("/v1/jobs/{id}/snapshots/{missing}");
        service.get(&path).await.expect_problem(404, "not_found");
    }
}

#[tokio::test]
async fn report_and_model_are_given() {
    let service = Service::new().await;
    let id = succeeded(&service).await;
    let report = service.get(&format!("/v1/jobs/{id}/report")).await;
    expect_contract(&report, "get", "/v1/jobs/{id}/report");
    assert_eq!(report.json()["mesh"]["closed"], true);
    let file = service.get(&format!("/v1/jobs/{id}/model")).await;
    expect_contract(&file, "get", "/v1/jobs/{id}/model");
    assert_eq!(Model::decode(&file.body).unwrap(), model());
}

#[tokio::test]
async fn the_field_is_evaluated_in_the_coordinates_of_the_cloud() {
    let service = Service::new().await;
    let id = succeeded(&service).await;
    let path = format!("/v1/jobs/{id}/field");
    let h = 1e-3;
    let points = [[1.0, 2.5, 3.0], [1.0 + h, 2.5, 3.0], [1.0 - h, 2.5, 3.0]];
    let asked = json!({"points": points, "gradients": true});
    let answer = service.post_json(&path, &asked).await.expect(200);
    expect_contract(&answer, "post", "/v1/jobs/{id}/field");
    let answer = answer.json();
    let value = |i: usize| answer["values"][i].as_f64().unwrap();
    let slope = answer["gradients"][0][0].as_f64().unwrap();
    // Central differences are off by h²/6 · f''', and a factor of the frame would show at once.
    assert!(
        ((value(1) - value(2)) / (2.0 * h) - slope).abs() < 1e-4,
        "{answer}"
    );
    let only = service
        .post_json(&path, &json!({"points": points}))
        .await
        .json();
    assert_eq!(only, json!({"values": answer["values"]}));

    let bad = json!({"points": [[0, 0, 0], [0, 0]], "gradient": true});
    let problem = service.post_json(&path, &bad).await;
    let problem = problem.expect_problem(422, "request_invalid");
    let pointers = [0, 1].map(|i| problem["errors"][i]["pointer"].clone());
    assert_eq!(pointers, ["/points/1", "/gradient"], "{problem}");
    let many = json!({"points": vec![[0.0; 3]; 100_001]});
    service
        .post_json(&path, &many)
        .await
        .expect_problem(422, "request_invalid");
}

#[tokio::test]
async fn a_network_that_cannot_be_read_is_told() {
    let service = Service::new().await;
    let id = service.submit().await;
    let claim = service.claim().await;
    let success = Success {
        mesh: mesh(),
        report: json!({}),
        model: b"of another version".to_vec(),
        last: Record::default(),
    };
    service.store().succeed(&claim, success).await.unwrap();
    let path = format!("/v1/jobs/{id}/field");
    let answer = service
        .post_json(&path, &json!({"points": [[0, 0, 0]]}))
        .await;
    expect_contract(&answer, "post", "/v1/jobs/{id}/field");
    let problem = answer.expect_problem(409, "model_unreadable");
    assert_eq!(problem["retryable"], false);
}

#[tokio::test]
async fn the_series_comes_whole_thinned_and_in_three_formats() {
    let service = Service::new().await;
    let id = service.submit().await;
    let claim = service.claim().await;
    let mut rows: Vec<_> = (1..=1_000).map(|i| row(i, 1.0 / i as f64)).collect();
    rows[499].loss = 7.0;
    let record = Record {
        metrics: rows,
        gradients: vec![GradientHistogram {
            evaluation: 3,
            layers: vec![LayerHistogram {
                layer: "linear.0".to_owned(),
                min: -1.0,
                max: 1.0,
                counts: vec![1, 2],
            }],
        }],
        ..Record::default()
    };
    service.store().record(&claim, record).await.unwrap();
    let path = format!("/v1/jobs/{id}/metrics");
    let whole = service.get(&path).await;
    expect_contract(&whole, "get", "/v1/jobs/{id}/metrics");
    assert_eq!(
        whole.json()["series"]["loss"].as_array().unwrap().len(),
        1_000
    );
    let thin = service
        .get(&format!("{path}?max_points=50&fields=loss"))
        .await;
    expect_contract(&thin, "get", "/v1/jobs/{id}/metrics");
    let thin = thin.json();
    let losses = thin["series"]["loss"].as_array().unwrap();
    assert!(losses.len() <= 50 && losses.contains(&json!(7.0)), "{thin}");
    assert_eq!(thin["rows"], 1_000);
    assert!(thin["series"].get("weight_norms").is_none());
    let tail = service
        .get(&format!("{path}?after=998&format=csv&fields=loss"))
        .await;
    assert_eq!(
        tail.body,
        b"evaluation,loss\n999,0.001001001001001001\n1000,0.001\n"
    );
    let accept = [("accept", "application/x-ndjson")];
    let lines = get_with(&service, &format!("{path}?after=999"), &accept).await;
    expect_contract(&lines, "get", "/v1/jobs/{id}/metrics");
    assert_eq!(lines.json()["weight_norms"], json!([1.0, 2.0]));
    get_with(&service, &path, &[("accept", "image/png")])
        .await
        .expect_problem(406, "not_acceptable");
    let bad = service
        .get(&format!("{path}?fields=los&max_points=3&x=1"))
        .await;
    let bad = bad.expect_problem(422, "request_invalid");
    assert_eq!(bad["errors"].as_array().unwrap().len(), 3, "{bad}");

    let gradients = service.get(&format!("/v1/jobs/{id}/gradients")).await;
    expect_contract(&gradients, "get", "/v1/jobs/{id}/gradients");
    assert_eq!(gradients.json()["items"][0]["evaluation"], 3);
}
