//! What a worker reads and writes about a job, and how it comes back.

use std::fs;

use meshway::jobs::store::CHUNK_BYTES;
use meshway::jobs::{Error, NewCloud, NewEvent, NewMesh, Record};
use meshway::reconstruction::Warning;
use meshway::reconstruction::training::{GradientHistogram, LayerHistogram, Metrics};
use sha2::{Digest, Sha256};

use crate::place::{Place, in_both_places};
use crate::server::{PATIENCE, until};
use super::support::{Bench, new_cloud, success};

fn metrics(evaluation: u64) -> Metrics {
    Metrics {
        iteration: evaluation - 1,
        evaluation,
        loss: 1.0 / evaluation as f64,
        validation_loss: evaluation.is_multiple_of(2).then_some(0.25),
        gradient_norm: 1e-300,
        step_length: f64::INFINITY,
        weight_norms: vec![0.1, f64::MIN_POSITIVE, 3.0],
        blocks: None,
    }
}

fn gradients(evaluation: u64) -> GradientHistogram {
    GradientHistogram {
        evaluation,
        layers: vec![LayerHistogram {
            layer: "linear.0".to_owned(),
            min: -0.1,
            max: 0.3,
            counts: vec![1, 2],
        }],
    }
}

fn rows(evaluations: std::ops::RangeInclusive<u64>) -> Record {
    Record {
        metrics: evaluations.clone().map(metrics).collect(),
        gradients: evaluations.map(gradients).collect(),
        ..Record::default()
    }
}

#[tokio::test]
async fn metrics_and_histograms_come_back_bit_for_bit() {
    let bench = Bench::new().await;
    let id = bench.submit().await.id;
    let claim = bench.claim().await;
    bench.store.record(&claim, rows(1..=5)).await.unwrap();
    bench.store.record(&claim, rows(4..=6)).await.unwrap();
    let all = bench.records().metrics(&id, 0, 100).await.unwrap();
    assert_eq!(all, (1..=6).map(metrics).collect::<Vec<_>>());
    assert_eq!(bench.records().metrics(&id, 3, 2).await.unwrap(), all[3..5]);
    assert_eq!(
        bench.records().gradients(&id).await.unwrap(),
        (1..=6).map(gradients).collect::<Vec<_>>()
    );
    assert_eq!(bench.job(&id).await.metrics, 6);

    let mut broken = metrics(7);
    broken.loss = f64::NAN;
    let record = Record {
        metrics: vec![broken],
        loss: Some(f64::NAN),
        ..Record::default()
    };
    bench.store.record(&claim, record).await.unwrap();
    assert!(
        bench.records().metrics(&id, 6, 1).await.unwrap()[0]
            .loss
            .is_nan()
    );
}

