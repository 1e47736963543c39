//! The ends of uploads that may go on: refused, finished by the next server, given up, forgotten.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use meshway::http::sweep;
use meshway::jobs::Options;
use serde_json::Value;

use crate::erasure::holds;
use crate::http::resumable::{DRAFT, LAST, TUS, part, with};
use crate::http::support::{Service, sphere_xyz};
use crate::http::tenants::{Held, configure};

#[tokio::test]
async fn what_is_no_cloud_is_refused_once_all_bytes_are_there() {
    let service = Service::new().await;
    let upload = service.begin().await;
    let last = service
        .send(part(&upload, 0, &LAST, "1 2 3\n".repeat(20)))
        .await;
    assert_eq!(last.header("upload-complete"), "?1");
    last.expect_problem(422, "cloud_degenerate");
    let shown = service.get(&upload).await.expect(200).json();
    assert_eq!(shown["error"]["code"], "cloud_degenerate");
    assert_eq!(shown["cloud_id"], Value::Null);
    assert!(service.files("uploads").is_empty() && service.files("tmp").is_empty());
    for (headers, code) in [
        (vec![LAST[1]], 400),
        (vec![LAST[0]], 415),
        (vec![LAST[0], LAST[1], ("content-encoding", "gzip")], 415),
    ] {
        let answer = service.send(part(&upload, 0, &headers, "x")).await;
        answer.expect(code);
    }
}

#[tokio::test]
async fn the_next_server_finishes_what_the_last_one_left() {
    let mut service = Service::new().await;
    let upload = service.begin().await;
    let bytes = sphere_xyz(100, 0.0);
    service
        .send(part(&upload, 0, &DRAFT, bytes.clone()))
        .await
        .expect(204);
    // Killed after it noted that all bytes are there, and before anything came of them.
    let id = upload.rsplit('/').next().unwrap().parse().unwrap();
    let step = meshway::jobs::Step {
        from: bytes.len() as u64,
        to: bytes.len() as u64,
        length: Some(bytes.len() as u64),
        complete: true,
        keep_ms: 1_000_000,
    };
    let acts = service.store().by(crate::who::us());
    acts.advance_upload(&id, step).await.unwrap();
    service.restart();
    sweep(&service.app).await.unwrap();
    let shown = service.get(&upload).await.expect(200).json();
    let cloud = shown["links"]["cloud"].as_str().unwrap();
    assert_eq!(
        service.get(cloud).await.expect(200).json()["bytes"],
        bytes.len()
    );
    assert!(service.files("uploads").is_empty());
}

#[tokio::test]
async fn uploads_end_after_a_time_without_bytes_and_leave_nothing() {
    let now = Arc::new(AtomicI64::new(1_000_000_000_000));
    let clock = Arc::clone(&now);
    let options = Options {
        clock: Some(Arc::new(move || clock.load(Ordering::Relaxed))),
        ..Options::default()
    };
    let service = Service::over(&["--upload-keep-hours=2"], options).await;
    let key = Held::all("radiology");
    configure(&service, &[&key]);
    let begin = || {
        with(
            "POST",
            "/v1/uploads",
            &[("upload-complete", "?0")],
            "a patient's bytes",
        )
    };
    let begun = service.ask(&key, begin()).await.expect(201);
    let kept = service.ask(&key, begin()).await.expect(201);
    let (upload, kept) = (begun.header("location"), kept.header("location"));
    now.fetch_add(90 * 60_000, Ordering::Relaxed);
    let more = service.ask(&key, part(kept, 17, &DRAFT, "more")).await;
    more.expect(204);
    now.fetch_add(60 * 60_000, Ordering::Relaxed);
    sweep(&service.app).await.unwrap();
    let gone = service
        .fetch(&key, upload)
        .await
        .expect_problem(410, "gone");
    assert_eq!(gone["reason"], "expired");
    service.fetch(&key, kept).await.expect(200);
    assert_eq!(service.files("uploads").len(), 1);
    service
        .ask(&key, with("DELETE", kept, &[], ""))
        .await
        .expect(204);
    let gone = service.fetch(&key, kept).await.expect_problem(410, "gone");
    assert_eq!(gone["reason"], "deleted");
    assert!(!holds(&service.dir.path().join("uploads"), b"patient"));
    let trail = service.store().audit_after(0, 10).await.unwrap();
    let told: Vec<_> = trail
        .iter()
        .map(|row| (row.event.as_str(), row.actor.as_deref()))
        .collect();
    let name = trail[0].actor.as_deref();
    assert_eq!(
        told,
        [
            ("upload.create", name),
            ("upload.create", name),
            ("upload.delete", Some("meshway")),
            ("upload.delete", name),
        ]
    );
}

#[tokio::test]
async fn what_was_announced_is_nobody_elses() {
    // There is room for one announcement and not for two, whatever others write meanwhile.
    let service = Service::new().await;
    let free = service.app.disk.space().unwrap().free_bytes;
    let room = free.min(100 << 30);
    let reserve = format!("--disk-reserve-mib={}", (free - room) >> 20);
    let service = Service::with(&[&reserve, "--body-limit-mib=65536"]).await;
    let announce = || {
        let length = (room / 10 * 6).to_string();
        with(
            "POST",
            "/v1/uploads",
            &[TUS[0], ("upload-length", &length)],
            "",
        )
    };
    let first = service.send(announce()).await.expect(201);
    let second = service.send(announce()).await;
    second.expect_problem(507, "insufficient_storage");
    let upload = first.header("location");
    service
        .send(part(upload, 0, &TUS, "some bytes"))
        .await
        .expect(204);
    service.delete(upload).await.expect(204);
    service.send(announce()).await.expect(201);
    let large = (1_u64 << 40).to_string();
    let large = [TUS[0], ("upload-length", large.as_str())];
    let answer = service.send(with("POST", "/v1/uploads", &large, "")).await;
    assert!(answer.header("upload-limit").starts_with("max-size="));
    answer.expect_problem(413, "body_too_large");
}
