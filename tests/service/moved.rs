//! `meshway move`: a folder with all that a service may have in it becomes a database, and its bytes stay or
//! become objects.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::Duration;

use meshway::jobs::store::{DATABASE_FILE, DERIVED, TABLES};
use meshway::jobs::{Keep, NewJob, NewWebhook, News, Options, Problem, Store};
use meshway::reconstruction::Preset;
use serde_json::{Value, json};

use crate::http::support::sphere_xyz;
use crate::place::Bucket;
use crate::server::{PROGRAM, Server, job_ended, upload_sphere};
use crate::store::bare::{Bare, new_database};
use crate::upgraded::{run, said};
use crate::who::us;
use crate::wire::Connection;

/// A folder with jobs in each state, and what is known of it.
struct Old {
    dir: tempfile::TempDir,
    done: Value,
    mesh: Vec<u8>,
    cloud: Value,
    bytes: Vec<u8>,
    upload: String,
    running: String,
    last_event: i64,
}

const KEY: &str = "Idempotency-Key: one\r\n";

fn path(record: &Value) -> &str {
    record["links"]["self"].as_str().unwrap()
}

fn new_job(cloud: &Value) -> NewJob {
    NewJob {
        cloud_id: cloud["id"].as_str().unwrap().parse().unwrap(),
        preset: Preset::Fast,
        settings: Preset::Fast.settings(),
        labels: [("patient".to_owned(), "Åsa \u{1f}\\u0000 'x'".to_owned())].into(),
        source: None,
        derived_from: None,
        priority: 1,
        cost_seconds: 1.5,
        keep: Keep::default(),
    }
}

impl Old {
    async fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let data = dir.path().join("data");
        let flags = ["--script=instant", "--workers=2"];
        let server = Server::start(&data, dir.path().join("log"), &flags).await;
        let mut client = Connection::open(server.address()).await.unwrap();
        let cloud = upload_sphere(&mut client).await;
        let job = json!({"cloud_id": cloud["id"], "preset": "fast"});
        let done = client.post("/v1/jobs", KEY, &job).await.unwrap().json();
        let done = job_ended(&mut client, &done).await;
        assert_eq!(done["status"], "succeeded", "{done}");
        let mesh = client
            .ask(&format!("GET {}/mesh.ply", path(&done)), "", &[])
            .await
            .unwrap();
        assert_eq!(mesh.status, 200);
        let batch = json!({"clouds": [cloud["id"], cloud["id"]], "preset": "fast"});
        let batch = client.post("/v1/batches", "", &batch).await.unwrap();
        assert_eq!(batch.status, 202, "{}", batch.json());
        for job in batch.json()["jobs"].as_array().unwrap() {
            job_ended(&mut client, &json!({"links": {"self": job["link"]}})).await;
        }
        let erased = client.post("/v1/jobs", "", &job).await.unwrap().json();
        job_ended(&mut client, &erased).await;
        let delete = format!("DELETE {}", path(&erased));
        assert_eq!(client.ask(&delete, "", &[]).await.unwrap().status, 204);
        let begun = "Upload-Complete: ?0\r\n";
        let upload = client
            .ask("POST /v1/uploads", begun, &[b"0 0 0\n"])
            .await
            .unwrap();
        assert!(upload.status < 300, "{}", upload.json());
        assert!(server.terminate().await.success());

