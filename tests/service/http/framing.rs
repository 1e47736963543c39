//! What the wire carries around requests: what is none, how large a head is, bodies that nobody reads.

use std::net::SocketAddr;

use serde_json::Value;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

use crate::server::Folder;

/// All that is answered to these bytes, until the server ends the connection.
async fn answer(address: SocketAddr, request: &[u8]) -> String {
    let mut stream = TcpStream::connect(address).await.unwrap();
    stream.write_all(request).await.unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).await.unwrap();
    String::from_utf8(answer).unwrap()
}

/// Its status and its problem.
fn problem(answer: &str) -> (u16, Value) {
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    assert!(
        head.contains("content-type: application/problem+json"),
        "{answer}"
    );
    let length = format!("content-length: {}", body.len());
    assert!(head.contains(&length), "{answer}");
    let status = head.split(' ').nth(1).unwrap().parse().unwrap();
    (status, serde_json::from_str(body).unwrap())
}

/// A request for `/livez` whose head has so many bytes.
fn request(bytes: usize) -> Vec<u8> {
    let head = "GET /livez HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nX: \r\n\r\n";
    let filling = "a".repeat(bytes - head.len());
    head.replace("X: ", &format!("X: {filling}")).into_bytes()
}

#[tokio::test]
async fn what_is_no_request_gets_a_problem_too() {
    let folder = Folder::new().await;
    let server = folder.serve(&[]).await;
    for wrong in [
        "GET /livez?a={} HTTP/9\r\n\r\n",
        "GET /v1/jobs?x={\"a\":1} HTTP/1.1\r\nHost: localhost\r\n\r\n",
        "POST /v1/clouds HTTP/1.1\r\nHost: localhost\r\nContent-Length: +5\r\n\r\n12345",
        "\u{16}\u{3}\u{1} hello\r\n\r\n",
    ] {
        let answer = answer(server.address(), wrong.as_bytes()).await;
        let (status, problem) = problem(&answer);
        assert_eq!(
            (status, &problem["code"]),
            (400, &"malformed_request".into())
        );
        assert_eq!(problem["status"], 400, "{wrong}");
    }
    // After an answer of ours on the same connection, too.
    let twice = "GET /livez HTTP/1.1\r\nHost: localhost\r\n\r\n";
    let mut stream = TcpStream::connect(server.address()).await.unwrap();
    stream.write_all(twice.as_bytes()).await.unwrap();
    let mut start = [0; 12];
    stream.read_exact(&mut start).await.unwrap();
    assert_eq!(&start, b"HTTP/1.1 200");
    stream.write_all(b"nonsense\r\n\r\n").await.unwrap();
    let mut rest = String::new();
    stream.read_to_string(&mut rest).await.unwrap();
    assert!(rest.contains("malformed_request"), "{rest}");
}

#[tokio::test]
async fn a_head_ends_exactly_at_its_limit() {
    let folder = Folder::new().await;
    let server = folder.serve(&[]).await;
    let status = answer(server.address(), &request(65_536)).await;
    assert!(status.starts_with("HTTP/1.1 200"), "{status}");
    // Read whole and counted; and far too large to be read.
    for bytes in [65_537, 100_000, 400_000] {
        let answer = answer(server.address(), &request(bytes)).await;
        let (status, problem) = problem(&answer);
        assert_eq!((status, &problem["code"]), (431, &"head_too_large".into()));
    }
}

#[tokio::test]
async fn a_request_names_one_host() {
    let folder = Folder::new().await;
    let server = folder.serve(&[]).await;
    for (hosts, expected) in [
        ("", 400),
        ("Host: localhost\r\n", 200),
        ("Host: localhost\r\nHost: localhost\r\n", 400),
    ] {
        let request = format!("GET /livez HTTP/1.1\r\nConnection: close\r\n{hosts}\r\n");
        let answer = answer(server.address(), request.as_bytes()).await;
        assert!(
            answer.starts_with(&format!("HTTP/1.1 {expected}")),
            "{answer}"
        );
    }
    let old = answer(server.address(), b"GET /livez HTTP/1.0\r\n\r\n").await;
    assert!(old.starts_with("HTTP/1.0 200"), "{old}");
}

#[tokio::test]
async fn who_writes_on_reads_why_it_was_refused() {
    const BODY: usize = 32 << 20;
    let piece = vec![b'1'; 1 << 16];
    let folder = Folder::new().await;
    let server = folder.serve(&[]).await;
    for (header, length, expected) in [
        ("", 600 << 20, 413),
        ("Content-Encoding: br\r\n", BODY, 415),
        ("Origin: http://evil.example\r\n", BODY, 403),
    ] {
        let mut stream = TcpStream::connect(server.address()).await.unwrap();
        let head = format!(
            "POST /v1/clouds HTTP/1.1\r\nHost: localhost\r\nContent-Length: {length}\r\n{header}\r\n"
        );
        stream.write_all(head.as_bytes()).await.unwrap();
        // Without a look at what comes back.
        for _ in 0..BODY >> 16 {
            stream.write_all(&piece).await.unwrap();
        }
        stream.shutdown().await.unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).await.unwrap();
        let answer = String::from_utf8(answer).unwrap();
        assert!(
            answer.starts_with(&format!("HTTP/1.1 {expected}")),
            "{answer}"
        );
    }
}
