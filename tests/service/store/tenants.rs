//! Records of the version before there were tenants, and those of two of them.

use meshway::identity::{Caller, Tenant};
use meshway::jobs::{
    CloudDeletion, CloudId, IdempotencyState, JobFilter, JobId, Lookup, Options, Store,
};
use serde_json::json;
use sqlx::Connection;

use crate::store::migrations::{NINTH, database};
use super::support::{Bench, new_cloud};
use crate::who::{ours, us};

fn stranger() -> Caller {
    Caller {
        tenant: "surgery".parse().unwrap(),
        ..Caller::anybody()
    }
}

#[tokio::test]
async fn records_from_before_tenants_belong_to_the_default_one() {
    let folder = tempfile::tempdir().unwrap();
    let mut db = database(folder.path(), NINTH).await;
    let (cloud, job, erased) = (CloudId::at(0), JobId::at(0), JobId::at(0));
    let summary = json!({
        "format": "xyz", "gzipped": false, "points": 20, "normals": false, "dropped_non_finite": 0, "warnings": [],
        "bounds": {"min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 1.0]},
        "labels": {"surface": 20, "interior": 0, "exterior": 0},
    });
    let settings = meshway::reconstruction::Preset::Fast.settings();
    let settings = serde_json::to_string(&settings).unwrap();
    for (statement, values) in [
        (
            "INSERT INTO clouds VALUES (?1, 'a', 1, 'xyz', 20, ?2, 1)",
            [cloud.as_str(), &summary.to_string(), ""],
        ),
        (
            "INSERT INTO jobs (id, cloud_id, status, preset, settings, labels, created_at, events)
             VALUES (?1, ?2, 'queued', 'fast', ?3, '{}', 1, 1)",
            [job.as_str(), cloud.as_str(), &settings],
        ),
        (
            "INSERT INTO events (job_id, id, event, time, attempt, data)
             VALUES (?1, 1, 'job.queued', 1, 0, '{}')",
            [job.as_str(), "", ""],
        ),
        (
            "INSERT INTO tombstones VALUES (?1, 1, 'deleted')",
            [erased.as_str(), "", ""],
        ),
        (
            "INSERT INTO idempotency (key, scope, request_sha256, job_id, status, created_at)
             VALUES ('k', 's', 'h', ?1, 202, 1)",
            [job.as_str(), "", ""],
        ),
    ] {
        let query = sqlx::query(statement);
        let bound = values.iter().fold(query, |query, value| query.bind(*value));
        bound.execute(&mut db).await.unwrap();
    }
    db.close().await.unwrap();

    let store = Store::open(folder.path(), Options::default())
        .await
        .unwrap();
    let records = store.of(ours());
    assert_eq!(records.cloud(&cloud).await.unwrap().unwrap().bytes, 1);
    let found = records.job(&job).await.unwrap().found().unwrap();
    assert_eq!(found.tenant, Tenant::default());
    assert_eq!(records.all_events_after(0, 10).await.unwrap().len(), 1);
    let gone = records.job(&erased).await.unwrap();
    assert!(matches!(gone, Lookup::Gone(_)), "{gone:?}");
    let answered = store.by(us()).idempotency_begin("k", "s", "h").await;
    assert!(matches!(answered, Ok(IdempotencyState::Replay(_))));
    // They are nobody else's, and go on as before.
    let other = stranger();
    assert_eq!(store.of(&other.tenant).cloud(&cloud).await.unwrap(), None);
    assert_eq!(
        store.of(&other.tenant).job(&job).await.unwrap(),
        Lookup::Missing
    );
    assert_eq!(
        store.of(&other.tenant).job(&erased).await.unwrap(),
        Lookup::Missing
    );
    assert!(store.claim("w", 1_000).await.unwrap().is_some());
}

#[tokio::test]
async fn whatever_is_asked_in_the_name_of_another_tenant_finds_nothing() {
    let bench = Bench::new().await;
    let job = bench.submit().await;
    let claim = bench.claim().await;
    let mesh = || meshway::jobs::NewMesh::new(4, 4, vec![7; 10]);
    let store = &bench.store;
    store.put_snapshot(&claim, 5, mesh()).await.unwrap();
    store.put_checkpoint(&claim, 5, vec![1]).await.unwrap();
    let other = stranger();
    let records = store.of(&other.tenant);
    let id = &job.id;
    assert_eq!(records.job(id).await.unwrap(), Lookup::Missing);
    assert!(records.events_after(id, 0, 10).await.unwrap().is_empty());
    assert!(records.all_events_after(0, 10).await.unwrap().is_empty());
    assert_eq!(records.last_seq().await.unwrap(), 0);
    assert!(records.metrics(id, 0, 10).await.unwrap().is_empty());
    assert!(records.gradients(id).await.unwrap().is_empty());
    assert!(records.snapshots(id).await.unwrap().is_empty());
    assert_eq!(records.mesh_info(id, 5).await.unwrap(), None);
    assert_eq!(records.checkpoint(id).await.unwrap(), None);
    let all = JobFilter::default();
    assert!(records.list_jobs(&all, None, 10).await.unwrap().is_empty());
    assert!(records.list_clouds(None, 10).await.unwrap().is_empty());
    assert_eq!(records.cloud(&bench.cloud_id).await.unwrap(), None);
    assert_eq!(records.cloud_by_sha256("a").await.unwrap(), None);
    let acts = store.by(&other);
    assert_eq!(acts.request_cancel(id).await.unwrap(), Lookup::Missing);
    assert_eq!(acts.delete_job(id).await.unwrap(), Lookup::Missing);
    let deletion = acts.delete_cloud(&bench.cloud_id).await.unwrap();
    assert_eq!(deletion, CloudDeletion::Missing);
    // Waiting, it has a place in the queue for its tenant alone.
    store.release(&claim).await.unwrap();
    assert_eq!(records.place(id).await.unwrap(), None);
    assert!(records.places().await.unwrap().is_empty());
    let place = store.of(ours()).place(id).await.unwrap();
    assert_eq!(place.map(|place| place.position), Some(1));
    // The same bytes are another cloud of the other one.
    let (cloud, created) = acts.insert_cloud(new_cloud("a")).await.unwrap();
    assert!(created && cloud.id != bench.cloud_id);
    acts.delete_cloud(&cloud.id).await.unwrap();
    assert!(store.holds_sha256("a").await.unwrap());
}
