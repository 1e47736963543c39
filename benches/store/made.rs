//! What benchmarks of the store write.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use futures_util::future::join_all;
use meshway::jobs::{CloudId, Keep, NewCloud, NewEvent, NewJob, Record};
use meshway::reconstruction::Preset;
use meshway::reconstruction::training::Metrics;
use serde_json::json;
use sqlx::postgres::PgConnectOptions;
use sqlx::{AssertSqlSafe, ConnectOptions};

/// How long each figure is measured.
pub(crate) const LONG: Duration = Duration::from_secs(3);

/// How often in a second something is done by clients who do it again and again.
pub(crate) async fn rate(clients: usize, work: impl AsyncFn(usize)) -> f64 {
    let begun = Instant::now();
    let client = async |client: usize| {
        let mut done = 0;
        while begun.elapsed() < LONG {
            work(client).await;
            done += 1;
        }
        done
    };
    let done: u64 = join_all((0..clients).map(client)).await.iter().sum();
    done as f64 / begun.elapsed().as_secs_f64()
}

/// A database that nobody has used.
pub(crate) async fn new_database(server: &str) -> String {
    let options: PgConnectOptions = server.parse().unwrap();
    let name = format!("bench_{}", uuid::Uuid::now_v7().simple());
    let create = AssertSqlSafe(format!("CREATE DATABASE {name}"));
    let mut db = options.connect().await.unwrap();
    sqlx::raw_sql(create).execute(&mut db).await.unwrap();
    options.database(&name).to_url_lossy().to_string()
}

/// A small cloud.
pub(crate) fn cloud() -> NewCloud {
    let summary = json!({
        "format": "xyz", "gzipped": false, "points": 20, "normals": false, "dropped_non_finite": 0,
        "warnings": [], "bounds": {"min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 1.0]},
        "labels": {"surface": 20, "interior": 0, "exterior": 0},
    });
    NewCloud {
        sha256: "a".repeat(64),
        bytes: 12,
        summary: serde_json::from_value(summary).unwrap(),
        keep_ms: None,
    }
}

/// A quick job.
pub(crate) fn job(cloud: &CloudId) -> NewJob {
    NewJob {
        cloud_id: cloud.clone(),
        preset: Preset::Fast,
        settings: Preset::Fast.settings(),
        labels: BTreeMap::new(),
        source: None,
        derived_from: None,
        priority: 0,
        cost_seconds: 1.0,
        keep: Keep::default(),
    }
}

/// Progress and a row of the series, as a worker writes them four times a second.
pub(crate) fn record(evaluation: u64) -> Record {
    let metrics = Metrics {
        iteration: evaluation,
        evaluation,
        loss: 0.5,
        validation_loss: Some(0.6),
        gradient_norm: 1.0,
        step_length: 1.0,
        weight_norms: vec![1.0; 4],
        blocks: None,
    };
    let progress = NewEvent::Progress {
        fraction: 0.5,
        eta_seconds: Some(10.0),
    };
    Record {
        progress: Some(0.5),
        evaluations: Some(evaluation),
        loss: Some(0.5),
        events: vec![progress],
        metrics: vec![metrics],
        ..Record::default()
    }
}
