//! Texts that may name somebody are in no file of the data folder, and in no line of the log.

use std::fs;

use serde_json::{Value, json};

use crate::erasure::holds;
use crate::http::contract::expect_named;
use crate::http::support::{gzip, sphere_xyz};
use crate::medical_jobs::{label_map, of_a_patient};
use crate::server::{Folder, Server};
use crate::wire::{Answer, Connection};

/// As the structure set of the other tests has it.
const NAME: &str = "Zwiebelfisch^Adalberta";

async fn post(server: &Server, path: &str, headers: &str, body: &[u8]) -> Answer {
    let mut connection = Connection::open(server.address()).await.unwrap();
    let request = format!("POST {path}");
    connection.ask(&request, headers, &[body]).await.unwrap()
}

async fn ask(server: &Server, request: &str) -> Answer {
    let mut connection = Connection::open(server.address()).await.unwrap();
    connection.ask(request, "", &[]).await.unwrap()
}

fn is_named(folder: &Folder) -> bool {
    holds(folder.path(), NAME.as_bytes())
}

/// A sphere in PLY, whose comment names somebody.
fn commented(points: usize, shift: f64) -> Vec<u8> {
    let rows = sphere_xyz(points, shift);
    let count = rows.lines().count();
    format!(
        "ply\nformat ascii 1.0\ncomment {NAME} SPACE=LPS\nelement vertex {count}\nproperty float x\n\
         property float y\nproperty float z\nend_header\n{rows}"
    )
    .into_bytes()
}

/// A label map whose description names somebody.
fn described() -> Vec<u8> {
    let mut file = label_map(1);
    file[148..148 + NAME.len()].copy_from_slice(NAME.as_bytes());
    file
}

/// A form of parts, each with its name, the name of its file, and its content.
fn form(parts: &[(&str, &str, &[u8])]) -> Vec<u8> {
    let mut body = Vec::new();
    for (name, file, content) in parts {
        let file = match *file {
            "" => String::new(),
            file => format!("; filename=\"{file}\""),
        };
        let head = format!("--XX\r\nContent-Disposition: form-data; name=\"{name}\"{file}\r\n\r\n");
        body.extend(head.as_bytes());
        body.extend(*content);
        body.extend(b"\r\n");
    }
    body.extend(b"--XX--\r\n");
    body
}

const FORM: &str = "Content-Type: multipart/form-data; boundary=XX\r\n";

#[tokio::test]
async fn a_file_is_kept_without_its_texts_unless_asked() {
    let folder = Folder::new().await;
    let server = folder.serve(&[]).await;
    let table = format!("# {NAME}\n{}", sphere_xyz(100, 0.0));
    for file in [
        commented(100, 0.0),
        // More than is read in the process of the service itself.
        commented(40_000, 0.0),
        gzip(table.as_bytes()),
        described(),
        gzip(&described()),
        of_a_patient(),
    ] {
        let answer = post(&server, "/v1/clouds", "", &file).await;
        assert_eq!(answer.status, 201, "{:?}", answer.json());
        assert!(!is_named(&folder));
        let cloud = answer.json();
        expect_named("Cloud", &cloud);
        assert!(cloud["dropped_texts"].as_u64() >= Some(1), "{cloud}");
        let own = format!("/v1/clouds/{}", cloud["id"].as_str().unwrap());
        let content = ask(&server, &format!("GET {own}/content")).await.body;
        assert_eq!(cloud["bytes"], content.len());
        let kept = folder
            .path()
            .join("clouds")
            .join(cloud["sha256"].as_str().unwrap());
        assert_eq!(fs::read(kept).unwrap(), content);
        // Both what was sent and what is kept are known.
        for bytes in [&file, &content] {
            let again = post(&server, "/v1/clouds", "", bytes).await;
            assert_eq!((again.status, &again.json()), (200, &cloud));
        }

        let asked = post(&server, "/v1/clouds?keep=identifiers", "", &file).await;
        assert_eq!(asked.status, 201, "{:?}", asked.json());
        let asked = asked.json();
        assert_eq!(asked["dropped_texts"], 0);
        for member in ["points", "bounds", "segmentation", "warnings", "frame"] {
            assert_eq!(asked[member], cloud[member], "{member}");
        }
        let own = format!("/v1/clouds/{}", asked["id"].as_str().unwrap());
        assert_eq!(ask(&server, &format!("GET {own}/content")).await.body, file);
        let again = post(&server, "/v1/clouds", "", &file).await;
        assert_eq!((again.status, &again.json()["id"]), (200, &cloud["id"]));
        assert_eq!(ask(&server, &format!("DELETE {own}")).await.status, 204);
        assert!(!is_named(&folder));
    }
    assert_eq!(fs::read_dir(folder.path().join("tmp")).unwrap().count(), 0);
}