in_both_places! {
async fn an_attempt_starts_again_from_the_checkpoint(place: Place) {
    let bench = Bench::at(place).await;
    let id = bench.submit().await.id;
    let claim = bench.claim().await;
    bench.store.record(&claim, rows(1..=4)).await.unwrap();
    for evaluation in [3, 5] {
        let mesh = NewMesh::new(1, 1, vec![evaluation as u8]);
        bench
            .store
            .put_snapshot(&claim, evaluation, mesh)
            .await
            .unwrap();
    }
    bench
        .store
        .put_checkpoint(&claim, 2, vec![2])
        .await
        .unwrap();
    bench
        .store
        .put_checkpoint(&claim, 3, vec![3])
        .await
        .unwrap();
    bench.store.release(&claim).await.unwrap();
    let again = bench.claim().await;
    assert_eq!((again.job.metrics, again.job.evaluations), (3, 3));
    assert_eq!(bench.records().metrics(&id, 0, 10).await.unwrap().len(), 3);
    assert_eq!(bench.records().gradients(&id).await.unwrap().len(), 3);
    let snapshots = bench.records().snapshots(&id).await.unwrap();
    assert_eq!(
        snapshots
            .iter()
            .map(|mesh| mesh.evaluation)
            .collect::<Vec<_>>(),
        [3]
    );
    let checkpoint = bench.records().checkpoint(&id).await.unwrap().unwrap();
    assert_eq!(
        (checkpoint.evaluation, checkpoint.attempt, checkpoint.data),
        (3, 1, vec![3])
    );
}

async fn a_cloud_that_was_found_is_read_whatever_becomes_of_its_file(place: Place) {
    let bench = Bench::at(place).await;
    let points = b"0 0 1\n0 1 0\n1 0 0\n";
    let new = NewCloud {
        bytes: points.len() as u64,
        ..new_cloud(&hex::encode(Sha256::digest(points)))
    };
    let path = bench.store.cloud_path(&new.sha256);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(&path, points).unwrap();
    let (cloud, _) = if bench.store.keeps_files() {
        bench.acts().insert_cloud(new).await.unwrap()
    } else {
        bench.acts().upload_cloud(new, &path).await.unwrap()
    };
    let file = bench.store.cloud_file(&cloud).await.unwrap().unwrap();
    fs::remove_file(file.path()).unwrap();
    assert_eq!(file.read().unwrap(), points);
    let found = bench.store.cloud_file(&cloud).await.unwrap();
    assert_eq!(found.is_none(), bench.store.keeps_files());
    let Some(file) = found else { return };
    let file = file.unnamed();
    assert!(!file.path().exists(), "a killed process would leave it");
    assert_eq!(file.read().unwrap(), points);
}

async fn meshes_come_back_whole_and_in_parts(place: Place) {
    let bench = Bench::at(place).await;
    let id = bench.submit().await.id;
    let claim = bench.claim().await;
    let data: Vec<u8> = (0..2 * CHUNK_BYTES + 5).map(|i| (i % 251) as u8).collect();
    let old = NewMesh::new(1, 1, vec![0; 3 * CHUNK_BYTES + 1]);
    bench.store.put_snapshot(&claim, 9, old).await.unwrap();
    let old = bench.records().mesh_info(&id, 9).await.unwrap().unwrap();
    let mesh = NewMesh::new(10, 16, data.clone());
    bench
        .store
        .put_snapshot(&claim, 9, mesh.clone())
        .await
        .unwrap();
    let info = bench.records().mesh_info(&id, 9).await.unwrap().unwrap();
    assert_eq!(
        (info.vertices, info.triangles, info.bytes),
        (10, 16, data.len() as u64)
    );
    until("the replaced one is removed", PATIENCE, async || {
        let bytes = bench.store.mesh_bytes(&old).await.unwrap();
        bytes.is_none().then_some(())
    })
    .await;

    let part = async |range| bench.store.object_part(&info.object, range).await.unwrap();
    let (mut read, end) = (Vec::new(), data.len() as u64);
    while (read.len() as u64) < end {
        read.extend(part(read.len() as u64..end).await.unwrap());
    }
    assert!(read == data);
    let from = CHUNK_BYTES as u64 + 3;
    let middle = part(from..from + 7).await.unwrap();
    assert_eq!(middle, data[from as usize..][..7]);
    let whole = bench.store.mesh_bytes(&info).await.unwrap();
    assert!(whole.as_ref() == Some(&data));

    let zero = bench.store.put_snapshot(&claim, 0, mesh).await;
    assert!(matches!(zero, Err(Error::SnapshotAtZero)), "{zero:?}");
    assert_eq!(bench.records().mesh_info(&id, 0).await.unwrap(), None);
    bench.store.succeed(&claim, success()).await.unwrap();
    let result = bench.records().mesh_info(&id, 0).await.unwrap().unwrap();
    // SHA-256 of ten bytes 7, by `printf '\7%.0s' $(seq 10) | sha256sum`.
    assert_eq!(
        result.sha256,
        "bf52943413e4b2e64c1b18f831aae28a7c3e4c2792a99500c06bf6c5a933aab5"
    );
    assert_eq!(bench.records().snapshots(&id).await.unwrap(), [info]);
    assert_eq!(
        bench.records().model(&id).await.unwrap().unwrap().0,
        [1, 2, 3]
    );
}
}

fn progress() -> NewEvent {
    NewEvent::Progress {
        fraction: 0.5,
        eta_seconds: None,
    }
}

#[tokio::test]
async fn limits_leave_out_what_repeats_and_nothing_else() {
    let bench = Bench::with(|options| {
        options.events_limit = 4;
        options.metrics_limit = 3;
    })
    .await;
    let id = bench.submit().await.id;
    let claim = bench.claim().await;
    let record = Record {
        events: vec![
            progress(),
            NewEvent::Metrics(rows(1..=1).metrics.remove(0)),
            progress(),
            NewEvent::Warning(Warning::new("odd", "something is odd")),
        ],
        ..rows(1..=5)
    };
    bench.store.record(&claim, record).await.unwrap();
    bench.store.succeed(&claim, success()).await.unwrap();
    assert_eq!(
        bench.event_names(&id).await,
        [
            "job.queued",
            "job.started",
            "job.progress",
            "training.metrics",
            "job.warning",
            "job.succeeded"
        ]
    );
    assert_eq!(bench.records().metrics(&id, 0, 10).await.unwrap().len(), 3);
}