        let store = Store::open(&data, Options::default()).await.unwrap();
        let uploads = store.uploads_with_files().await.unwrap();
        let hook = NewWebhook {
            url: "https://example.org/".to_owned(),
            events: News::ALL.to_vec(),
            secret: vec![0, 7, 255],
        };
        store.by(us()).create_webhook(hook, 1).await.unwrap();
        let acts = || store.by(us());
        acts().submit(new_job(&cloud), None).await.unwrap();
        let failed = store.claim("w", 60_000).await.unwrap().unwrap();
        store
            .fail(&failed, Problem::new("no_surface", "none"))
            .await
            .unwrap();
        acts().submit(new_job(&cloud), None).await.unwrap();
        let running = store.claim("w", 60_000).await.unwrap().unwrap();
        store
            .put_checkpoint(&running, 7, vec![1_u8; 600_000])
            .await
            .unwrap();
        acts().submit(new_job(&cloud), None).await.unwrap();
        store.close().await;
        let mut db = Bare::sqlite(&data.join(DATABASE_FILE)).await;
        let last = "SELECT seq FROM sqlite_sequence WHERE name = 'events'";
        Self {
            done,
            mesh: mesh.body,
            cloud,
            bytes: sphere_xyz(300, 0.0).into_bytes(),
            upload: uploads.into_iter().next().unwrap(),
            running: running.job.id.to_string(),
            last_event: db.number(last).await,
            dir,
        }
    }

    fn data(&self) -> PathBuf {
        self.dir.path().join("data")
    }

    fn line(&self, database: &str, bucket: Option<&Bucket>) -> Vec<String> {
        let mut line = vec![
            "move".to_owned(),
            format!("--from={}", self.data().display()),
            format!("--database={database}"),
        ];
        line.extend(bucket.map(Bucket::flag));
        line
    }

    fn relocate(&self, database: &str, bucket: Option<&Bucket>) -> (Option<i32>, String) {
        let line = self.line(database, bucket);
        let line: Vec<&str> = line.iter().map(String::as_str).collect();
        let output = run(&line);
        (output.status.code(), said(&output))
    }

    /// All that was there is there, and it goes on.
    async fn lives_in(&self, database: &str, bucket: Option<&Bucket>) {
        let flag = format!("--database={database}");
        let data = format!("--data-dir={}", self.data().display());
        let objects = bucket.map(Bucket::flag);
        let mut check = vec!["check", "--hashes", &data, &flag];
        check.extend(objects.as_deref());
        let checked = run(&check);
        assert!(checked.status.success(), "{}", said(&checked));

        let mut flags = vec![&*flag, "--script=instant", "--workers=1"];
        flags.extend(objects.as_deref());
        let log = self.dir.path().join("moved.log");
        let server = Server::start(&self.data(), log, &flags).await;
        let mut client = Connection::open(server.address()).await.unwrap();
        // The job that ran; those that waited are among the others.
        let job = json!({"links": {"self": format!("/v1/jobs/{}", self.running)}});
        let ended = job_ended(&mut client, &job).await;
        assert_eq!(ended["status"], "succeeded", "{ended}\n{}", server.log());
        assert_eq!(ended["failures"], 0);
        let jobs = client.ask("GET /v1/jobs", "", &[]).await.unwrap().json();
        assert_eq!(jobs["items"].as_array().unwrap().len(), 6, "{jobs}");
        for job in jobs["items"].as_array().unwrap() {
            job_ended(&mut client, job).await;
        }
        let mesh = format!("GET {}/mesh.ply", path(&self.done));
        let mesh = client.ask(&mesh, "", &[]).await.unwrap();
        assert!(mesh.status == 200 && mesh.body == self.mesh);
        let content = format!("GET {}/content", path(&self.cloud));
        assert!(client.ask(&content, "", &[]).await.unwrap().body == self.bytes);
        let upload = client
            .ask(&format!("GET /v1/uploads/{}", self.upload), "", &[])
            .await;
        assert!(upload.unwrap().status < 300);
        let job = json!({"cloud_id": self.cloud["id"], "preset": "fast"});
        let kept = client.post("/v1/jobs", KEY, &job).await.unwrap();
        assert_eq!(kept.json()["id"], self.done["id"], "{}", kept.json());

        let mut db = Bare::postgres(database).await;
        let select = format!(
            "SELECT MIN(seq) FROM events WHERE seq > {}",
            self.last_event + 1
        );
        assert_eq!(db.number(&select).await, self.last_event + 2);
        let last = format!("Last-Event-ID: {}\r\n", self.last_event);
        client.send("GET /v1/events", &last, &[]).await.unwrap();
        client.read_head().await.unwrap();
        let id = loop {
            let line = client.read_line().await.unwrap();
            if let Some(id) = line.strip_prefix("id: ") {
                break id.to_owned();
            }
        };
        assert!(id.contains(&(self.last_event + 1).to_string()), "{id}");
        assert!(server.terminate().await.success());
        let trail = run(&["audit", "verify", &flag]);
        assert!(trail.status.success(), "{}", said(&trail));
        let checked = run(&check);
        assert!(checked.status.success(), "{}", said(&checked));
    }
}

