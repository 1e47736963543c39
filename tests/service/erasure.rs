//! What is erased is in no file afterwards.

use std::fs;
use std::path::Path;

use axum::body::Body;
use axum::http::Request;
use meshway::jobs::{Claim, NewMesh, Record, Success};
use meshway::reconstruction::mesh::{TriangleMesh, write};
use serde_json::json;

use crate::http::support::{Answer, Service, gzip, sphere_xyz, upload_request};
use crate::server::{Folder, PATIENCE, Server, until};
use crate::wire::Connection;

/// Of the formats that are made when they are asked for.
const ENCODED: [&str; 4] = ["obj", "stl", "off", "glb"];

/// A mesh that differs with `shift`, in the encoding of the store.
fn mesh(shift: f64) -> NewMesh {
    let vertex = |v: [f64; 3]| v.map(|v| v + shift);
    let corners = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mesh = TriangleMesh {
        vertices: corners.map(vertex).to_vec(),
        triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
        ..TriangleMesh::default()
    };
    let mut data = Vec::new();
    write::write(&mesh, write::Format::PlyBinary, &mut data).unwrap();
    NewMesh::new(4, 4, data)
}

async fn succeed(service: &Service, claim: &Claim, mesh: NewMesh) {
    let success = Success {
        mesh,
        report: json!({}),
        model: vec![1],
        last: Record::default(),
    };
    service.store().succeed(claim, success).await.unwrap();
}

/// A job that has ended well with the mesh; its address.
async fn job_with(service: &Service, mesh: NewMesh) -> String {
    let id = service.submit().await;
    let claim = service.claim().await;
    succeed(service, &claim, mesh).await;
    format!("/v1/jobs/{id}")
}

/// Whether a file below the folder holds the bytes.
pub(crate) fn holds(folder: &Path, bytes: &[u8]) -> bool {
    fs::read_dir(folder).unwrap().any(|entry| {
        let path = entry.unwrap().path();
        if path.is_dir() {
            return holds(&path, bytes);
        }
        // A file that is removed meanwhile holds nothing.
        let content = fs::read(&path).unwrap_or_default();
        content.windows(bytes.len()).any(|part| part == bytes)
    })
}

/// The end of a file: its vertices or triangles, whatever its format.
fn marker(body: &[u8]) -> Vec<u8> {
    body[body.len().saturating_sub(100)..].to_vec()
}

#[tokio::test]
async fn an_erased_job_leaves_no_encoding_of_its_meshes() {
    let service = Service::new().await;
    let id = service.submit().await;
    let claim = service.claim().await;
    let snapshot = service.store().put_snapshot(&claim, 5, mesh(0.125));
    snapshot.await.unwrap();
    // Replaced by another one after it was downloaded.
    let mut downloads = Vec::new();
    for ending in ENCODED {
        let path = format!("/v1/jobs/{id}/snapshots/5.{ending}");
        downloads.push(service.get(&path).await.expect(200).body);
    }
    let snapshot = service.store().put_snapshot(&claim, 5, mesh(0.25));
    snapshot.await.unwrap();
    succeed(&service, &claim, mesh(0.375)).await;
    for place in ["snapshots/5", "mesh"] {
        for ending in ENCODED {
            let path = format!("/v1/jobs/{id}/{place}.{ending}");
            downloads.push(service.get(&path).await.expect(200).body);
        }
    }
    let folder = service.dir.path();
    for body in &downloads {
        assert!(holds(&folder.join("cache"), &marker(body)));
    }
    let canonical = service.get(&format!("/v1/jobs/{id}/mesh.ply")).await;
    downloads.push(canonical.expect(200).body);
    service.delete(&format!("/v1/jobs/{id}")).await.expect(204);
    assert_eq!(service.files("cache"), Vec::<String>::new());
    for body in &downloads {
        let what = "the database's log is overwritten";
        until(what, PATIENCE, async || {
            (!holds(folder, &marker(body))).then_some(())
        })
        .await;
    }
}

#[tokio::test]
async fn the_same_mesh_of_another_job_stays() {
    let service = Service::new().await;
    let first = job_with(&service, mesh(0.5)).await;
    let second = job_with(&service, mesh(0.5)).await;
    let third = job_with(&service, mesh(0.5)).await;
    for job in [&first, &second] {
        service.get(&format!("{job}/mesh.obj")).await.expect(200);
    }
    let kept = service.files("cache");
    assert_eq!(kept.len(), 1);
    service.delete(&first).await.expect(204);
    assert_eq!(service.files("cache"), kept);
    let same = service.get(&format!("{second}/mesh.obj")).await.expect(200);
    service.delete(&second).await.expect(204);
    assert!(service.files("cache").is_empty());
    // The last one has it too, and makes it again.
    let again = service.get(&format!("{third}/mesh.obj")).await.expect(200);
    assert_eq!(again.body, same.body);
    service.delete(&third).await.expect(204);
    assert!(service.files("cache").is_empty());
}

