//! A service whose content is in an object store: its life, what happens without the store, and which
//! stores it refuses.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use meshway::jobs::store::CONTENT_FILE;
use meshway::jobs::{Error, JobId, NewMesh, Options, Store, Success};
use rustix::process::Signal;
use serde_json::{Value, json};
use tokio::time::sleep;

use crate::cut::told_seconds;
use crate::http::support::sphere_xyz;
use crate::place::{Bucket, Place};
use crate::s3::S3;
use crate::server::{PATIENCE, PROGRAM, Server, job_ended, until};
use crate::store::support::{Bench, success};
use crate::who::{ours, us};
use crate::wire::Connection;

/// A service on an object store, and a client of it.
struct Served {
    server: Server,
    client: Connection,
    folder: tempfile::TempDir,
}

impl Served {
    async fn start(bucket: &Bucket, flags: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let objects = bucket.flag();
        let flags = [&[&*objects], flags].concat();
        let log = folder.path().join("log");
        let server = Server::start(&folder.path().join("data"), log, &flags).await;
        let client = Connection::open(server.address()).await.unwrap();
        Self {
            server,
            client,
            folder,
        }
    }

    /// An answer that is as it should be.
    async fn ask(&mut self, line: &str, status: u16) -> Vec<u8> {
        let answer = self.client.ask(line, "", &[]).await.unwrap();
        let log = self.server.log();
        assert_eq!(answer.status, status, "{line}: {}\n{log}", answer.json());
        answer.body
    }

    async fn get(&mut self, line: &str) -> Value {
        serde_json::from_slice(&self.ask(line, 200).await).unwrap()
    }

    /// Uploads a sphere; gives its address.
    async fn upload(&mut self) -> (String, Vec<u8>) {
        let bytes = sphere_xyz(300, 0.0).into_bytes();
        let sent = self.client.ask("POST /v1/clouds", "", &[&bytes]).await;
        let cloud = sent.unwrap().json();
        (cloud["links"]["self"].as_str().unwrap().to_owned(), bytes)
    }

    /// Submits a job of a cloud; gives its address.
    async fn submit(&mut self, cloud: &str) -> String {
        let body = json!({
            "cloud_id": cloud.rsplit('/').next().unwrap(),
            "preset": "fast",
            "settings": {"training": {"max_evaluations": 40}, "surface": {"resolution": 32}},
        });
        let job = self.client.post("/v1/jobs", "", &body).await.unwrap();
        let job = job.json();
        job["links"]["self"].as_str().unwrap().to_owned()
    }

    async fn ended(&mut self, job: &str) -> Value {
        let job = self.get(&format!("GET {job}")).await;
        job_ended(&mut self.client, &job).await
    }

    async fn running(&mut self, job: &str) {
        let line = format!("GET {job}");
        until("the job runs", PATIENCE, async || {
            let job = self.get(&line).await;
            (job["status"] == "running" && job["phase"].is_string()).then_some(())
        })
        .await;
    }
}

fn is_empty(folder: &Path) -> bool {
    fs::read_dir(folder).unwrap().next().is_none()
}

