//! What becomes of jobs when processes die, stop, hang, or take too much memory.

use std::collections::BTreeSet;
use std::fs;
use std::process::Stdio;
use std::time::Duration;

use meshway::jobs::worker::Options;
use meshway::jobs::{FailureReason, Job, Status};
use rustix::process::{Signal, kill_process, test_kill_process};
use serde_json::json;
use sqlx::Connection as _;
use tokio::io::AsyncWriteExt as _;

use crate::server::{Folder, PATIENCE, SCRIPTED, until};
use crate::who::us;
use crate::wire::Connection;

/// Holds scripted jobs until it is opened: whatever is done to a job before, it has not ended by then.
struct Gate(tempfile::TempDir);

impl Gate {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn script(&self) -> String {
        format!("--script=until:{}", self.0.path().join("open").display())
    }

    fn open(&self) {
        fs::write(self.0.path().join("open"), "").unwrap();
    }
}

#[tokio::test]
async fn the_job_of_a_killed_worker_runs_again() {
    let folder = Folder::new().await;
    let gate = Gate::new();
    let _server = folder.serve(&[&gate.script()]).await;
    let id = folder.submit(json!({})).await;
    let worker = folder.running(&id).await;
    kill_process(worker, Signal::KILL).unwrap();
    gate.open();
    until("the job runs again", PATIENCE, async || {
        (folder.job(&id).await.attempt == 2).then_some(())
    })
    .await;
    let job = folder.end(&id).await;
    assert_eq!(
        (job.status, job.attempt, job.failures),
        (Status::Succeeded, 2, 1)
    );
    assert!(
        matches!(
            job.failure_reason,
            Some(FailureReason::WorkerCrashed {
                signal: Some(9),
                ..
            })
        ),
        "{:?}",
        job.failure_reason
    );
    folder.events(&id).await;
}

#[tokio::test]
async fn three_crashes_are_enough() {
    for (script, signal, exit_code) in [("crash", Some(6), None), ("exit", None, Some(7))] {
        let folder = Folder::new().await;
        let server = folder.serve(&[&format!("--script={script}")]).await;
        let id = folder.submit(json!({})).await;
        let job = folder.end(&id).await;
        assert_eq!(
            (job.status, job.attempt),
            (Status::Failed, 3),
            "{}",
            server.log()
        );
        assert_eq!(job.error.unwrap().code, "worker_crashed");
        let reason = FailureReason::WorkerCrashed { signal, exit_code };
        assert_eq!(job.failure_reason, Some(reason));
        folder.events(&id).await;
    }
}

#[tokio::test]
async fn too_much_memory_is_named() {
    let folder = Folder::new().await;
    // Half of what the script takes, and more than a worker needs.
    let _server = folder
        .serve(&["--script=oom", "--worker-memory-mib=1024"])
        .await;
    let id = folder.submit(json!({})).await;
    let job = folder.end(&id).await;
    // Another attempt would need as much.
    assert_eq!((job.status, job.attempt), (Status::Failed, 1));
    assert_eq!(
        job.error.unwrap().code,
        "out_of_memory",
        "{:?}",
        job.failure_reason
    );
}

#[tokio::test]
async fn a_cloud_whose_file_was_removed_is_missed_once() {
    let folder = Folder::new().await;
    let _server = folder.serve(&[]).await;
    fs::remove_file(folder.path().join("clouds").join("a".repeat(64))).unwrap();
    let id = folder.submit(json!({})).await;
    let job = folder.end(&id).await;
    assert_eq!((job.status, job.attempt), (Status::Failed, 1));
    let error = job.error.unwrap();
    assert_eq!(error.code, "cloud_missing");
    assert!(error.detail.contains("upload the cloud again"), "{error:?}");
}

#[tokio::test]
async fn a_computation_that_does_not_stop_is_ended_with_its_process() {
    let folder = Folder::new().await;
    let _server = folder
        .serve(&["--script=hang", "--grace-milliseconds=300"])
        .await;
    let id = folder.submit(json!({})).await;
    let worker = folder.running(&id).await;
    folder.store.by(us()).request_cancel(&id).await.unwrap();
    assert_eq!(folder.end(&id).await.status, Status::Cancelled);
    until("the process ends", PATIENCE, async || {
        test_kill_process(worker).err()
    })
    .await;
    // Another process takes its place.
    let next = folder.submit(json!({})).await;
    assert_ne!(folder.running(&next).await, worker);
    folder.events(&id).await;
}

