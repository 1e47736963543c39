//! `meshway check`, over both kinds of rows and bytes: it finds what is missing, damaged or left over.

use std::fs;
use std::path::{Path, PathBuf};

use meshway::jobs::store::CONTENT_FILE;
use serde_json::{Value, json};
use uuid::Uuid;

use crate::place::Bucket;
use crate::server::{Server, job_ended, upload_sphere};
use crate::store::bare::{Bare, new_database};
use crate::upgraded::{run, said};
use crate::wire::Connection;

/// A service with a cloud and a mesh of it, that has ended or goes on.
struct Kept {
    folder: tempfile::TempDir,
    flags: Vec<String>,
    bucket: Option<Bucket>,
    server: Server,
    cloud: Value,
    job: Value,
}

impl Kept {
    async fn new(database: Option<String>, bucket: Option<Bucket>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut flags: Vec<String> = Vec::new();
        flags.extend(database.map(|url| format!("--database={url}")));
        let objects = bucket.as_ref().map(Bucket::flag);
        let served: Vec<&str> = flags.iter().chain(&objects).map(String::as_str).collect();
        let log = folder.path().join("log");
        let server = Server::start(&folder.path().join("data"), log, &served).await;
        let mut client = Connection::open(server.address()).await.unwrap();
        let cloud = upload_sphere(&mut client).await;
        let job = json!({
            "cloud_id": cloud["id"], "preset": "fast",
            "settings": {"training": {"max_evaluations": 40}, "surface": {"resolution": 32}},
        });
        let job = client.post("/v1/jobs", "", &job).await.unwrap().json();
        let job = job_ended(&mut client, &job).await;
        assert_eq!(job["status"], "succeeded", "{job}");
        Self {
            folder,
            flags,
            bucket,
            server,
            cloud,
            job,
        }
    }

    fn data(&self) -> PathBuf {
        self.folder.path().join("data")
    }

    fn check(&self, more: &[&str]) -> (Option<i32>, String) {
        let data = format!("--data-dir={}", self.data().display());
        let mut line = vec!["check", &data];
        line.extend(self.flags.iter().map(String::as_str));
        line.extend(more);
        let output = run(&line);
        (output.status.code(), said(&output))
    }

    fn found(&self, hashes: bool) -> (Option<i32>, Value) {
        let more = ["--json", "--hashes"];
        let data = format!("--data-dir={}", self.data().display());
        let mut line = vec!["check", &data];
        line.extend(self.flags.iter().map(String::as_str));
        line.extend(&more[..if hashes { 2 } else { 1 }]);
        let output = run(&line);
        let found = serde_json::from_slice(&output.stdout);
        (
            output.status.code(),
            found.unwrap_or_else(|_| panic!("{}", said(&output))),
        )
    }

    /// Changes the bytes of the only object of a row, past the service.
    async fn spoil(&self, table: &str, spoil: Spoil) {
        let mut rows = match self.flags.first() {
            Some(flag) => Bare::postgres(flag.strip_prefix("--database=").unwrap()).await,
            None => Bare::sqlite(&self.data().join("meshway.db")).await,
        };
        let key = rows
            .texts(&format!("SELECT COALESCE(object, '') FROM {table}"))
            .await;
        let key = key.first().unwrap();
        let file = match &self.bucket {
            Some(bucket) => bucket.folder.join(key),
            None if table == "clouds" => {
                let sha256 = self.cloud["sha256"].as_str().unwrap();
                self.data().join("clouds").join(sha256)
            }
            None => {
                let mut content = Bare::sqlite(&self.data().join(CONTENT_FILE)).await;
                let statement = match spoil {
                    Spoil::Remove => format!("DELETE FROM chunks WHERE object = '{key}'"),
                    Spoil::Cut => format!(
                        "UPDATE chunks SET data = substr(data, 1, 9) WHERE object = '{key}'"
                    ),
                    Spoil::Change => format!(
                        "UPDATE chunks SET data = substr(data, 1, length(data) - 1) || x'07'
                         WHERE object = '{key}'"
                    ),
                };
                return content.run(&statement).await.unwrap();
            }
        };
        spoil.file(&file);
    }
}

#[derive(Clone, Copy)]
enum Spoil {
    Remove,
    Cut,
    Change,
}

impl Spoil {
    fn file(self, file: &Path) {
        let mut bytes = fs::read(file).unwrap();
        match self {
            Self::Remove => return fs::remove_file(file).unwrap(),
            Self::Cut => bytes.truncate(9),
            Self::Change => *bytes.last_mut().unwrap() ^= 1,
        }
        fs::write(file, bytes).unwrap();
    }
}

