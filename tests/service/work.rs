//! What becomes of jobs when nothing breaks: success, refusal, cancellation, limits, checkpoints.

use std::process::Command;

use meshway::jobs::{EventKind, Status};
use meshway::reconstruction::Model;
use meshway::reconstruction::Phase;
use rustix::process::{Signal, kill_process};
use serde_json::json;

use crate::http::contract::expect_named;
use crate::server::{Folder, PATIENCE, PROGRAM, until};
use crate::who::{ours, us};

#[tokio::test]
async fn a_job_becomes_a_mesh_a_report_and_a_model() {
    let folder = Folder::new().await;
    let _server = folder.serve(&[]).await;
    let id = folder
        .submit(json!({
            "training": {"snapshot_evaluations": [30], "histogram_evaluations": [1, 5]},
            "surface": {"target_triangles": 1_000},
        }))
        .await;
    let job = folder.end(&id).await;
    assert_eq!(job.status, Status::Succeeded, "{:?}", job.error);
    assert_eq!((job.attempt, job.failures), (1, 0));

    let report = job.report.unwrap();
    assert_eq!(report["mesh"]["closed"], true);
    assert_eq!(report["inputs"][0]["sha256"], "a".repeat(64));
    assert_eq!(report["inputs"][0]["name"], "");
    assert_eq!(report["warnings"][0]["code"], "points_not_finite");
    expect_named("Report", &report);
    for (group, name) in [
        ("cloud", "orientation_confidence"),
        ("surface", "support_distance"),
        ("surface", "unsupported_area_percent"),
    ] {
        assert!(report[group][name].is_number(), "{group}/{name}");
    }
    let store = &folder.store;
    let mesh = store.of(ours()).mesh_info(&id, 0).await.unwrap().unwrap();
    let bytes = store.mesh_bytes(&mesh).await.unwrap().unwrap();
    assert!(bytes.starts_with(b"ply\n") && mesh.triangles > 100);
    let simplification = &report["surface"]["simplification"];
    assert_eq!(simplification["target_triangles"], 1_000);
    assert_eq!(simplification["triangles"], mesh.triangles);
    let header = String::from_utf8_lossy(&bytes[..400]);
    assert!(
        header.contains("property float distance_to_points\n"),
        "{header}"
    );
    assert_eq!(store.of(ours()).snapshots(&id).await.unwrap().len(), 1);
    assert_eq!(store.of(ours()).gradients(&id).await.unwrap().len(), 2);
    let (model, _) = store.of(ours()).model(&id).await.unwrap().unwrap();
    let model = Model::decode(&model).unwrap();
    assert_eq!(model.settings, job.settings);
    assert_eq!(store.of(ours()).checkpoint(&id).await.unwrap(), None);

    let metrics = store.of(ours()).metrics(&id, 0, 1_000).await.unwrap();
    assert_eq!(metrics.len() as i64, job.metrics);
    assert_eq!(metrics.last().unwrap().evaluation, job.evaluations);
    let events = folder.events(&id).await;
    let phases: Vec<_> = events
        .iter()
        .filter(|event| event.kind == EventKind::Phase)
        .map(|event| event.data["phase"].as_str().unwrap())
        .collect();
    assert_eq!(phases, ["sampling", "training", "surface", "report"]);
    assert_eq!(events.last().unwrap().kind, EventKind::Succeeded);
}

#[tokio::test]
async fn what_would_fail_again_is_not_tried_again() {
    let folder = Folder::new().await;
    let _server = folder.serve(&["--script=fail:no_surface"]).await;
    let id = folder.submit(json!({})).await;
    let job = folder.end(&id).await;
    assert_eq!((job.status, job.attempt), (Status::Failed, 1));
    assert_eq!(job.error.unwrap().code, "no_surface");
    folder.events(&id).await;
}

#[tokio::test]
async fn a_defect_is_tried_three_times_and_told_without_its_insides() {
    let folder = Folder::new().await;
    let _server = folder.serve(&["--script=panic"]).await;
    let id = folder.submit(json!({})).await;
    let job = folder.end(&id).await;
    assert_eq!(
        (job.status, job.attempt, job.failures),
        (Status::Failed, 3, 3)
    );
    let error = job.error.unwrap();
    assert_eq!(error.code, "internal");
    assert!(!error.detail.contains("panicked"), "{}", error.detail);
}

