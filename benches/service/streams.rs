//! Event streams: how late events come, and what open streams cost.

use std::time::{Duration, Instant};

use serde_json::json;
use tokio::task::JoinSet;

use crate::events::Events;
use crate::report::{Report, Sample};
use crate::server::Server;

/// Jobs that are watched from their first event to their last, and the pause between two.
const WATCHED: usize = 100;
const PAUSE: Duration = Duration::from_millis(50);
/// Streams that are open at once.
const STREAMS: usize = 500;
/// How long a stream may be silent before the benchmark gives up.
const SILENCE: Duration = Duration::from_secs(20);

/// From the row to the client: one stream over all jobs, which end at once.
pub(crate) async fn lag(report: &mut Report) {
    let server = Server::start(&["--script=instant"]).await;
    let cloud = server.upload(1_000).await;
    let mut lags = watch(&server, &cloud, "job.succeeded").await;
    report.row("event, from its row to the client", &lags.summary());
}

/// Streams of jobs that wait, each its own; and what they do to a stream beside them.
pub(crate) async fn many(report: &mut Report) {
    // All streams are those of one client here.
    let server = Server::start(&[
        "--script=sleep:3600",
        "--max-streams=1000",
        "--max-streams-per-client=1000",
    ])
    .await;
    let cloud = server.upload(1_000).await;
    let mut lags = watch(&server, &cloud, "job.queued").await;
    report.row("event, no other streams", &lags.summary());

    let mut jobs = Vec::new();
    for _ in 0..STREAMS {
        jobs.push(server.submit(&cloud, json!({})).await);
    }
    let (before, _) = server.memory_mb();
    report.row("memory, no streams", &format!("{before:.1} MB"));
    let mut open = JoinSet::new();
    for job in &jobs {
        let path = format!("/v1/jobs/{job}/events");
        let mut events = Events::open(server.address, &path).await.unwrap();
        open.spawn(async move { while let Ok(Some(_)) = events.next().await {} });
    }
    let mut lags = watch(&server, &cloud, "job.queued").await;
    let what = format!("event, {STREAMS} other streams");
    report.row(&what, &lags.summary());
    assert!(open.try_join_next().is_none(), "a stream ended early");
    let (_, most) = server.memory_mb();
    let what = format!("memory that {STREAMS} streams add, at most");
    report.bounded(&what, most - before, 100.0, "MB");
}

/// Submits jobs and measures how late their events come, until the last one has had its `last`.
async fn watch(server: &Server, cloud: &str, last: &str) -> Sample {
    let mut events = Events::open(server.address, "/v1/events").await.unwrap();
    let submitting = async {
        let mut jobs = Vec::new();
        for _ in 0..WATCHED {
            let start = Instant::now();
            jobs.push(server.submit(cloud, json!({})).await);
            tokio::time::sleep(PAUSE.saturating_sub(start.elapsed())).await;
        }
        jobs
    };
    let mut lags = Sample::default();
    let mut seen = Vec::new();
    let listening = async {
        while seen.len() < WATCHED {
            let next = tokio::time::timeout(SILENCE, events.next()).await;
            let event = next.unwrap().unwrap().expect("the stream stays open");
            lags.push(event.lag_ms);
            if event.name == last {
                seen.push(event.job);
            }
        }
    };
    let (mut jobs, ()) = tokio::join!(submitting, listening);
    jobs.sort();
    seen.sort();
    assert_eq!(jobs, seen, "each job's events came once");
    lags
}
