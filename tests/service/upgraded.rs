//! Tables of other versions: brought up to date by hand, and worked with though a newer program was there.

use std::path::Path;
use std::process::{Command, Output};
use std::time::Duration;

use meshway::jobs::{Error, Options, Store};
use serde_json::json;
use tokio_util::sync::CancellationToken;

use crate::http::support::sphere_xyz;
use crate::server::{PROGRAM, Server, job_ended};
use crate::store::bare::{self, Bare};
use crate::store::migrations::{TENTH, database};
use crate::wire::Connection;

/// Runs the program.
pub(crate) fn run(arguments: &[&str]) -> Output {
    Command::new(PROGRAM).args(arguments).output().unwrap()
}

pub(crate) fn said(output: &Output) -> String {
    let text = [&*output.stdout, &*output.stderr].concat();
    String::from_utf8(text).unwrap()
}

fn migrate(place: &str, check: bool) -> (Option<i32>, String) {
    let arguments = ["migrate", place, "--check"];
    let output = run(&arguments[..if check { 3 } else { 2 }]);
    (output.status.code(), said(&output))
}

#[tokio::test]
async fn a_folder_of_an_older_version_is_brought_up_to_date() {
    let folder = tempfile::tempdir().unwrap();
    let place = format!("--data-dir={}", folder.path().display());
    let (code, told) = migrate(&place, false);
    assert_eq!(code, Some(3), "{told}");
    assert!(
        told.contains("no service has worked in this folder"),
        "{told}"
    );

    drop(database(folder.path(), TENTH).await);
    let (code, told) = migrate(&place, true);
    assert_eq!(code, Some(1), "{told}");
    assert!(
        told.contains("at migration 10") && told.contains("`meshway migrate`"),
        "{told}"
    );
    let (code, told) = migrate(&place, false);
    assert_eq!(code, Some(0), "{told}");
    assert!(told.contains("from migration 10 to migration"), "{told}");
    for check in [true, false] {
        let (code, told) = migrate(&place, check);
        assert_eq!(code, Some(0), "{told}");
        assert!(told.contains("up to date"), "{told}");
    }
}

#[tokio::test]
async fn tables_are_not_brought_up_to_date_under_a_server() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    let _server = Server::start(&data, folder.path().join("log"), &[]).await;
    let place = format!("--data-dir={}", data.display());
    let (code, told) = migrate(&place, false);
    assert_eq!(code, Some(2), "{told}");
    assert!(
        told.contains("another server works in this folder"),
        "{told}"
    );
    assert_eq!(migrate(&place, true).0, Some(0));
}

#[tokio::test]
async fn a_new_database_gets_its_tables() {
    let Some(url) = bare::new_database().await else {
        return;
    };
    let place = format!("--database={url}");
    let (code, told) = migrate(&place, true);
    assert_eq!(code, Some(1), "{told}");
    assert!(told.contains("at migration 0"), "{told}");
    let (code, told) = migrate(&place, false);
    assert_eq!(code, Some(0), "{told}");
    assert!(told.contains("the tables are made"), "{told}");
    assert_eq!(migrate(&place, true).0, Some(0));
    let (code, told) = migrate("--database=postgres://nobody:secret@127.0.0.1:1/none", true);
    assert_eq!(code, Some(1), "{told}");
    assert!(!told.contains("secret"), "{told}");
}

/// What a program of a later version does before its first start.
const LATER: &str = "
    BEGIN;
    SELECT pg_advisory_xact_lock(5715126710434267);
    ALTER TABLE jobs ADD COLUMN of_later BIGINT NOT NULL DEFAULT 7;
    ALTER TABLE clouds ADD COLUMN of_later TEXT;
    CREATE TABLE of_later (id BIGINT PRIMARY KEY, job_id TEXT REFERENCES jobs (id) ON DELETE CASCADE);
    INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time)
        VALUES (9000, 'of later', TRUE, '\\x00', 0);
    COMMIT";

async fn submit(client: &mut Connection, cloud: &str) -> serde_json::Value {
    let job = json!({"cloud_id": cloud, "preset": "fast"});
    let answer = client.post("/v1/jobs", "", &job).await.unwrap();
    assert_eq!(answer.status, 202, "{}", answer.json());
    answer.json()
}

