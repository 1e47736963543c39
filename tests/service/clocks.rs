//! Machines whose clocks are half an hour apart: as far as an object store allows, which refuses requests that are
//! signed a quarter of an hour before or after its own time. A lease lasts half a minute.

use std::path::Path;
use std::process::Command;

use rustix::process::{Signal, kill_process};
use serde_json::json;
use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;

use crate::cluster::{Cluster, Node};
use crate::cut::{ended, running, undisturbed};

/// What gives a process another time of day (Debian's faketime). Its clock that only goes on stays as it is.
const FAKE: &str = "/usr/lib/x86_64-linux-gnu/faketime/libfaketime.so.1";

/// The environment of a process whose clock is off by that much.
fn environment(clock: &str) -> [(&str, &str); 3] {
    [
        ("LD_PRELOAD", FAKE),
        ("FAKETIME", clock),
        ("FAKETIME_DONT_FAKE_MONOTONIC", "1"),
    ]
}

/// Starts a node whose clock is off by that much.
async fn start(cluster: &Cluster, name: &str, clock: &str, line: &[&str]) -> Node {
    let environment = environment(clock);
    cluster.start_among(name, name, line, &environment).await
}

/// None, and said so, where something is missing that the tests need.
#[expect(clippy::print_stderr, reason = "what is left out is said aloud")]
async fn cluster() -> Option<Cluster> {
    let cluster = Cluster::new().await?;
    if !Path::new(FAKE).exists() {
        assert!(
            std::env::var_os("CI").is_none(),
            "Debian's faketime is missing"
        );
        eprintln!("skipped: Debian's faketime is not installed");
        return None;
    }
    Some(cluster)
}

/// The nodes of these tests: two services whose clocks differ, and a worker that is behind both, with a job.
struct Apart {
    cluster: Cluster,
    ahead: Node,
    right: Node,
    behind: Node,
    job: String,
}

impl Apart {
    async fn new() -> Option<Self> {
        let cluster = cluster().await?;
        let serve = [
            "serve",
            "--disk-reserve-mib=0",
            "--disk-reserve-percent=0",
            "--workers=0",
        ];
        let ahead = start(&cluster, "ahead", "+14m", &serve).await;
        let right = cluster.serve("right", &["--workers=0"]).await;
        let work = ["worker", "--slots=1", "--script=sleep:40"];
        let behind = start(&cluster, "behind", "-14m", &work).await;
        let job = ahead.submit(&ahead.upload().await).await;
        running(&right, &job).await;
        Some(Self {
            cluster,
            ahead,
            right,
            behind,
            job,
        })
    }

    /// A worker that is half an hour ahead of the other one.
    async fn early(&self) -> Node {
        let work = ["worker", "--slots=1", "--script=sleep:3"];
        start(&self.cluster, "early", "+14m", &work).await
    }
}

#[tokio::test]
async fn a_job_is_not_taken_over_because_a_clock_says_that_its_lease_has_ended() {
    let Some(nodes) = Apart::new().await else {
        return;
    };
    let _early = nodes.early().await;
    undisturbed(&ended(&nodes.ahead, &nodes.job).await, &nodes.behind);
    // All tell the time of the database.
    for node in [&nodes.ahead, &nodes.right] {
        let told = node.get(&nodes.job).await;
        for name in ["created_at", "started_at", "finished_at"] {
            let time = OffsetDateTime::parse(told[name].as_str().unwrap(), &Rfc3339).unwrap();
            let off = (OffsetDateTime::now_utc() - time).whole_minutes();
            assert!(off.abs() < 3, "{name}: {told}");
        }
    }
}

#[tokio::test]
async fn a_machine_that_dies_has_its_job_taken_over_by_one_half_an_hour_ahead() {
    let Some(nodes) = Apart::new().await else {
        return;
    };
    let early = nodes.early().await;
    kill_process(nodes.behind.server.pid(), Signal::KILL).unwrap();
    let end = ended(&nodes.right, &nodes.job).await;
    assert_eq!(
        (&end["status"], &end["attempt"]),
        (&json!("succeeded"), &json!(2)),
        "{end}\n{}",
        early.server.log()
    );
}

#[tokio::test]
async fn a_clock_that_the_object_store_refuses_is_named() {
    let Some(cluster) = cluster().await else {
        return;
    };
    let line = [
        "serve",
        "--listen=127.0.0.1:0",
        &format!("--database={}", cluster.database),
        &cluster.bucket.flag(),
    ];
    let refused = Command::new(env!("CARGO_BIN_EXE_meshway"))
        .args(line)
        .arg("--data-dir")
        .arg(cluster.dir.path())
        .envs(environment("+1h"))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(!refused.status.success());
    assert!(said.contains("set the clock"), "{said}");
}
