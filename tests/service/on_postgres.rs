//! A service with its rows in Postgres, from upload to mesh, over the death of the database server.

use std::net::SocketAddr;
use std::time::Duration;

use serde_json::{Value, json};
use tokio_util::sync::CancellationToken;

use crate::http::support::sphere_xyz;
use crate::postgres::Postgres;
use crate::server::{PATIENCE, Server, job_ended, until};
use crate::store::bare;
use crate::wire::Connection;

async fn get(address: SocketAddr, path: &str) -> (u16, Value) {
    let mut client = Connection::open(address).await.unwrap();
    let answer = client.ask(&format!("GET {path}"), "", &[]).await.unwrap();
    (answer.status, answer.json())
}

/// Submits jobs one after the other until the end; the ids of those that were taken.
async fn submit(address: SocketAddr, cloud: String, end: CancellationToken) -> Vec<String> {
    let mut taken = Vec::new();
    while !end.is_cancelled() {
        let mut client = Connection::open(address).await.unwrap();
        let job = json!({"cloud_id": cloud, "preset": "fast"});
        let answer = client.post("/v1/jobs", "", &job).await.unwrap();
        match answer.status {
            202 => taken.push(answer.json()["id"].as_str().unwrap().to_owned()),
            status => assert_eq!(status, 503, "{}", answer.json()),
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    taken
}

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn the_database_dies_and_nothing_is_lost() {
    if bare::server().is_none() {
        return;
    }
    let database = Postgres::new();
    let dir = tempfile::tempdir().unwrap();
    let url = format!("--database={}", database.url);
    let flags = [url.as_str(), "--script=sleep:8"];
    let server = Server::start(&dir.path().join("data"), dir.path().join("log"), &flags).await;
    let address = server.address();
    let mut client = Connection::open(address).await.unwrap();
    let cloud = sphere_xyz(300, 0.0).into_bytes();
    let answer = client.ask("POST /v1/jobs?preset=fast", "", &[&cloud]).await;
    let job = answer.unwrap().json();
    let path = job["links"]["self"].as_str().unwrap();
    until("the job runs", PATIENCE, async || {
        let (_, job) = get(address, path).await;
        (job["progress"].as_f64()? > 0.1).then_some(())
    })
    .await;

    let end = CancellationToken::new();
    let cloud = job["cloud_id"].as_str().unwrap().to_owned();
    let submitters = [(); 4].map(|()| tokio::spawn(submit(address, cloud.clone(), end.clone())));
    tokio::time::sleep(Duration::from_millis(500)).await;
    database.kill();
    until(
        "the service says that it is not ready",
        PATIENCE,
        async || {
            let (status, _) = get(address, "/readyz").await;
            (status == 503).then_some(())
        },
    )
    .await;
    database.revive().await;
    until("it is ready again", PATIENCE, async || {
        let (status, _) = get(address, "/readyz").await;
        (status == 200).then_some(())
    })
    .await;
    end.cancel();
    let mut taken = Vec::new();
    for submitter in submitters {
        taken.extend(submitter.await.unwrap());
    }
    assert!(!taken.is_empty());
    for id in taken {
        let (status, found) = get(address, &format!("/v1/jobs/{id}")).await;
        assert_eq!((status, &found["id"]), (200, &json!(id)));
    }

    let ended = job_ended(&mut client, &job).await;
    assert_eq!(
        (&ended["status"], &ended["attempt"], &ended["failures"]),
        (&json!("succeeded"), &json!(1), &json!(0)),
        "{ended}\n{}",
        server.log()
    );
    let mut client = Connection::open(address).await.unwrap();
    let mesh = format!("GET {path}/mesh.ply");
    assert_eq!(client.ask(&mesh, "", &[]).await.unwrap().status, 200);
    client
        .send(&format!("GET {path}/events"), "", &[])
        .await
        .unwrap();
    client.read_head().await.unwrap();
    let mut ids: Vec<i64> = Vec::new();
    loop {
        let line = client.read_line().await.unwrap();
        ids.extend(
            line.strip_prefix("id: ")
                .map(|id| id.parse::<i64>().unwrap()),
        );
        if line == "event: job.succeeded" {
            break;
        }
    }
    assert!(ids.len() > 10);
    assert_eq!(ids, (1..=ids.len() as i64).collect::<Vec<_>>());
    assert!(
        !server.log().contains("an attempt failed"),
        "{}",
        server.log()
    );
}
