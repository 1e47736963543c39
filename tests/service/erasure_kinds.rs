//! Whatever kind of content it is: after erasing job and cloud no byte of it is under the data
//! folder or in the object store, neither at once nor after the next start.

use std::path::PathBuf;

use axum::body::Body;
use axum::http::Request;
use meshway::jobs::{NewEvent, NewMesh, Options, Record, Store, Success};
use meshway::reconstruction::Warning;
use serde_json::{Value, json};

use crate::erasure::holds;
use crate::http::support::{Service, sphere_xyz};
use crate::place::{Place, in_both_places};
use crate::server::{PATIENCE, until};

/// What is searched for; each kind of content has one of its own.
fn marker(kind: &str) -> String {
    format!("<marker of the {kind}>")
}

/// Bytes of several chunks with the marker in the first and in the last.
fn content(kind: &str) -> Vec<u8> {
    [
        marker(kind).as_bytes(),
        &[7].repeat(600_000),
        marker(kind).as_bytes(),
    ]
    .concat()
}

fn record(kind: &str) -> Record {
    Record {
        events: vec![NewEvent::Warning(Warning::new("odd", marker(kind)))],
        ..Record::default()
    }
}

async fn submit(service: &Service, cloud: &Value, kind: &str) -> String {
    let body = json!({"cloud_id": cloud["id"], "labels": {"patient": marker(kind)}});
    let request = Request::post("/v1/jobs")
        .header("content-type", "application/json")
        .header("idempotency-key", kind)
        .body(Body::from(body.to_string()))
        .unwrap();
    let job = service.send(request).await.expect(202).json();
    job["links"]["self"].as_str().unwrap().to_owned()
}

fn found(folders: &[PathBuf], kinds: &[&str]) -> Vec<String> {
    let markers = kinds.iter().map(|kind| marker(kind));
    let held = |marker: &String| {
        folders
            .iter()
            .any(|folder| holds(folder, marker.as_bytes()))
    };
    markers.filter(held).collect()
}

in_both_places! {
async fn nothing_of_an_erased_job_and_its_cloud_is_left(place: Place) {
    const KINDS: [&str; 10] = [
        "cloud",
        "label",
        "event",
        "checkpoint",
        "snapshot",
        "result",
        "network",
        "report",
        "other label",
        "other checkpoint",
    ];
    let options = || place.options(Options::default());
    let service = Service::over(&[], options()).await;
    let folders = place.folders(service.dir.path());
    let text = format!("# {}\n{}", marker("cloud"), sphere_xyz(100, 0.5));
    // As it was sent: else its comment would be in no file.
    let upload = Request::post("/v1/clouds?keep=identifiers");
    let upload = upload.body(Body::from(text)).unwrap();
    let cloud = service.send(upload).await.expect(201).json();
    let store = service.store();

    let ended = submit(&service, &cloud, "label").await;
    let claim = service.claim().await;
    store.record(&claim, record("event")).await.unwrap();
    let checkpoint = store.put_checkpoint(&claim, 3, content("checkpoint"));
    checkpoint.await.unwrap();
    let snapshot = store.put_snapshot(&claim, 5, NewMesh::new(1, 1, content("snapshot")));
    snapshot.await.unwrap();
    assert_eq!(found(&folders, &KINDS[..5]).len(), 5);
    let success = Success {
        mesh: NewMesh::new(1, 1, content("result")),
        report: json!({"detail": marker("report")}),
        model: content("network"),
        last: Record::default(),
    };
    store.succeed(&claim, success).await.unwrap();
    let read = service.get(&format!("{ended}/mesh.ply")).await.expect(200);
    assert!(read.body == content("result"));

    let running = submit(&service, &cloud, "other label").await;
    let claim = service.claim().await;
    let checkpoint = store.put_checkpoint(&claim, 3, content("other checkpoint"));
    checkpoint.await.unwrap();
    let rest: Vec<&str> = KINDS
        .into_iter()
        .filter(|kind| *kind != "checkpoint")
        .collect();
    assert_eq!(found(&folders, &rest).len(), rest.len());

    for path in [&*ended, &*running, cloud["links"]["self"].as_str().unwrap()] {
        service.delete(path).await.expect(204);
    }
    until("nothing is left", PATIENCE, async || {
        found(&folders, &KINDS).is_empty().then_some(())
    })
    .await;
    store.close().await;
    let store = Store::open(service.dir.path(), options()).await.unwrap();
    assert_eq!(found(&folders, &KINDS), Vec::<String>::new());
    store.close().await;
    assert_eq!(found(&folders, &KINDS), Vec::<String>::new());
}
}
