//! People as an operator has them: the command line, the file, the signal.

use std::fs;
use std::io::Write;
use std::process::{Command, Output, Stdio};

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use rustix::process::{Signal, kill_process};

use crate::server::{PATIENCE, PROGRAM, Server, until};
use crate::wire::Connection;

fn passwd(arguments: &[&str], password: &str) -> Output {
    let mut child = Command::new(PROGRAM)
        .args(["user", "passwd"])
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut input = child.stdin.take().unwrap();
    input.write_all(format!("{password}\n").as_bytes()).unwrap();
    drop(input);
    child.wait_with_output().unwrap()
}

fn block(password: &str) -> String {
    let made = passwd(&["anna", "--tenant=radiology"], password);
    assert!(made.status.success(), "{made:?}");
    let block = String::from_utf8(made.stdout).unwrap();
    assert!(!block.contains(password), "{block}");
    block
}

#[tokio::test]
async fn a_password_of_the_command_line_signs_in_until_the_file_has_another_one() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("clinic.toml");
    fs::write(&file, block("correct horse")).unwrap();
    let config = format!("--config={}", file.display());
    let log = folder.path().join("log");
    let server = Server::start(&folder.path().join("data"), log, &[&config]).await;
    let sign_in = async |password: &str| {
        let pair = BASE64_STANDARD.encode(format!("anna:{password}"));
        let head = format!("Authorization: Basic {pair}\r\n");
        let mut client = Connection::open(server.address()).await.unwrap();
        client.ask("POST /v1/session", &head, &[]).await.unwrap()
    };
    assert_eq!(sign_in("battery staple").await.status, 401);
    assert_eq!(sign_in("correct horse").await.status, 204);

    fs::write(&file, block("battery staple")).unwrap();
    kill_process(server.pid(), Signal::HUP).unwrap();
    until("the keys were read again", PATIENCE, async || {
        server
            .log()
            .contains("the keys were read again")
            .then_some(())
    })
    .await;
    assert_eq!(sign_in("correct horse").await.status, 401);
    assert_eq!(sign_in("battery staple").await.status, 204);
    let log = server.log();
    for secret in ["correct horse", "battery staple", "argon2id"] {
        assert!(!log.contains(secret), "{log}");
    }
}

#[test]
fn passwords_that_are_too_short_are_refused() {
    let refused = passwd(&["anna"], "short");
    assert_eq!(refused.status.code(), Some(2));
    let said = String::from_utf8(refused.stderr).unwrap();
    assert!(said.contains("at least 8 characters"), "{said}");
    assert!(refused.stdout.is_empty());
}