#[tokio::test]
async fn a_service_keeps_all_content_in_the_store_and_leaves_none_there() {
    let Some(bucket) = Bucket::new() else { return };
    let mut served = Served::start(&bucket, &[]).await;
    let (cloud, bytes) = served.upload().await;
    let job = served.submit(&cloud).await;
    let end = served.ended(&job).await;
    assert_eq!(end["status"], "succeeded", "{end}");
    // The cloud, the mesh and the network.
    until("the checkpoints are gone", PATIENCE, async || {
        (bucket.keys().len() == 3).then_some(())
    })
    .await;
    let content = served.ask(&format!("GET {cloud}/content"), 200).await;
    assert!(content == bytes);
    let points = served.ask(&format!("GET {cloud}/points"), 200).await;
    assert_eq!(points.len(), 300 * 16);
    let mesh = served.ask(&format!("GET {job}/mesh.ply"), 200).await;
    assert!(mesh.starts_with(b"ply\n"));
    served.ask(&format!("GET {job}/mesh.obj"), 200).await;
    served.ask(&format!("GET {job}/model"), 200).await;
    let data = served.folder.path().join("data");
    assert!(!data.join(CONTENT_FILE).exists());
    assert!(is_empty(&data.join("clouds")) && is_empty(&data.join("tmp")));

    // The same bytes again are the same cloud and no other object.
    assert_eq!(served.upload().await.0, cloud);
    assert_eq!(bucket.keys().len(), 3);
    served.ask(&format!("DELETE {job}"), 204).await;
    served.ask(&format!("DELETE {cloud}"), 204).await;
    assert_eq!(bucket.keys(), Vec::<String>::new());
    assert!(served.server.terminate().await.success());
}

#[tokio::test]
async fn without_the_store_work_goes_on_and_only_bytes_wait() {
    let Some(mut s3) = S3::start().await else {
        return;
    };
    let go = tempfile::tempdir().unwrap();
    let file = go.path().join("go");
    let script = format!("--script=until:{}", file.display());
    let bucket = s3.bucket();
    let mut served = Served::start(&bucket, &[&script]).await;
    let (cloud, _) = served.upload().await;
    fs::write(&file, "").unwrap();
    let done = served.submit(&cloud).await;
    assert_eq!(served.ended(&done).await["status"], "succeeded");

    for stalls in [false, true] {
        fs::remove_file(&file).unwrap();
        let job = served.submit(&cloud).await;
        served.running(&job).await;
        if stalls {
            s3.signal(Signal::STOP);
        } else {
            s3.kill();
        }
        fs::write(&file, "").unwrap();
        // Longer than a lease, if the store stalls.
        let problem = served.ask(&format!("GET {done}/mesh.ply"), 503).await;
        let problem: Value = serde_json::from_slice(&problem).unwrap();
        assert_eq!(problem["code"], "storage_unavailable", "{problem}");
        served.get("GET /v1/jobs").await;
        served.get(&format!("GET {cloud}")).await;
        served.ask("GET /readyz", 200).await;
        let sent = sphere_xyz(300, 1.0).into_bytes();
        let sent = served.client.ask("POST /v1/clouds", "", &[&sent]).await;
        assert_eq!(sent.unwrap().status, 503);
        until("the job tells why it waits", PATIENCE, async || {
            let log = served.server.log();
            log.contains("content is tried again").then_some(())
        })
        .await;
        let away = told_seconds().filter(|_| !stalls).unwrap_or_default();
        let since = Instant::now();
        loop {
            assert_eq!(served.get(&format!("GET {job}")).await["status"], "running");
            if since.elapsed().as_secs() >= away {
                break;
            }
            sleep(Duration::from_secs(5)).await;
        }
        if stalls {
            s3.signal(Signal::CONT);
        } else {
            s3.restart().await;
        }
        let end = served.ended(&job).await;
        assert_eq!(end["status"], "succeeded", "{end}");
        assert_eq!((&end["attempt"], &end["failures"]), (&json!(1), &json!(0)));
        served.ask(&format!("DELETE {job}"), 204).await;
    }
    // Erased while the store is away, and removed once it is back.
    s3.kill();
    served.ask(&format!("DELETE {done}"), 204).await;
    served.ask(&format!("DELETE {cloud}"), 204).await;
    assert!(bucket.keys().len() >= 3);
    s3.restart().await;
    until("nothing is left", PATIENCE, async || {
        bucket.keys().is_empty().then_some(())
    })
    .await;
}

/// A folder with the content of a job that has succeeded, in the folder itself.
async fn embedded() -> (Bench, JobId) {
    let bench = Bench::new().await;
    let id = bench.submit().await.id;
    let claim = bench.claim().await;
    let success = Success {
        mesh: NewMesh::new(4, 4, vec![7; 20 << 20]),
        ..success()
    };
    bench.store.succeed(&claim, success).await.unwrap();
    bench.store.close().await;
    (bench, id)
}

