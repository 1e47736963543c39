//! Idle workers fit blocks of a large job: the result is that of one worker alone.

use std::fmt::Write as _;
use std::net::SocketAddr;

use rustix::process::{Signal, kill_process};
use serde_json::{Value, json};

use crate::cluster::Cluster;
use crate::http::support::sphere;
use crate::server::{Folder, PATIENCE, job_ended, until};
use crate::wire::Connection;

/// What a worker writes into the log when it has helped another one.
const HELPED: &str = "blocks of another worker's job were fitted";

/// Points of a ball with bumps, one a line: one network is not enough for them.
pub(crate) fn bumpy() -> String {
    let mut text = String::new();
    for p in sphere(3_000, 0.0) {
        let [x, y, z] = p.map(|c| 14.0 * c);
        let bump = 1.0 + 0.05 * x.sin() * y.sin() * z.cos();
        let [x, y, z] = p.map(|c| c * bump);
        writeln!(text, "{x} {y} {z}").unwrap();
    }
    text
}

/// Submits a job whose many blocks take most of its time.
async fn submit(address: SocketAddr) -> Value {
    let mut client = Connection::open(address).await.unwrap();
    let sent = client
        .ask("POST /v1/clouds", "", &[bumpy().as_bytes()])
        .await;
    let request = json!({
        "cloud_id": sent.unwrap().json()["id"],
        "settings": {
            "network": {"block_points": 4},
            "training": {"max_evaluations": 30, "block_evaluations": 60},
            "surface": {"resolution": 32},
        },
    });
    let answer = client.post("/v1/jobs", "", &request).await.unwrap();
    assert_eq!(answer.status, 202, "{}", answer.json());
    answer.json()
}

/// The mesh of a job once it has succeeded.
async fn mesh(address: SocketAddr, job: &Value) -> Vec<u8> {
    let mut client = Connection::open(address).await.unwrap();
    let ended = job_ended(&mut client, job).await;
    assert_eq!(ended["status"], "succeeded", "{ended}");
    assert_eq!(ended["attempt"], 1, "{ended}");
    let path = format!("GET {}/mesh", ended["links"]["self"].as_str().unwrap());
    let answer = client.ask(&path, "", &[]).await.unwrap();
    assert_eq!(answer.status, 200);
    answer.body
}

/// The mesh that one worker makes alone.
async fn alone() -> Vec<u8> {
    let folder = Folder::new().await;
    let server = folder
        .serve(&["--workers=1", "--threads-per-worker=1"])
        .await;
    let made = mesh(server.address(), &submit(server.address()).await).await;
    assert!(!server.log().contains(HELPED));
    made
}

#[tokio::test]
async fn idle_workers_of_a_service_help_and_leave_for_a_job() {
    let folder = Folder::new().await;
    let server = folder
        .serve(&["--workers=2", "--threads-per-worker=1"])
        .await;
    let large = submit(server.address()).await;
    until("a worker helps", PATIENCE, async || {
        server.log().contains(HELPED).then_some(())
    })
    .await;
    // It leaves a share for a job that waits, which ends long before the large one.
    let quick = folder.submit(json!({"surface": {"resolution": 24}})).await;
    folder.end(&quick).await;
    let path = format!("GET {}", large["links"]["self"].as_str().unwrap());
    let mut client = Connection::open(server.address()).await.unwrap();
    let answer = client.ask(&path, "", &[]).await.unwrap().json();
    assert_eq!(answer["status"], "running", "{answer}");
    assert!(mesh(server.address(), &large).await == alone().await);
}

#[tokio::test]
async fn workers_of_other_machines_help_and_may_die() {
    let Some(cluster) = Cluster::new().await else {
        return;
    };
    let slots = ["--slots=1", "--threads-per-worker=1"];
    let serve = cluster.serve("front", &["--workers=0"]).await;
    let holder = cluster.worker("holder", &slots).await;
    let job = submit(serve.address()).await;
    until("a worker holds the job", PATIENCE, async || {
        holder
            .server
            .log()
            .contains("a job was claimed")
            .then_some(())
    })
    .await;
    let helper = cluster.worker("helper", &slots).await;
    until("another one helps", PATIENCE, async || {
        helper.server.log().contains(HELPED).then_some(())
    })
    .await;
    kill_process(helper.server.pid(), Signal::KILL).unwrap();
    assert!(mesh(serve.address(), &job).await == alone().await);
    // Cloud, mesh and network: nothing else is left.
    until("all else is gone", PATIENCE, async || {
        (cluster.bucket.keys().len() == 3).then_some(())
    })
    .await;
}