#[tokio::test]
async fn what_is_kept_as_it_was_sent_is_not_what_is_kept_without_texts() {
    let folder = Folder::new().await;
    let server = folder.serve(&[]).await;
    let file = commented(100, 0.0);
    let asked = post(&server, "/v1/clouds?keep=identifiers", "", &file).await;
    let plain = post(&server, "/v1/clouds", "", &file).await;
    assert_eq!((asked.status, plain.status), (201, 201));
    assert_ne!(asked.json()["id"], plain.json()["id"]);
    // Without texts there is no difference.
    let bare = sphere_xyz(100, 1.0);
    let asked = post(&server, "/v1/clouds?keep=identifiers", "", bare.as_bytes()).await;
    let plain = post(&server, "/v1/clouds", "", bare.as_bytes()).await;
    assert_eq!((asked.status, plain.status), (201, 200));
    assert_eq!(asked.json()["id"], plain.json()["id"]);
}

#[tokio::test]
async fn refused_files_leave_nothing() {
    let folder = Folder::new().await;
    let server = folder.serve(&[]).await;
    let mut unplaced = described();
    unplaced[254] = 0;
    for file in [&commented(2, 0.0), &commented(100, 0.0)[..300], &unplaced] {
        let answer = post(&server, "/v1/clouds", "", file).await;
        assert_eq!(answer.status, 422, "{:?}", answer.json());
    }
    assert!(!is_named(&folder));
    for place in ["tmp", "clouds"] {
        let files = fs::read_dir(folder.path().join(place)).unwrap();
        let ours = |entry: &fs::DirEntry| {
            let name = entry.file_name();
            // The folder has a cloud to begin with.
            place == "tmp"
                || !name
                    .to_string_lossy()
                    .chars()
                    .all(|c| c.is_ascii_hexdigit())
        };
        assert_eq!(files.map(Result::unwrap).filter(ours).count(), 0, "{place}");
    }
}

#[tokio::test]
async fn batches_forms_and_uploads_in_parts_drop_texts_too() {
    let folder = Folder::new().await;
    let server = folder.serve(&[]).await;
    let settings = json!({"training": {"max_evaluations": 60}, "surface": {"resolution": 32}});
    let request = |what: &str| {
        json!({"preset": "fast", "settings": settings, "labels": {"study": what}}).to_string()
    };
    let (first, second, third) = (
        commented(200, 0.0),
        commented(200, 1.0),
        commented(200, 2.0),
    );
    let request_of_batch = request("batch-of-Zwiebel");
    let body = form(&[
        ("request", "", request_of_batch.as_bytes()),
        ("cloud", "zwiebelfisch-1.ply", &first),
        ("cloud", "zwiebelfisch-2.ply", &second),
    ]);
    let batch = post(&server, "/v1/batches", FORM, &body).await;
    assert_eq!(batch.status, 202, "{:?}", batch.json());
    assert!(!is_named(&folder));

    let complete = "Upload-Complete: ?1\r\nContent-Type: application/octet-stream\r\n";
    let upload = post(&server, "/v1/uploads", complete, &third).await;
    assert_eq!(upload.status, 201, "{:?}", upload.json());
    assert!(!is_named(&folder));
    assert_eq!(upload.json()["dropped_texts"], 1);
    let again = post(&server, "/v1/clouds", "", &third).await;
    assert_eq!(
        (again.status, &again.json()["id"]),
        (200, &upload.json()["id"])
    );

    let request_of_job = request("job-of-Zwiebel");
    let body = form(&[
        ("job", "", request_of_job.as_bytes()),
        ("file", "zwiebelfisch-3.ply", &third),
    ]);
    let headers = format!("{FORM}Prefer: wait=120\r\n");
    let job = post(&server, "/v1/jobs", &headers, &body).await.json();
    assert_eq!(job["status"], "succeeded", "{job}");
    assert_eq!(job["cloud_id"], upload.json()["id"]);
    assert!(!is_named(&folder));
    let log = server.log();
    assert!(log.contains("/v1/batches"), "the log has the requests");
    for word in ["Zwiebel", "zwiebel"] {
        assert!(!log.contains(word), "{log}");
    }
}

#[tokio::test]
async fn files_of_earlier_versions_stay_as_they_are() {
    let folder = Folder::new().await;
    let server = folder.serve(&[]).await;
    let file = commented(100, 0.0);
    let old = post(&server, "/v1/clouds?keep=identifiers", "", &file)
        .await
        .json();
    // Rows of earlier versions do not tell it.
    let mut connection = folder.connection().await;
    let removed =
        "UPDATE clouds SET summary = json_remove(summary, '$.dropped_texts', '$.cleaned')";
    sqlx::query(removed).execute(&mut connection).await.unwrap();
    let own = format!("/v1/clouds/{}", old["id"].as_str().unwrap());
    let shown: Value = ask(&server, &format!("GET {own}")).await.json();
    assert_eq!(shown, old);
    let new = post(&server, "/v1/clouds", "", &file).await;
    assert_eq!((new.status, &new.json()["dropped_texts"]), (201, &json!(1)));
    assert_eq!(ask(&server, &format!("GET {own}/content")).await.body, file);
}