#[tokio::test]
async fn content_of_a_folder_moves_to_the_store_and_does_not_come_back() {
    let Some(place) = Place::bucket() else { return };
    let (folder, id) = embedded().await;
    for _ in 0..2 {
        let options = place.options(Options::default());
        let store = Store::open(folder.path(), options).await.unwrap();
        let mesh = store.of(ours()).mesh_info(&id, 0).await.unwrap().unwrap();
        let bytes = store.mesh_bytes(&mesh).await.unwrap();
        assert!(bytes.is_some_and(|bytes| bytes == vec![7; 20 << 20]));
        let model = store.of(ours()).model(&id).await.unwrap().unwrap();
        assert_eq!(model.0, [1, 2, 3]);
        assert!(!folder.path().join(CONTENT_FILE).exists());
        store.close().await;
    }
    let refused = Store::open(folder.path(), Options::default()).await;
    let refused = refused.err().unwrap();
    assert!(matches!(refused, Error::ContentRefused(_)), "{refused}");
    assert!(refused.to_string().contains("--objects"), "{refused}");
    // Somebody who only reads rows needs no store, and harms none.
    let rows_only = Options {
        rows_only: true,
        ..Options::default()
    };
    let store = Store::open(folder.path(), rows_only).await.unwrap();
    store.by(us()).delete_job(&id).await.unwrap();
    store.close().await;
    let options = place.options(Options::default());
    let store = Store::open(folder.path(), options).await.unwrap();
    let Place::Bucket(bucket) = &place else {
        unreachable!("a place in an object store")
    };
    until("the content is removed", PATIENCE, async || {
        bucket.keys().is_empty().then_some(())
    })
    .await;
    store.close().await;
}

#[tokio::test]
async fn a_store_that_is_not_ours_ends_the_start_with_a_reason() {
    let Some(bucket) = Bucket::new() else { return };
    let folder = tempfile::tempdir().unwrap();
    let options = Place::Bucket(bucket.clone()).options(Options::default());
    let store = Store::open(folder.path(), options).await.unwrap();
    store.close().await;

    let start = |url: &str, secret: Option<&str>| {
        let other = tempfile::tempdir().unwrap();
        let mut command = Command::new(PROGRAM);
        command
            .args(["serve", "--listen=127.0.0.1:0", "--data-dir"])
            .arg(other.path())
            .arg(format!("--objects={url}"));
        if let Some(secret) = secret {
            command.env("AWS_SECRET_ACCESS_KEY", secret);
        }
        let output = command.output().unwrap();
        let message = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success(), "{message}");
        assert!(!message.contains("panicked"), "{message}");
        message
    };
    let url = &bucket.url;
    let missing = url.replace("s3://tests/", "s3://missing/");
    let closed = "s3://tests/closed?endpoint=http://127.0.0.1:9";
    for (url, secret, reason) in [
        (url.as_str(), None, "another database"),
        (&missing, None, "no such bucket"),
        (url, Some("wrong"), "credentials"),
        (closed, None, "does not answer"),
        ("s3://b?endpoint=http://s3.example", None, "unencrypted"),
    ] {
        let message = start(url, secret);
        assert!(message.contains(reason), "{url}: {message}");
    }
    // Other things that are there are nobody's to take.
    let beside = bucket.folder.with_extension("other");
    fs::create_dir(&beside).unwrap();
    fs::write(beside.join("thing"), "precious").unwrap();
    let name = beside.file_name().unwrap().to_str().unwrap();
    let own = bucket.folder.file_name().unwrap().to_str().unwrap();
    let message = start(&url.replace(own, name), None);
    assert!(message.contains("other things"), "{message}");
    assert_eq!(
        fs::read_to_string(beside.join("thing")).unwrap(),
        "precious"
    );
}
