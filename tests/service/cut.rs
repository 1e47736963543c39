//! Networks that fail between processes which all live.

use std::time::Duration;

use serde_json::{Value, json};

use crate::cluster::{Cluster, Node};
use crate::proxy::{Proxy, Way};
use crate::server::{PATIENCE, until};

/// Longer than a lease; `MESHWAY_TEST_CUT_SECONDS=3600` has the database, and an object store, away for longer.
const LONG_SECONDS: u64 = 36;

/// Work that goes on while the way is cut.
const WORK: &str = "--script=sleep:45";

pub(crate) async fn running(node: &Node, job: &str) {
    until("the job runs", PATIENCE, async || {
        let job = node.get(job).await;
        (job["progress"].as_f64()? > 0.02).then_some(())
    })
    .await;
}

pub(crate) async fn ended(node: &Node, job: &str) -> Value {
    until("the job ends", PATIENCE, async || {
        let answer = node.ask(&format!("GET {job}"), "", &[]).await;
        (answer.status == 200 && answer.json()["finished_at"].is_string()).then(|| answer.json())
    })
    .await
}

/// The job succeeded at its first attempt, and no failure was counted.
pub(crate) fn undisturbed(end: &Value, worker: &Node) {
    assert_eq!(
        (&end["status"], &end["attempt"], &end["failures"]),
        (&json!("succeeded"), &json!(1), &json!(0)),
        "{end}\n{}",
        worker.server.log()
    );
}

/// The events of a job have no gap, and one end.
async fn events(node: &Node, job: &str) {
    let mut stream = node.stream(&format!("{job}/events"), None).await;
    let ids = stream.until("job.succeeded").await;
    assert_eq!(ids, (1..=ids.len() as i64).collect::<Vec<_>>());
}

/// How long a part is to be away, in seconds, where the environment tells.
#[expect(
    clippy::disallowed_methods,
    reason = "a test is told by the environment"
)]
pub(crate) fn told_seconds() -> Option<u64> {
    let told = std::env::var("MESHWAY_TEST_CUT_SECONDS").ok()?;
    Some(told.parse().unwrap())
}

/// How long the way is cut, in seconds.
fn long() -> u64 {
    told_seconds().unwrap_or(LONG_SECONDS)
}

/// Nobody reaches the database for longer than a lease: no work is lost and no failure counted.
async fn nobody_reaches_the_database(way: Way) {
    let Some(cluster) = Cluster::new().await else {
        return;
    };
    let proxy = Proxy::to(&cluster.database).await;
    let cut = cluster.by(Some(&proxy), None);
    let node = cut.serve("node", &["--workers=0"]).await;
    let work = format!("--script=sleep:{}", long() + 9);
    // The time away is no time of the job.
    let limit = format!("--job-time-limit-seconds={}", long() + 4);
    let worker = cut.worker("worker", &[&work, &limit, "--slots=1"]).await;
    let job = node.submit(&node.upload().await).await;
    running(&node, &job).await;
    proxy.set(way);
    tokio::time::sleep(Duration::from_secs(long())).await;
    proxy.set(Way::Open);
    let end = ended(&node, &job).await;
    undisturbed(&end, &worker);
    events(&node, &job).await;
}

#[tokio::test]
async fn the_way_to_the_database_is_cut() {
    nobody_reaches_the_database(Way::Cut).await;
}

#[tokio::test]
async fn the_way_to_the_database_is_stalled() {
    nobody_reaches_the_database(Way::Stalled).await;
}

#[tokio::test]
async fn the_answers_of_the_database_are_lost() {
    nobody_reaches_the_database(Way::HalfOpen).await;
}

#[tokio::test]
async fn one_machine_alone_is_cut_and_its_job_goes_on_elsewhere() {
    let Some(cluster) = Cluster::new().await else {
        return;
    };
    let proxy = Proxy::to(&cluster.database).await;
    let cut = cluster.by(Some(&proxy), None);
    let node = cluster.serve("node", &["--workers=0"]).await;
    let lonely = cut
        .worker("lonely", &[WORK, "--slots=1", "--checkpoint-seconds=1"])
        .await;
    let job = node.submit(&node.upload().await).await;
    running(&node, &job).await;
    let other = cluster
        .worker("other", &["--script=sleep:8", "--slots=1"])
        .await;
    proxy.set(Way::Cut);
    until("the other has the job", PATIENCE, async || {
        let job = node.get(&job).await;
        (job["attempt"] == json!(2) && job["status"] == "running").then_some(())
    })
    .await;
    // Back before the other has ended: whatever it still wants to write is refused.
    proxy.set(Way::Open);
    let end = ended(&node, &job).await;
    assert_eq!(
        (&end["status"], &end["attempt"]),
        (&json!("succeeded"), &json!(2)),
        "{end}\n{}\n{}",
        lonely.server.log(),
        other.server.log()
    );
    events(&node, &job).await;
    until(
        "only cloud, mesh and network are left",
        PATIENCE,
        async || (cluster.bucket.keys().len() == 3).then_some(()),
    )
    .await;
}

#[tokio::test]
async fn a_slow_object_store_costs_time_only() {
    let Some(cluster) = Cluster::new().await else {
        return;
    };
    let proxy = Proxy::to(&cluster.bucket.url).await;
    let slow = cluster.by(None, Some(&proxy));
    let node = slow.serve("node", &["--workers=0"]).await;
    let worker = slow
        .worker("worker", &["--slots=1", "--checkpoint-seconds=1"])
        .await;
    let cloud = node.upload().await;
    proxy.set(Way::Slow(20_000));
    let job = node.submit(&cloud).await;
    let end = ended(&node, &job).await;
    undisturbed(&end, &worker);
    proxy.set(Way::Open);
    let mesh = node.ask(&format!("GET {job}/mesh.ply"), "", &[]).await;
    assert_eq!(mesh.status, 200);
}
