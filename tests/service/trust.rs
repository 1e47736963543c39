//! Keys and the audit trail as an operator has them: the file, the signal, the command line.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use meshway::jobs::{Options, Store};
use rustix::process::{Signal, kill_process};
use serde_json::Value;
use tempfile::TempDir;

use crate::http::support::sphere_xyz;
use crate::server::{PATIENCE, PROGRAM, Server, until};
use crate::wire::Connection;

fn meshway(arguments: &[&str]) -> Output {
    Command::new(PROGRAM).args(arguments).output().unwrap()
}

fn succeed(arguments: &[&str]) -> String {
    let output = meshway(arguments);
    assert!(output.status.success(), "{arguments:?}: {output:?}");
    String::from_utf8(output.stdout).unwrap()
}

/// A new key and its block for the file.
fn new_key(name: &str, scopes: &str, more: &[&str]) -> (String, String) {
    let arguments = [
        "key",
        "new",
        "--name",
        name,
        "--tenant=radiology",
        "--scopes",
        scopes,
    ];
    let text = succeed(&[&arguments, more].concat());
    let (key, block) = text.split_once("\n\n").unwrap();
    assert!(!block.contains(key), "{block}");
    (key.to_owned(), block.to_owned())
}

fn bearer(key: &str) -> String {
    format!("Authorization: Bearer {key}\r\n")
}

async fn status(server: &Server, key: &str, line: &str) -> u16 {
    let mut client = Connection::open(server.address()).await.unwrap();
    let answer = client.ask(line, &bearer(key), &[]).await.unwrap();
    answer.status
}

async fn start(folder: &TempDir, run: usize) -> Server {
    let config = format!("--config={}", folder.path().join("clinic.toml").display());
    let log = folder.path().join(format!("log.{run}"));
    Server::start(&folder.path().join("data"), log, &[&config]).await
}

fn audit(folder: &Path, arguments: &[&str]) -> Output {
    let data = format!("--data-dir={}", folder.join("data").display());
    meshway(&[&["audit", &data], arguments].concat())
}

#[tokio::test]
async fn keys_come_from_the_file_and_go_with_a_signal() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("clinic.toml");
    let (pacs, pacs_block) = new_key("pacs", "read,write", &[]);
    let (anna, anna_block) = new_key(
        "anna",
        "read",
        &["--networks=127.0.0.0/8", "--expires=2999-12-31"],
    );
    fs::write(&file, format!("workers = 1\n{pacs_block}")).unwrap();
    let server = start(&folder, 0).await;
    assert_eq!(status(&server, &pacs, "GET /v1/jobs").await, 200);
    assert_eq!(status(&server, &anna, "GET /v1/jobs").await, 401);
    let reload = async |text: &str, said: &str| {
        let before = server.log().matches(said).count();
        fs::write(&file, text).unwrap();
        kill_process(server.pid(), Signal::HUP).unwrap();
        until("the file is read", PATIENCE, async || {
            (server.log().matches(said).count() > before).then_some(())
        })
        .await;
    };
    reload(
        &format!("workers = 1\n{anna_block}"),
        "the keys were read again",
    )
    .await;
    assert_eq!(status(&server, &pacs, "GET /v1/jobs").await, 401);
    assert_eq!(status(&server, &anna, "GET /v1/jobs").await, 200);
    // A fault changes nothing, and neither does a file without keys.
    for wrong in ["[[keys]]\nname = 1\n", "workers = 1\n"] {
        reload(wrong, "the keys stay as they were").await;
        assert_eq!(status(&server, &anna, "GET /v1/jobs").await, 200);
        assert_eq!(status(&server, "", "GET /v1/jobs").await, 401);
    }
    assert_eq!(status(&server, "", "GET /livez").await, 200);
    let log = server.log();
    for key in [&pacs, &anna] {
        assert!(!log.contains(&key[3..]), "{log}");
    }
    assert!(server.terminate().await.success());
}

#[tokio::test]
async fn a_key_of_one_network_is_good_behind_a_trusted_proxy() {
    let folder = TempDir::new().unwrap();
    let (anna, block) = new_key("anna", "read", &["--networks=203.0.113.0/24"]);
    fs::write(folder.path().join("clinic.toml"), block).unwrap();
    let asked = async |server: &Server, forwarded: &str| {
        let head = format!("{}X-Forwarded-For: {forwarded}\r\n", bearer(&anna));
        let mut client = Connection::open(server.address()).await.unwrap();
        let answer = client.ask("GET /v1/jobs", &head, &[]).await.unwrap();
        answer.status
    };
    let server = start(&folder, 0).await;
    assert_eq!(asked(&server, "203.0.113.7").await, 401);
    assert!(server.terminate().await.success());

    let config = folder.path().join("clinic.toml");
    let block = fs::read_to_string(&config).unwrap();
    fs::write(
        &config,
        format!("trusted_proxies = \"127.0.0.1/32\"\n{block}"),
    )
    .unwrap();
    let server = start(&folder, 1).await;
    assert_eq!(asked(&server, "203.0.113.7").await, 200);
    // What the client itself wrote before the proxy added its address.
    assert_eq!(asked(&server, "203.0.113.7, 198.51.100.4").await, 401);
    assert_eq!(status(&server, &anna, "GET /v1/jobs").await, 401);
    let log = server.log();
    assert!(log.contains("client.address=203.0.113.7"), "{log}");
    assert!(server.terminate().await.success());
    let output = audit(folder.path(), &["export"]);
    let rows = String::from_utf8(output.stdout).unwrap();
    assert!(rows.contains("198.51.100.4"), "{rows}");
}

