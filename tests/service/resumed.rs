//! Uploads over servers and clients that are killed.

use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

use crate::http::support::sphere_xyz;
use crate::server::Server;
use crate::wire::Connection;

/// Kills of the server.
const KILLS: usize = 25;

#[tokio::test]
async fn an_upload_goes_on_over_servers_and_clients_that_are_killed() {
    let dir = tempfile::tempdir().unwrap();
    let bytes = sphere_xyz(60_000, 0.0).into_bytes();
    let mut random = ChaCha8Rng::seed_from_u64(9);
    let start = async |k: usize| {
        let log = dir.path().join(format!("log.{k}"));
        Server::start(&dir.path().join("data"), log, &[]).await
    };
    let mut server = start(0).await;
    let mut client = Connection::open(server.address()).await.unwrap();
    let begin = "Tus-Resumable: 1.0.0\r\n";
    let length = format!("{begin}Upload-Length: {}\r\n", bytes.len());
    client.send("POST /v1/uploads", &length, &[]).await.unwrap();
    let mut upload = None;
    loop {
        let line = client.read_line().await.unwrap();
        if let Some(location) = line.strip_prefix("location: ") {
            upload = Some(location.to_owned());
        }
        if line.is_empty() {
            break;
        }
    }
    let upload = upload.unwrap();
    let state = async |server: &Server| -> Value {
        let mut client = Connection::open(server.address()).await.unwrap();
        // HEAD has no body that this client could read: an empty GET follows the cut.
        client
            .ask(&format!("GET {upload}"), "", &[])
            .await
            .unwrap()
            .json()
    };
    let mut told = 0;
    for k in 1..=KILLS {
        let at = state(&server).await["offset"].as_u64().unwrap() as usize;
        assert!(at >= told, "{at} after {told} was told");
        told = at;
        let mut client = Connection::open(server.address()).await.unwrap();
        let headers = format!(
            "{begin}Content-Type: application/offset+octet-stream\r\nUpload-Offset: {at}\r\n"
        );
        // A part of what it announces; sometimes the server dies first, sometimes the client.
        let end = (at + random.random_range(1..=bytes.len() / KILLS)).min(bytes.len());
        let pieces: Vec<&[u8]> = bytes[at..end].chunks(1_024).collect();
        let line = format!("PATCH {upload}");
        let wait = Duration::from_micros(random.random_range(0..4_000));
        if k % 2 == 0 {
            let whole = client.ask(&line, &headers, &pieces).await.unwrap();
            assert!(
                whole.status == 204 || whole.status == 409,
                "{}",
                whole.status
            );
            told = told.max(if whole.status == 204 { end } else { at });
        } else {
            let sending = client.send(&line, &headers, &pieces);
            let _ = tokio::time::timeout(wait, sending).await;
        }
        drop(server);
        server = start(k).await;
    }
    let at = state(&server).await["offset"].as_u64().unwrap() as usize;
    assert!(at >= told && at < bytes.len());
    let mut client = Connection::open(server.address()).await.unwrap();
    let headers =
        format!("{begin}Content-Type: application/offset+octet-stream\r\nUpload-Offset: {at}\r\n");
    let line = format!("PATCH {upload}");
    let last = client.ask(&line, &headers, &[&bytes[at..]]).await.unwrap();
    assert_eq!(last.status, 204, "{}", last.json());
    let cloud = state(&server).await["links"]["cloud"]
        .as_str()
        .unwrap()
        .to_owned();
    let content = client
        .ask(&format!("GET {cloud}/content"), "", &[])
        .await
        .unwrap();
    assert_eq!(content.body, bytes);
}