#[tokio::test]
async fn cancelled_work_ends_soon_in_training_and_in_surface() {
    let folder = Folder::new().await;
    let _server = folder.serve(&[]).await;
    let training = json!({"training": {
        "max_evaluations": 1_000_000, "max_iterations": 1_000_000, "patience": 0,
        "tolerance_gradient": 0.0, "tolerance_change": 0.0,
    }, "network": {"block_points": 0}});
    let surface = json!({"surface": {
        "resolution": 500, "evaluation": "dense", "steps_per_spacing": 0,
    }});
    for (settings, phase) in [(training, Phase::Training), (surface, Phase::Surface)] {
        let id = folder.submit(settings).await;
        let there = |job: &meshway::jobs::Job| job.phase == Some(phase) || job.status.is_final();
        let job = folder.wait(&id, "the phase begins", there).await;
        assert_eq!(job.status, Status::Running, "{:?}", job.error);
        folder.store.by(us()).request_cancel(&id).await.unwrap();
        // Not succeeded: the surface alone would take minutes here.
        assert_eq!(folder.end(&id).await.status, Status::Cancelled);
        folder.events(&id).await;
    }
}

#[tokio::test]
async fn a_job_that_takes_too_long_fails() {
    let folder = Folder::new().await;
    let _server = folder
        .serve(&["--script=sleep:60", "--job-time-limit-seconds=1"])
        .await;
    let id = folder.submit(json!({})).await;
    let job = folder.end(&id).await;
    assert_eq!((job.status, job.attempt), (Status::Failed, 1));
    assert_eq!(job.error.unwrap().code, "time_limit");
}

#[tokio::test]
async fn a_killed_training_goes_on_from_its_checkpoint_and_ends_with_the_same_loss() {
    let folder = Folder::new().await;
    let _server = folder
        .serve(&["--checkpoint-seconds=1", "--threads-per-worker=1"])
        .await;
    // Long enough for a checkpoint, and the same work for both jobs.
    let settings = json!({"training": {
        "max_evaluations": 1_500, "max_iterations": 1_500, "patience": 0,
        "tolerance_gradient": 0.0, "tolerance_change": 0.0,
    }});
    let whole = folder.submit(settings.clone()).await;
    let whole = folder.end(&whole).await;
    assert_eq!(whole.status, Status::Succeeded, "{:?}", whole.error);

    let cut = folder.submit(settings).await;
    let worker = folder.running(&cut).await;
    let checkpoint = until("a checkpoint is written", PATIENCE, async || {
        assert_eq!(
            folder.job(&cut).await.status,
            Status::Running,
            "it was too quick to be cut"
        );
        folder.store.of(ours()).checkpoint(&cut).await.unwrap()
    })
    .await;
    kill_process(worker, Signal::KILL).unwrap();
    let cut = folder.end(&cut).await;
    assert_eq!(
        (cut.status, cut.attempt),
        (Status::Succeeded, 2),
        "{:?}",
        cut.error
    );
    assert!(checkpoint.evaluation > 1 && checkpoint.attempt == 1);
    let training = |job: &meshway::jobs::Job| job.report.clone().unwrap()["training"].clone();
    assert_eq!(training(&cut), training(&whole));
    let store = &folder.store;
    let series = store.of(ours()).metrics(&cut.id, 0, 10_000).await.unwrap();
    assert_eq!(
        series,
        store
            .of(ours())
            .metrics(&whole.id, 0, 10_000)
            .await
            .unwrap()
    );
    folder.events(&cut.id).await;
}

#[tokio::test]
async fn one_server_a_folder() {
    let folder = Folder::new().await;
    let _server = folder.serve(&["--script=instant"]).await;
    let second = Command::new(PROGRAM)
        .args(["serve", "--listen=127.0.0.1:0", "--data-dir"])
        .arg(folder.path())
        .output()
        .unwrap();
    assert_eq!(second.status.code(), Some(2));
    let message = String::from_utf8(second.stderr).unwrap();
    assert!(message.contains("another server"), "{message}");
}

#[test]
fn the_configuration_is_printed_and_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| {
        let output = Command::new(PROGRAM)
            .args(["serve", "--print-config"])
            .args(arguments)
            .current_dir(&folder)
            .output()
            .unwrap();
        (
            output.status.code(),
            String::from_utf8(output.stdout).unwrap(),
        )
    };
    let (code, text) = run(&["--queue-limit=7"]);
    assert_eq!(code, Some(0));
    std::fs::write(folder.path().join("meshway.toml"), &text).unwrap();
    assert_eq!(run(&["--config=meshway.toml"]), (Some(0), text));
    let (_, changed) = run(&["--config=meshway.toml", "--queue-limit=8"]);
    assert!(changed.contains("queue_limit = 8"), "{changed}");
    std::fs::write(folder.path().join("meshway.toml"), "quue_limit = 7").unwrap();
    assert_eq!(run(&["--config=meshway.toml"]).0, Some(2));
}