#[tokio::test]
async fn a_job_that_is_erased_while_its_mesh_is_encoded_leaves_nothing() {
    let service = Service::new().await;
    for round in 0..30 {
        let job = job_with(&service, mesh(f64::from(round))).await;
        let get = |ending: &str| {
            let path = format!("{job}/mesh.{ending}");
            service.send(Request::get(path).body(Body::empty()).unwrap())
        };
        let gone = |answer: &Answer| matches!(answer.status.as_u16(), 200 | 404 | 410);
        // One waits for its answer, one hangs up.
        let hung_up = tokio::spawn(get("stl"));
        let (answer, erased) = tokio::join!(get("obj"), async {
            for _ in 0..round {
                tokio::task::yield_now().await;
            }
            hung_up.abort();
            service.delete(&job).await
        });
        erased.expect(204);
        assert!(gone(&answer), "{answer:?}");
        service
            .until("no file is left", |service| {
                service.files("cache").is_empty()
            })
            .await;
    }
}

fn keyed_upload(body: Vec<u8>, key: &str) -> Request<Body> {
    let mut request = upload_request(body);
    let key = key.parse().unwrap();
    request.headers_mut().insert("idempotency-key", key);
    request
}

#[tokio::test]
async fn an_erased_cloud_leaves_no_answer_that_tells_of_it() {
    let service = Service::new().await;
    let body = gzip(sphere_xyz(100, 0.5).as_bytes());
    let cloud = service
        .send(keyed_upload(body.clone(), "a"))
        .await
        .expect(201)
        .json();
    service
        .send(keyed_upload(body.clone(), "b"))
        .await
        .expect(200);
    let other = keyed_upload(sphere_xyz(100, 2.5).into_bytes(), "c");
    let other = service.send(other).await.expect(201).json();
    let hash = cloud["sha256"].as_str().unwrap().as_bytes();
    let bounds = cloud["bounds"].to_string();
    let folder = service.dir.path();
    assert!(holds(folder, hash) && holds(folder, bounds.as_bytes()));
    let path = cloud["links"]["self"].as_str().unwrap();
    service.delete(path).await.expect(204);
    for key in ["a", "b"] {
        let again = service.send(keyed_upload(body.clone(), key)).await;
        let problem = again.expect_problem(410, "gone");
        assert!(
            problem["detail"].as_str().unwrap().contains("cloud"),
            "{problem}"
        );
    }
    until("the database's log is overwritten", PATIENCE, async || {
        (!holds(folder, hash) && !holds(folder, bounds.as_bytes())).then_some(())
    })
    .await;
    let again = keyed_upload(sphere_xyz(100, 2.5).into_bytes(), "c");
    assert_eq!(service.send(again).await.expect(201).json(), other);
}

/// What the client downloads of a job, in every encoding.
async fn downloads(server: &Server, job: &str, evaluation: u64) -> Vec<Vec<u8>> {
    let mut client = Connection::open(server.address()).await.unwrap();
    let mut bodies = Vec::new();
    for place in ["mesh".to_owned(), format!("snapshots/{evaluation}")] {
        for ending in ENCODED {
            let line = format!("GET {job}/{place}.{ending}");
            let answer = client.ask(&line, "", &[]).await.unwrap();
            assert_eq!(answer.status, 200, "{line}: {}", answer.json());
            bodies.push(answer.body);
        }
    }
    bodies
}

#[tokio::test]
async fn a_served_job_is_erased_from_the_whole_folder() {
    let folder = Folder::new().await;
    let server = folder.serve(&[]).await;
    let settings = json!({"training": {"snapshot_evaluations": [20]}});
    let id = folder.submit(settings).await;
    let job = folder.end(&id).await;
    assert!(job.report.is_some(), "{:?}", job.error);
    let job = format!("/v1/jobs/{id}");
    let bodies = downloads(&server, &job, 20).await;
    let cache = folder.path().join("cache");
    assert_eq!(fs::read_dir(&cache).unwrap().count(), bodies.len());
    let mut client = Connection::open(server.address()).await.unwrap();
    let line = format!("DELETE {job}");
    assert_eq!(client.ask(&line, "", &[]).await.unwrap().status, 204);
    assert_eq!(fs::read_dir(&cache).unwrap().count(), 0);
    let nothing_is_left = async || {
        let left = bodies
            .iter()
            .any(|body| holds(folder.path(), &marker(body)));
        (!left).then_some(())
    };
    until("nothing is left", PATIENCE, nothing_is_left).await;
    server.terminate().await;
    let _server = folder.serve(&[]).await;
    until("nothing is left after a restart", PATIENCE, nothing_is_left).await;
}