async fn serve(url: &str, folder: &Path, name: &str) -> Server {
    let database = format!("--database={url}");
    let flags = [&*database, "--workers=2", "--script=sleep:0.1"];
    Server::start(&folder.join("data"), folder.join(name), &flags).await
}

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn this_program_works_on_with_tables_of_a_later_one() {
    let Some(url) = bare::new_database().await else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let server = serve(&url, folder.path(), "first").await;
    let mut client = Connection::open(server.address()).await.unwrap();
    let bytes = sphere_xyz(300, 0.0).into_bytes();
    let cloud = client.ask("POST /v1/clouds", "", &[&bytes]).await.unwrap();
    let cloud = cloud.json()["id"].as_str().unwrap().to_owned();
    let end = CancellationToken::new();
    let (ended, address, of) = (end.clone(), server.address(), cloud.clone());
    let load = tokio::spawn(async move {
        let mut client = Connection::open(address).await.unwrap();
        let mut jobs = Vec::new();
        while !ended.is_cancelled() || jobs.len() < 4 {
            jobs.push(submit(&mut client, &of).await);
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
        jobs
    });

    let job = submit(&mut client, &cloud).await;
    job_ended(&mut client, &job).await;
    let mut db = Bare::postgres(&url).await;
    db.run(LATER).await.unwrap();
    let job = submit(&mut client, &cloud).await;
    let after = job_ended(&mut client, &job).await;
    assert_eq!(after["status"], "succeeded", "{after}");
    end.cancel();
    let jobs = load.await.unwrap();
    let last = job_ended(&mut client, jobs.last().unwrap()).await;
    assert_eq!(last["status"], "succeeded", "{last}\n{}", server.log());
    assert!(server.terminate().await.success());

    // It starts, too, and says what it sees.
    let server = serve(&url, folder.path(), "second").await;
    let mut client = Connection::open(server.address()).await.unwrap();
    for job in jobs.iter().take(2) {
        let path = job["links"]["self"].as_str().unwrap();
        let mesh = client.ask(&format!("GET {path}/mesh.ply"), "", &[]).await;
        assert_eq!(mesh.unwrap().status, 200);
    }
    let job = submit(&mut client, &cloud).await;
    assert_eq!(job_ended(&mut client, &job).await["status"], "succeeded");
    assert!(server.terminate().await.success());
    let (code, told) = migrate(&format!("--database={url}"), true);
    assert_eq!(code, Some(0), "{told}");
    assert!(
        told.contains("migration 9000, where a newer program"),
        "{told}"
    );

    // Unless they need a newer program.
    let least = "INSERT INTO meta (name, value) VALUES ('least_schema', '9000')";
    db.run(least).await.unwrap();
    let options = Options {
        database: Some(url.clone()),
        ..Options::default()
    };
    let opened = Store::open(&folder.path().join("data"), options).await;
    let refused = opened.err().unwrap();
    assert!(
        matches!(refused, Error::Newer { needs: 9000, .. }),
        "{refused}"
    );
    let data = format!("--data-dir={}", folder.path().join("data").display());
    let database = format!("--database={url}");
    let refused = run(&["serve", "--listen=127.0.0.1:0", &data, &database]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(
        said(&refused).contains("use a newer version of it"),
        "{}",
        said(&refused)
    );
    let (code, told) = migrate(&database, false);
    assert_eq!(code, Some(1), "{told}");
    // A number that this program knows is no hindrance.
    let least = "UPDATE meta SET value = '1' WHERE name = 'least_schema'";
    db.run(least).await.unwrap();
    assert_eq!(migrate(&database, true).0, Some(0));
}

#[test]
fn an_address_that_is_refused_is_not_repeated() {
    for (flag, reason) in [
        (
            "--database=postgre://ann:secret@db.example/x",
            "the scheme is postgre",
        ),
        ("--database=postgres://ann:secret@:bad:/x", "must be as in"),
        ("--database=postgres://ann:secret@[db/x", "must be as in"),
        ("--objects=s3://ann:secret@bucket", "environment"),
        (
            "--objects=s3://bucket?endpoint=http://ann:secret@b",
            "endpoint",
        ),
        ("--objects=s3://bucket?secret=1", "is unknown"),
    ] {
        for command in ["serve", "check"] {
            let refused = run(&[command, flag]);
            let told = said(&refused);
            assert_eq!(refused.status.code(), Some(2), "{told}");
            assert!(told.contains(reason), "{told}");
            let repeated = told.contains("secret@") || told.contains("ann:");
            assert!(!repeated, "{told}");
        }
    }
    let output = Command::new(PROGRAM)
        .arg("serve")
        .env("MESHWAY_DATABASE", "postgre://ann:secret@db.example/x")
        .output();
    let told = said(&output.unwrap());
    assert!(
        told.contains("--database") && !told.contains("secret"),
        "{told}"
    );
}