#[tokio::test]
async fn a_file_of_keys_with_a_fault_is_refused_at_the_start() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("clinic.toml");
    fs::write(
        &file,
        "[[keys]]\nname = \"a\"\nhash = \"x\"\nscopes = [\"read\"]\n",
    )
    .unwrap();
    let output = meshway(&["serve", "--config", file.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2));
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(
        message.contains("keys[0] (a): a hash has the form"),
        "{message}"
    );
    let output = meshway(&["serve", "--listen=0.0.0.0:0"]);
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(message.contains("meshway key new"), "{message}");
}

/// How often the service is killed; `make soak-audit` asks for more.
fn kills() -> usize {
    let asked = std::env::var_os("MESHWAY_AUDIT_KILLS");
    asked.map_or(4, |asked| asked.to_str().unwrap().parse().unwrap())
}

#[tokio::test]
async fn every_answer_has_its_row_once_however_the_service_dies() {
    let folder = TempDir::new().unwrap();
    let (pacs, block) = new_key("pacs", "read,write", &[]);
    fs::write(folder.path().join("clinic.toml"), block).unwrap();
    let mut answered = Vec::new();
    for run in 0..kills() {
        let server = start(&folder, run).await;
        let mut uploads = Vec::new();
        for client in 0..4 {
            let (address, headers) = (server.address(), bearer(&pacs));
            uploads.push(tokio::spawn(async move {
                let mut kept = Vec::new();
                let mut client_connection = Connection::open(address).await.unwrap();
                // Until the service dies, each with bytes of its own.
                for i in 0.. {
                    let shift = f64::from(run as u32 * 20_000 + client * 5_000 + i);
                    let cloud = sphere_xyz(30, shift);
                    let sent = client_connection
                        .ask("POST /v1/clouds", &headers, &[cloud.as_bytes()])
                        .await;
                    match sent {
                        Ok(answer) if answer.status == 201 => {
                            kept.push(answer.json()["id"].as_str().unwrap().to_owned());
                        }
                        Ok(answer) => panic!("{answer:?}"),
                        Err(_) => break,
                    }
                }
                kept
            }));
        }
        let store = Store::open(&folder.path().join("data"), Options::default())
            .await
            .unwrap();
        let before = store.audit_head().await.unwrap().seq;
        until("some are noted", PATIENCE, async || {
            (store.audit_head().await.unwrap().seq >= before + 10).then_some(())
        })
        .await;
        store.close().await;
        kill_process(server.pid(), Signal::KILL).unwrap();
        for upload in uploads {
            answered.extend(upload.await.unwrap());
        }
    }
    let output = audit(folder.path(), &["verify"]);
    assert!(output.status.success(), "{output:?}");
    let store = Store::open(&folder.path().join("data"), Options::default())
        .await
        .unwrap();
    let rows = store.audit_after(0, 1_000_000).await.unwrap();
    let noted: Vec<_> = rows.iter().map(|row| row.object.as_str()).collect();
    for id in &answered {
        assert_eq!(noted.iter().filter(|noted| *noted == id).count(), 1, "{id}");
    }
    assert!(answered.len() >= 36, "{}", answered.len());
    store.close().await;

    // What is exported is what was noted, in each form.
    let text = |format: &str| {
        let output = audit(folder.path(), &["export", "--format", format]);
        assert!(output.status.success(), "{output:?}");
        String::from_utf8(output.stdout).unwrap()
    };
    let lines = text("ndjson");
    assert_eq!(lines.lines().count(), rows.len());
    let first: Value = serde_json::from_str(lines.lines().next().unwrap()).unwrap();
    assert_eq!(first["hash"], rows[0].hash);
    assert_eq!(text("csv").lines().count(), rows.len() + 1);
    let bundle: Value = serde_json::from_str(&text("fhir")).unwrap();
    assert_eq!(bundle["entry"].as_array().unwrap().len(), rows.len());
    let event = &bundle["entry"][0]["resource"];
    assert_eq!(
        (&event["resourceType"], &event["action"]),
        (&"AuditEvent".into(), &"C".into())
    );
    // A head that was never there.
    let head = format!("--head=1:{}", "0".repeat(64));
    let output = audit(folder.path(), &["verify", &head]);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
}

#[test]
fn a_folder_without_a_service_has_no_trail() {
    let folder = TempDir::new().unwrap();
    let output = audit(folder.path(), &["verify"]);
    assert_eq!(output.status.code(), Some(3), "{output:?}");
}