#[tokio::test]
async fn who_cancels_does_not_wait_for_a_computation_that_does_not_look() {
    let folder = Folder::new().await;
    let server = folder.serve(&["--script=hang"]).await;
    let id = folder.submit(json!({})).await;
    folder.running(&id).await;
    folder.store.by(us()).request_cancel(&id).await.unwrap();
    assert_eq!(folder.end(&id).await.status, Status::Cancelled);
    // Long before the ten seconds that others have.
    let log = server.log();
    assert!(log.contains("nobody wants it any more"), "{log}");
    assert!(!log.contains("does not stop"), "{log}");
}

#[tokio::test]
async fn a_killed_server_loses_no_job_and_finishes_none_twice() {
    let folder = Folder::new().await;
    // Longer than the test: the job has not ended when its server is killed, however slow that is.
    let server = folder.serve(&["--script=sleep:1000"]).await;
    let first = folder.submit(json!({})).await;
    let second = folder.submit(json!({})).await;
    let worker = folder.running(&first).await;
    drop(server);
    // Its workers hear of it by the end of their input, and give their jobs back.
    until("the worker ends", PATIENCE, async || {
        test_kill_process(worker).err()
    })
    .await;
    let job = folder.job(&first).await;
    assert_eq!((job.status, job.failures), (Status::Queued, 0));

    let _server = folder.serve(&["--script=instant"]).await;
    for id in [&first, &second] {
        assert_eq!(folder.end(id).await.status, Status::Succeeded);
        folder.events(id).await;
    }
}

#[tokio::test]
async fn a_server_and_its_worker_killed_at_once_lose_no_job() {
    let folder = Folder::new().await;
    let server = folder.serve(&["--script=sleep:1000"]).await;
    let id = folder.submit(json!({})).await;
    let worker = folder.running(&id).await;
    kill_process(worker, Signal::STOP).unwrap();
    drop(server);
    kill_process(worker, Signal::KILL).unwrap();

    let _server = folder.serve(&["--script=instant"]).await;
    let job = folder.end(&id).await;
    assert_eq!((job.status, job.attempt), (Status::Succeeded, 2));
    folder.events(&id).await;
}

#[tokio::test]
async fn a_server_that_is_asked_to_end_gives_its_jobs_back() {
    let folder = Folder::new().await;
    let server = folder.serve(&["--script=sleep:30"]).await;
    let id = folder.submit(json!({})).await;
    folder.running(&id).await;
    assert!(server.terminate().await.success());
    let job = folder.job(&id).await;
    assert_eq!(
        (job.status, job.attempt, job.failures),
        (Status::Queued, 1, 0)
    );

    let _server = folder.serve(&["--script=instant"]).await;
    let job = folder.end(&id).await;
    assert_eq!(
        (job.status, job.attempt, job.failures),
        (Status::Succeeded, 2, 0)
    );
    folder.events(&id).await;
}

#[tokio::test]
async fn a_server_that_drains_is_still_heard() {
    let folder = Folder::new().await;
    // The worker does not look at its flags: it holds the end up until it is killed.
    let mut server = folder.serve(&["--script=hang"]).await;
    let id = folder.submit(json!({})).await;
    let worker = folder.running(&id).await;
    kill_process(server.pid(), Signal::TERM).unwrap();
    until("it drains", PATIENCE, async || {
        server.log().contains("the service stops").then_some(())
    })
    .await;
    let mut connection = Connection::open(server.address()).await.unwrap();
    let ready = connection.ask("GET /readyz", "", &[]).await.unwrap();
    assert_eq!(ready.status, 503);
    assert_eq!(ready.json()["checks"]["not_draining"]["ok"], false);
    let job = json!({ "cloud_id": folder.cloud_id() });
    let refused = connection.post("/v1/jobs", "", &job).await.unwrap();
    assert_eq!(refused.status, 503);
    assert_eq!(refused.json()["code"], "draining");
    let read = connection.ask("GET /v1/jobs", "", &[]).await.unwrap();
    assert_eq!(read.status, 200);
    drop(connection);
    kill_process(worker, Signal::KILL).unwrap();
    assert!(server.ended().await.success());
}

#[tokio::test]
async fn a_computation_that_is_left_at_the_end_is_no_error() {
    let folder = Folder::new().await;
    let mut server = folder
        .serve(&["--script=hang", "--grace-milliseconds=300"])
        .await;
    let id = folder.submit(json!({})).await;
    folder.running(&id).await;
    kill_process(server.pid(), Signal::TERM).unwrap();
    assert!(server.ended().await.success());
    let log = server.log();
    assert!(
        log.contains("its job is given back") && !log.contains("ERROR"),
        "{log}"
    );
    assert_eq!(folder.job(&id).await.status, Status::Queued);
}

