//! Machines whose clocks are hours apart. A lease lasts half a minute, and the object store refuses what is signed a
//! quarter of an hour before or after its own time.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use rustix::process::{Signal, kill_process};
use serde_json::json;
use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;
use uuid::{NoContext, Timestamp, Uuid};

use crate::cluster::{Cluster, Node};
use crate::cut::{ended, running, undisturbed};
use crate::http::support::sphere_xyz;
use crate::server::{PATIENCE, until};

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
        let ahead = start(&cluster, "ahead", "+1h", &serve).await;
        let right = cluster.serve("right", &["--workers=0"]).await;
        let work = ["worker", "--slots=1", "--script=sleep:40"];
        let behind = start(&cluster, "behind", "-1h", &work).await;
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

    /// A worker that is two hours ahead of the other one.
    async fn early(&self) -> Node {
        let work = ["worker", "--slots=1", "--script=sleep:3"];
        start(&self.cluster, "early", "+1h", &work).await
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
async fn a_machine_that_dies_has_its_job_taken_over_by_one_two_hours_ahead() {
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
async fn clocks_that_are_a_year_apart_leave_nothing_and_lists_in_their_order() {
    let Some(cluster) = cluster().await else {
        return;
    };
    let serve = ["serve", "--disk-reserve-mib=0", "--disk-reserve-percent=0"];
    let ahead = start(&cluster, "ahead", "+1y", &serve).await;
    let behind = start(&cluster, "behind", "-1y", &serve).await;
    let cloud = ahead.upload().await;
    let mut jobs = Vec::new();
    for node in [&ahead, &behind, &ahead, &behind] {
        let job = node.submit(&cloud).await;
        assert_eq!(ended(&behind, &job).await["status"], "succeeded");
        jobs.push(job);
    }
    let list = behind.get("/v1/jobs").await;
    let list = list["items"].as_array().unwrap().iter().rev();
    let list = list.map(|job| job["links"]["self"].as_str().unwrap());
    assert_eq!(list.collect::<Vec<_>>(), jobs);
    for job in &jobs {
        let mesh = ahead.ask(&format!("GET {job}/mesh.ply"), "", &[]).await;
        assert!(mesh.status == 200 && mesh.body.starts_with(b"ply\n"));
    }
    jobs.push(format!("/v1/clouds/{cloud}"));
    for path in jobs {
        let erased = ahead.ask(&format!("DELETE {path}"), "", &[]).await;
        assert_eq!(erased.status, 204, "{path}");
    }
    until("nothing is left", PATIENCE, async || {
        cluster.bucket.keys().is_empty().then_some(())
    })
    .await;
}

/// An object under a key that was made so many hours from now by the clock of its machine, and written so many hours
/// ago.
fn object(cluster: &Cluster, made_in: i64, written_before: u64) -> PathBuf {
    let made = OffsetDateTime::now_utc().unix_timestamp() + made_in * 3_600;
    let key = Uuid::new_v7(Timestamp::from_unix(NoContext, made as u64, 0));
    let path = cluster.bucket.folder.join(key.to_string());
    fs::write(&path, "bytes").unwrap();
    let written = SystemTime::now() - Duration::from_hours(written_before);
    File::options()
        .write(true)
        .open(&path)
        .unwrap()
        .set_modified(written)
        .unwrap();
    path
}

#[tokio::test]
async fn garbage_is_old_by_the_time_of_the_object_store() {
    let Some(cluster) = cluster().await else {
        return;
    };
    // It collects when it starts, and finds nothing.
    let right = cluster.serve("right", &["--workers=0"]).await;
    let cloud = right.upload().await;
    let named = cluster.bucket.keys();
    assert_eq!(named.len(), 1);
    for (name, clock) in [("ahead", "+2h"), ("behind", "-2h")] {
        // About to be named by machines with any clock, and left behind by them.
        let fresh = [-3, 0, 3].map(|hours| object(&cluster, hours, 0));
        let left = [-9_000, -2, 9_000].map(|hours| object(&cluster, hours, 2));
        let serve = ["serve", "--disk-reserve-mib=0", "--disk-reserve-percent=0"];
        let node = start(&cluster, name, clock, &serve).await;
        until("what was left has gone", PATIENCE, async || {
            left.iter().all(|object| !object.exists()).then_some(())
        })
        .await;
        assert!(
            fresh.iter().all(|object| object.exists()),
            "{}",
            node.server.log()
        );
        let content = node
            .ask(&format!("GET /v1/clouds/{cloud}/content"), "", &[])
            .await;
        assert!(content.body == sphere_xyz(300, 0.0).into_bytes());
        for object in &fresh {
            fs::remove_file(object).unwrap();
        }
    }
    assert_eq!(cluster.bucket.keys(), named);
}