async fn moves(bucket: Option<Bucket>) {
    let Some(database) = new_database().await else {
        return;
    };
    let old = Old::new().await;
    let (code, told) = old.relocate(&database, bucket.as_ref());
    assert_eq!(code, Some(0), "{told}");
    for part in [
        "each table reads the same",
        "jobs",
        "deliveries",
        "meshway serve",
    ] {
        assert!(told.contains(part), "{told}");
    }
    assert_eq!(
        told.contains("put and read back"),
        bucket.is_some(),
        "{told}"
    );
    // The folder is not served any more as it was.
    let data = format!("--data-dir={}", old.data().display());
    let refused = run(&["serve", "--listen=127.0.0.1:0", &data]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(
        said(&refused).contains("were moved to postgres://"),
        "{}",
        said(&refused)
    );
    // A second move finds that nothing is to be done.
    let (code, told) = old.relocate(&database, bucket.as_ref());
    assert_eq!(code, Some(0), "{told}");
    assert!(told.contains("from an earlier try"), "{told}");
    old.lives_in(&database, bucket.as_ref()).await;
    let from = format!("--from={}", old.data().display());
    assert!(run(&["move", &from, "--take-back"]).status.success());
    assert_eq!(Store::moved_to(&old.data()).await.unwrap(), None);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_rows_move_and_the_bytes_stay() {
    moves(None).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn rows_and_bytes_move() {
    if let Some(bucket) = Bucket::new() {
        moves(Some(bucket)).await;
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn one_that_is_killed_anywhere_goes_on() {
    let (Some(database), Some(bucket)) = (new_database().await, Bucket::new()) else {
        return;
    };
    let old = Old::new().await;
    let line = old.line(&database, Some(&bucket));
    for milliseconds in (10..).step_by(25) {
        let mut child = Command::new(PROGRAM)
            .args(&line)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        tokio::time::sleep(Duration::from_millis(milliseconds)).await;
        let ended = child.try_wait().unwrap();
        child.kill().unwrap_or_default();
        child.wait().unwrap();
        if ended.is_some_and(|status| status.success()) {
            break;
        }
        assert!(ended.is_none(), "it fails after a kill");
    }
    old.lives_in(&database, Some(&bucket)).await;
}

#[tokio::test]
async fn what_would_mix_or_lose_something_is_refused() {
    let Some(database) = new_database().await else {
        return;
    };
    let nothing = tempfile::tempdir().unwrap();
    let from = format!("--from={}", nothing.path().display());
    let to = format!("--database={database}");
    let refused = run(&["move", &from, &to]);
    assert_eq!(refused.status.code(), Some(3), "{}", said(&refused));

    let old = Old::new().await;
    let server = Server::start(&old.data(), old.dir.path().join("log.1"), &["--workers=1"]).await;
    let (code, told) = old.relocate(&database, None);
    assert_eq!(code, Some(2), "{told}");
    assert!(
        told.contains("another server works in this folder"),
        "{told}"
    );
    drop(server);

    let other = tempfile::tempdir().unwrap();
    let options = Options {
        database: Some(database.clone()),
        ..Options::default()
    };
    let store = Store::open(other.path(), options).await.unwrap();
    let new = crate::store::support::new_cloud("a");
    store.by(us()).insert_cloud(new).await.unwrap();
    store.close().await;
    let (code, told) = old.relocate(&database, None);
    assert_eq!(code, Some(1), "{told}");
    assert!(told.contains("has rows already, in the table"), "{told}");
    assert_eq!(Store::moved_to(&old.data()).await.unwrap(), None);
}

/// A migration that adds a table shows here.
#[tokio::test]
async fn all_tables_move() {
    let listed: BTreeSet<&str> = TABLES.iter().chain(&DERIVED).copied().collect();
    let dir = tempfile::tempdir().unwrap();
    Store::open(dir.path(), Options::default())
        .await
        .unwrap()
        .close()
        .await;
    let mut db = Bare::sqlite(&dir.path().join(DATABASE_FILE)).await;
    let select = "SELECT name FROM sqlite_schema WHERE type = 'table'";
    check_listed(&listed, &db.texts(select).await);
    let Some(database) = new_database().await else {
        return;
    };
    let place = format!("--database={database}");
    assert!(run(&["migrate", &place]).status.success());
    let mut db = Bare::postgres(&database).await;
    let select = "SELECT CAST(tablename AS TEXT) FROM pg_tables WHERE schemaname = 'public'";
    check_listed(&listed, &db.texts(select).await);
}

fn check_listed(listed: &BTreeSet<&str>, tables: &[String]) {
    assert!(tables.len() > 20);
    let known = |table: &String| listed.contains(table.as_str());
    let forgotten: Vec<&String> = tables.iter().filter(|table| !known(table)).collect();
    assert!(
        forgotten.is_empty(),
        "{forgotten:?} would not be moved: name them in moving/tables.rs"
    );
    for table in TABLES {
        assert!(
            tables.iter().any(|found| found == table),
            "{table} is no table"
        );
    }
}