/// What was found, as kind and damage.
fn damage(found: &Value) -> Vec<(&str, &str)> {
    let findings = found["findings"].as_array().unwrap();
    let text = |value: &'_ Value| -> &'static str {
        match value.as_str().unwrap() {
            "cloud" => "cloud",
            "mesh" => "mesh",
            "model" => "model",
            "missing" => "missing",
            "size" => "size",
            "hash" => "hash",
            other => panic!("{other}"),
        }
    };
    let pair = |finding: &Value| (text(&finding["kind"]), text(&finding["damage"]));
    findings.iter().map(pair).collect()
}

async fn finds_all(kept: Kept) {
    // Beside the service.
    let (code, found) = kept.found(true);
    assert_eq!(code, Some(0), "{found}");
    assert_eq!(damage(&found), []);
    assert_eq!(found["rows"][0]["rows"], 1);
    assert!(found["rows"][1]["rows"].as_i64().unwrap() >= 1, "{found}");
    assert_eq!(found["left_over"], json!([]));

    kept.spoil("clouds", Spoil::Change).await;
    let (code, found) = kept.found(false);
    assert_eq!((code, damage(&found)), (Some(0), vec![]));
    let (code, found) = kept.found(true);
    assert_eq!((code, damage(&found)), (Some(1), vec![("cloud", "hash")]));
    kept.spoil("models", Spoil::Cut).await;
    let (code, found) = kept.found(false);
    assert_eq!((code, damage(&found)), (Some(1), vec![("model", "size")]));
    assert_eq!(found["findings"][0]["of"], kept.job["id"]);
    kept.spoil("models", Spoil::Remove).await;
    kept.spoil("clouds", Spoil::Remove).await;
    let (code, found) = kept.found(true);
    let both = vec![("cloud", "missing"), ("model", "missing")];
    assert_eq!((code, damage(&found)), (Some(1), both));
    let (code, told) = kept.check(&[]);
    assert_eq!(code, Some(1));
    for part in ["send it again", "is missing", "2 rows name them"] {
        assert!(told.contains(part), "{told}");
    }
    assert!(kept.server.terminate().await.success());
}

#[tokio::test]
async fn in_a_folder() {
    let kept = Kept::new(None, None).await;
    // Left over, but not until it is old.
    let sha256 = "0".repeat(64);
    let file = kept.data().join("clouds").join(&sha256);
    fs::write(&file, "left over").unwrap();
    let key = Uuid::now_v7().to_string();
    let mut content = Bare::sqlite(&kept.data().join(CONTENT_FILE)).await;
    let insert = format!("INSERT INTO objects (key, made_by, created_at) VALUES ('{key}', 'x', 1)");
    content.run(&insert).await.unwrap();
    let (code, found) = kept.found(false);
    assert_eq!(code, Some(0), "{found}");
    assert_eq!(found["left_over"], json!([{"place": key, "bytes": 0}]));
    let old = std::time::SystemTime::now() - std::time::Duration::from_hours(2);
    let open = fs::File::options().write(true).open(&file).unwrap();
    open.set_modified(old).unwrap();
    let (code, told) = kept.check(&[]);
    assert_eq!(code, Some(0), "{told}");
    assert!(
        told.contains("left over: 2") && told.contains(&sha256),
        "{told}"
    );
    fs::remove_file(file).unwrap();
    content
        .run(&format!("DELETE FROM objects WHERE key = '{key}'"))
        .await
        .unwrap();
    finds_all(kept).await;
}

#[tokio::test]
async fn in_a_database_and_a_bucket() {
    let (Some(database), Some(bucket)) = (new_database().await, Bucket::new()) else {
        return;
    };
    let kept = Kept::new(Some(database), Some(bucket.clone())).await;
    // One that another process may still be about to name is not left over.
    let key = Uuid::now_v7().to_string();
    fs::write(bucket.folder.join(&key), "new").unwrap();
    // One of long ago is.
    let old = "01890000-0000-7000-8000-000000000000";
    let file = bucket.folder.join(old);
    fs::write(&file, "old").unwrap();
    let open = fs::File::options().write(true).open(&file).unwrap();
    let age = std::time::Duration::from_hours(2);
    open.set_modified(std::time::SystemTime::now() - age)
        .unwrap();
    let (code, found) = kept.found(false);
    assert_eq!(code, Some(0), "{found}");
    assert_eq!(found["left_over"], json!([{"place": old, "bytes": 3}]));
    fs::remove_file(file).unwrap();
    finds_all(kept).await;
}

#[tokio::test]
async fn in_a_database_and_its_folder() {
    let Some(database) = new_database().await else {
        return;
    };
    let kept = Kept::new(Some(database), None).await;
    // Another folder has none of the bytes, and is not that of the database.
    let other = tempfile::tempdir().unwrap();
    let data = format!("--data-dir={}", other.path().display());
    let refused = run(&["check", &data, &kept.flags[0]]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(
        said(&refused).contains("another data folder"),
        "{}",
        said(&refused)
    );
    finds_all(kept).await;
}
