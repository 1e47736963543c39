//! Many large uploads at once.

use std::sync::Arc;
use std::time::Instant;

use tokio::task::JoinSet;

use crate::report::{Report, Sample};
use crate::server::{Server, sphere};

/// Uploads at once.
const UPLOADS: usize = 100;
/// Rows of 10 MB of text.
const POINTS: usize = 280_000;

/// Text, which takes the most memory to read for its size, and each body another: the same bytes
/// are kept only once.
pub(crate) async fn uploads(report: &mut Report) {
    let server = Server::start(&["--script=instant"]).await;
    let (idle, _) = server.memory_mb();
    report.row("memory, idle", &format!("{idle:.1} MB"));
    let body = Arc::new(sphere(POINTS));
    let start = Instant::now();
    let mut running = JoinSet::new();
    for k in 0..UPLOADS {
        let mut connection = server.connect().await;
        let body = Arc::clone(&body);
        running.spawn(async move {
            let start = Instant::now();
            let first = format!("0.0 0.0 0.{k:03}\n");
            let pieces = [first.as_bytes(), &body];
            let answer = connection.ask("POST /v1/clouds", "", &pieces).await;
            let answer = answer.unwrap();
            assert_eq!(answer.status, 201, "{}", answer.json());
            start.elapsed().as_secs_f64() * 1e3
        });
    }
    let mut times = Sample::default();
    for time in running.join_all().await {
        times.push(time);
    }
    let seconds = start.elapsed().as_secs_f64();
    let megabytes = UPLOADS as f64 * body.len() as f64 / 1e6;
    let what = format!(
        "{UPLOADS} uploads of {:.1} MB at once",
        body.len() as f64 / 1e6
    );
    report.row(
        &what,
        &format!("{:.0} MB/s, {}", megabytes / seconds, times.summary()),
    );
    let (after, most) = server.memory_mb();
    report.row("memory after them", &format!("{after:.1} MB"));
    report.bounded("memory during them, at most", most, 300.0, "MB");
}
