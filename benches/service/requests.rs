//! Submits and reads.

use std::time::{Duration, Instant};

use serde_json::json;
use tokio::task::JoinSet;

use crate::report::{Report, Sample};
use crate::server::Server;
use crate::wire::Connection;

/// How long each rate is measured.
const SUBMITTING: Duration = Duration::from_secs(6);
const READING: Duration = Duration::from_secs(8);
/// Turns of servers with a key and without, and how long each rate is measured in a turn.
const TURNS: u32 = 4;
const TURN: Duration = Duration::from_secs(2);
/// Pause of a client that polls: closer together, the client itself would be most of the load.
const POLL_PAUSE: Duration = Duration::from_millis(2);

/// Jobs for a cloud that is here, by one client and by many at once.
pub(crate) async fn submits(report: &mut Report) {
    for clients in [1, 16, 64] {
        let server = Server::start(&["--script=instant"]).await;
        let (rate, mut times) = submitted(&server, clients, SUBMITTING).await;
        let what = format!("submit, {clients} at a time");
        report.row(&what, &format!("{rate:.0}/s, {}", times.summary()));
    }
}

/// Jobs a second that so many clients submit for so long, and what each submit took.
async fn submitted(server: &Server, clients: usize, time: Duration) -> (f64, Sample) {
    let cloud = server.upload(1_000).await;
    let start = Instant::now();
    let mut running = JoinSet::new();
    for _ in 0..clients {
        let (connection, bearer) = (server.connect().await, server.bearer.clone());
        running.spawn(submit(connection, bearer, cloud.clone(), start + time));
    }
    let mut times = Sample::default();
    for part in running.join_all().await {
        times.append(part);
    }
    (times.len() as f64 / start.elapsed().as_secs_f64(), times)
}

/// What a key costs: servers with one and without take turns.
pub(crate) async fn keys(report: &mut Report) {
    let (mut rates, mut polls) = ([0.0, 0.0], [Sample::default(), Sample::default()]);
    for _ in 0..TURNS {
        for (turn, with_key) in [false, true].into_iter().enumerate() {
            let flags = &["--script=instant"];
            let server = if with_key {
                Server::start_with_key(flags).await
            } else {
                Server::start(flags).await
            };
            let cloud = server.upload(1_000).await;
            let job = server.submit(&cloud, json!({})).await;
            server.wait(&job, |job| job["status"] == "succeeded").await;
            polls[turn].append(poll(&server, &job, TURN).await);
            rates[turn] += submitted(&server, 16, TURN).await.0 / f64::from(TURNS);
        }
    }
    let [without, with] = polls.each_mut().map(|sample| sample.quantile(0.99));
    let told = format!("{without:.1} ms without, {with:.1} ms with");
    report.row(
        "GET /v1/jobs/{id}, idle, p99 without a key and with one",
        &told,
    );
    report.bounded("the same, difference", with - without, 1.0, "ms");
    let told = format!("{:.0}/s without, {:.0}/s with", rates[0], rates[1]);
    report.row("submit, 16 at a time, without a key and with one", &told);
    let more = rates[0] / rates[1];
    report.bounded("the same, ratio", more, 1.0 / 0.9, "times");
}

async fn submit(mut connection: Connection, bearer: String, cloud: String, end: Instant) -> Sample {
    let body = json!({"cloud_id": cloud, "preset": "fast"});
    let mut times = Sample::default();
    while Instant::now() < end {
        let start = Instant::now();
        let answer = connection.post("/v1/jobs", &bearer, &body).await.unwrap();
        times.push(start.elapsed().as_secs_f64() * 1e3);
        assert_eq!(answer.status, 202, "{}", answer.json());
    }
    times
}

/// A client that polls a job: while nothing else happens, and while all cores train.
pub(crate) async fn reads(report: &mut Report) {
    let server = Server::start(&["--script=instant"]).await;
    let cloud = server.upload(1_000).await;
    let job = server.submit(&cloud, json!({})).await;
    server.wait(&job, |job| job["status"] == "succeeded").await;
    let mut times = poll(&server, &job, READING).await;
    report.row("GET /v1/jobs/{id}, idle", &times.summary());
    drop(server);

    let server = Server::start(&[]).await;
    let cloud = server.upload(3_000).await;
    // Adam does not stop before its last evaluation.
    let long = json!({"training": {
        "optimizer": "adam", "adam_evaluations": 1_000_000, "max_evaluations": 1_000_000,
        "patience": 0,
    }});
    let job = server.submit(&cloud, long).await;
    let evaluations = |job: &serde_json::Value| job["evaluations"].as_u64().unwrap_or(0);
    let before = server.wait(&job, |job| evaluations(job) > 0).await;
    let mut times = poll(&server, &job, READING).await;
    let after = server.job(&job).await;
    let trained = evaluations(&after).saturating_sub(evaluations(&before));
    assert!(after["status"] == "running" && trained > 0, "{after}");
    let what = "GET /v1/jobs/{id}, all cores train";
    report.row(what, &times.summary());
    report.bounded(&format!("{what}, p99"), times.quantile(0.99), 50.0, "ms");
}

async fn poll(server: &Server, job: &str, time: Duration) -> Sample {
    let mut connection = server.connect().await;
    let line = format!("GET /v1/jobs/{job}");
    let mut times = Sample::default();
    let end = Instant::now() + time;
    while Instant::now() < end {
        let start = Instant::now();
        let answer = connection.ask(&line, &server.bearer, &[]).await.unwrap();
        times.push(start.elapsed().as_secs_f64() * 1e3);
        assert_eq!(answer.status, 200);
        tokio::time::sleep(POLL_PAUSE).await;
    }
    times
}