#[tokio::test]
async fn a_job_that_its_user_erased_is_no_loss() {
    let folder = Folder::new().await;
    let server = folder.serve(&["--script=sleep:60"]).await;
    let id = folder.submit(json!({})).await;
    folder.running(&id).await;
    folder.store.by(us()).delete_job(&id).await.unwrap();
    until("the worker hears of it", PATIENCE, async || {
        server.log().contains("the job was erased").then_some(())
    })
    .await;
    assert!(!server.log().contains("WARN"), "{}", server.log());
}

#[tokio::test]
async fn the_time_limit_is_that_of_all_attempts() {
    let folder = Folder::new().await;
    let id = folder.submit(json!({})).await;
    let store = &folder.store;
    let claim = store.claim("worker", 6_000).await.unwrap().unwrap();
    let worked = Duration::from_hours(1);
    store.renew(&claim, 6_000, worked).await.unwrap();
    store.release(&claim).await.unwrap();
    let _server = folder
        .serve(&["--script=sleep:60", "--job-time-limit-seconds=3000"])
        .await;
    let job = folder.end(&id).await;
    assert_eq!((job.status, job.attempt), (Status::Failed, 2));
    assert_eq!(job.error.unwrap().code, "time_limit");
}

#[tokio::test]
async fn a_stopped_worker_is_killed_and_its_job_runs_again() {
    let folder = Folder::new().await;
    let gate = Gate::new();
    let _server = folder.serve(&[&gate.script()]).await;
    let id = folder.submit(json!({})).await;
    let worker = folder.running(&id).await;
    kill_process(worker, Signal::STOP).unwrap();
    gate.open();
    let job = folder.end(&id).await;
    assert_eq!(
        (job.status, job.attempt, job.failures),
        (Status::Succeeded, 2, 1)
    );
    test_kill_process(worker).unwrap_err();
    folder.events(&id).await;
}

#[tokio::test]
async fn a_worker_that_wakes_after_its_lease_publishes_nothing() {
    let folder = Folder::new().await;
    // Without a server, so that nobody kills it.
    let mut worker = tokio::process::Command::new(SCRIPTED)
        .args(["slot", "--slot=0", "--script=sleep:5", "--data-dir"])
        .arg(folder.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .kill_on_drop(true)
        .spawn()
        .unwrap();
    let mut orders = serde_json::to_value(Options {
        threads: 1,
        time_limit: Duration::from_mins(1),
        checkpoint_interval: Duration::from_secs(10),
        grace: Duration::from_secs(10),
        events_limit: 1_000,
        metrics_limit: 1_000,
        slots: 1,
    })
    .unwrap();
    orders["log_format"] = json!("text");
    orders["log"] = json!("off");
    let input = worker.stdin.as_mut().unwrap();
    let line = format!("{orders}\n");
    input.write_all(line.as_bytes()).await.unwrap();
    let id = folder.submit(json!({})).await;
    let pid = folder.running(&id).await;
    let store = &folder.store;
    // Not in the middle of a write, after which nobody could write: the test has the write lock
    // until the worker stands still.
    let mut lock = folder.connection().await;
    let write = lock.begin_with("BEGIN IMMEDIATE").await.unwrap();
    kill_process(pid, Signal::STOP).unwrap();
    until("it stands still", PATIENCE, async || {
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap();
        stat.contains(") T ").then_some(())
    })
    .await;
    write.rollback().await.unwrap();
    assert_eq!(folder.job(&id).await.status, Status::Running);
    until("the lease runs out", PATIENCE, async || {
        let reaped = store.reap_expired(BTreeSet::new()).await.unwrap();
        (reaped == [id.clone()]).then_some(())
    })
    .await;
    let claim = store.claim("another", 60_000).await.unwrap().unwrap();
    assert_eq!((claim.job_id(), claim.attempt), (&id, 2));
    let before = folder.events(&id).await;
    kill_process(pid, Signal::CONT).unwrap();

    // That it takes the next job says that it is done with the lost one.
    let next = folder.submit(json!({})).await;
    assert_eq!(folder.end(&next).await.status, Status::Succeeded);
    assert_eq!(folder.events(&id).await, before);
    let held = |job: &Job| (job.status, job.attempt, job.worker.clone());
    let another = Some("another".to_owned());
    assert_eq!(held(&folder.job(&id).await), (Status::Running, 2, another));

    // The end of its input ends it.
    drop(worker.stdin.take());
    let status = until("the worker ends", PATIENCE, async || {
        worker.try_wait().unwrap()
    })
    .await;
    assert!(status.success());
}
