//! Databases of earlier versions, with what they hold.

use std::path::Path;

use crate::who::{ours, us};
use meshway::jobs::store::DATABASE_FILE;
use meshway::jobs::{
    BatchId, CloudId, IdempotencyState, JobId, Keep, KeepChange, NewWebhook, News, Options, Store,
};
use meshway::reconstruction::Preset;
use serde_json::json;
use sqlx::migrate::{Migration, MigrationType, Migrator};
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode};
use sqlx::{ConnectOptions, Connection, SqlSafeStr, SqliteConnection};

/// Names and texts of migrations, in their order.
type Migrations = [(&'static str, &'static str)];

/// Those of all earlier versions.
const EARLIER: [(&str, &str); 15] = [
    ("init", include_str!("../../../migrations/0001_init.sql")),
    (
        "erased_clouds",
        include_str!("../../../migrations/0002_erased_clouds.sql"),
    ),
    (
        "answers_about_clouds",
        include_str!("../../../migrations/0003_answers_about_clouds.sql"),
    ),
    (
        "jobs_by_verdict",
        include_str!("../../../migrations/0004_jobs_by_verdict.sql"),
    ),
    (
        "metrics_of_blocks",
        include_str!("../../../migrations/0005_metrics_of_blocks.sql"),
    ),
    ("work", include_str!("../../../migrations/0006_work.sql")),
    (
        "objects",
        include_str!("../../../migrations/0007_objects.sql"),
    ),
    (
        "verdicts_of_snapshots",
        include_str!("../../../migrations/0008_verdicts_of_snapshots.sql"),
    ),
    (
        "sources",
        include_str!("../../../migrations/0009_sources.sql"),
    ),
    (
        "tenants",
        include_str!("../../../migrations/0010_tenants.sql"),
    ),
    ("turns", include_str!("../../../migrations/0011_turns.sql")),
    ("keys", include_str!("../../../migrations/0012_keys.sql")),
    (
        "uploads",
        include_str!("../../../migrations/0013_uploads.sql"),
    ),
    (
        "retention",
        include_str!("../../../migrations/0014_retention.sql"),
    ),
    (
        "batches",
        include_str!("../../../migrations/0015_batches.sql"),
    ),
];

/// Those of the version before answers knew their clouds.
const SECOND: &Migrations = EARLIER.split_at(2).0;
/// Those of the version before the series told of blocks.
pub(crate) const FOURTH: &Migrations = EARLIER.split_at(4).0;
/// Those of the version before tenants.
pub(crate) const NINTH: &Migrations = EARLIER.split_at(9).0;
/// Those of the version before tenants took turns, uploads could go on and records had a time to live.
pub(crate) const TENTH: &Migrations = EARLIER.split_at(10).0;
/// Those of the version before batches.
const FOURTEENTH: &Migrations = EARLIER.split_at(14).0;
/// Those of the version before webhooks.
const FIFTEENTH: &Migrations = EARLIER.split_at(15).0;

/// A database as the version with these migrations made it.
pub(crate) async fn database(folder: &Path, migrations: &Migrations) -> SqliteConnection {
    let mut db = SqliteConnectOptions::new()
        .filename(folder.join(DATABASE_FILE))
        .create_if_missing(true)
        .journal_mode(SqliteJournalMode::Wal)
        .connect()
        .await
        .unwrap();
    let migrations = (1..).zip(migrations).map(|(version, &(name, sql))| {
        let (name, sql) = (name.into(), sql.into_sql_str());
        Migration::new(version, name, MigrationType::Simple, sql, true)
    });
    let migrator = Migrator::with_migrations(migrations.collect());
    migrator.run_direct(None, &mut db, false).await.unwrap();
    db
}

async fn keep(db: &mut SqliteConnection, key: &str, scope: &str, body: Option<&str>) {
    sqlx::query(
        "INSERT INTO idempotency (key, scope, request_sha256, status, headers, body, created_at)
         VALUES (?1, ?2, 'h', ?3, '[[\"location\",\"/x\"]]', ?4, 1)",
    )
    .bind(key)
    .bind(scope)
    .bind(body.map(|_| 201))
    .bind(body.unwrap_or_default().as_bytes())
    .execute(db)
    .await
    .unwrap();
}

#[tokio::test]
async fn series_from_before_blocks_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let mut db = database(folder.path(), FOURTH).await;
    let id = JobId::at(0);
    sqlx::query(
        "INSERT INTO jobs (id, cloud_id, status, preset, settings, labels, created_at, metrics)
         VALUES (?1, 'c', 'queued', 'fast', '{}', '{}', 1, 1)",
    )
    .bind(id.as_str())
    .execute(&mut db)
    .await
    .unwrap();
    sqlx::query("INSERT INTO metrics VALUES (?1, 3, 2, 0.5, NULL, 0.1, 1.0, x'')")
        .bind(id.as_str())
        .execute(&mut db)
        .await
        .unwrap();
    db.close().await.unwrap();

    let store = Store::open(folder.path(), Options::default())
        .await
        .unwrap();
    let rows = store.of(ours()).metrics(&id, 0, 10).await.unwrap();
    assert_eq!(rows.len(), 1);
    assert_eq!((rows[0].evaluation, rows[0].iteration), (3, 2));
    assert_eq!(rows[0].blocks, None);
}

#[tokio::test]
async fn answers_about_clouds_are_found_in_older_databases() {
    let folder = tempfile::tempdir().unwrap();
    let mut db = database(folder.path(), SECOND).await;
    let (here, erased) = (CloudId::at(0), CloudId::at(0));
    let summary = json!({
        "format": "xyz", "gzipped": false, "points": 20, "normals": false, "dropped_non_finite": 0, "warnings": [],
        "bounds": {"min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 1.0]},
        "labels": {"surface": 20, "interior": 0, "exterior": 0},
    });
    sqlx::query("INSERT INTO clouds VALUES (?1, 'a', 1, 'xyz', 20, ?2, 1)")
        .bind(here.as_str())
        .bind(summary.to_string())
        .execute(&mut db)
        .await
        .unwrap();
    sqlx::query("INSERT INTO tombstones VALUES (?1, 1, 'deleted')")
        .bind(erased.as_str())
        .execute(&mut db)
        .await
        .unwrap();
    let answer = |id: &CloudId| json!({"id": id, "sha256": "secret"}).to_string();
    let uploads = "POST /v1/clouds";
    keep(&mut db, "here", uploads, Some(&answer(&here))).await;
    keep(&mut db, "erased", uploads, Some(&answer(&erased))).await;
    keep(&mut db, "in flight", uploads, None).await;
    keep(&mut db, "job", "POST /v1/jobs", Some(r#"{"id": "job_1"}"#)).await;
    db.close().await.unwrap();

    let store = Store::open(folder.path(), Options::default())
        .await
        .unwrap();
    let begin = async |key: &str, scope: &str| {
        let state = store.by(us()).idempotency_begin(key, scope, "h");
        state.await.unwrap()
    };
    let body = |state: &IdempotencyState| match state {
        IdempotencyState::Replay(stored) => String::from_utf8(stored.body.clone()).unwrap(),
        state => panic!("{state:?}"),
    };
    assert_eq!(body(&begin("here", uploads).await), answer(&here));
    let gone = begin("erased", uploads).await;
    assert!(matches!(gone, IdempotencyState::CloudGone(_)), "{gone:?}");
    let open = begin("in flight", uploads).await;
    assert_eq!(open, IdempotencyState::InFlight);
    let job = begin("job", "POST /v1/jobs").await;
    assert_eq!(body(&job), r#"{"id": "job_1"}"#);
    // What was erased is emptied, now and later.
    let options = SqliteConnectOptions::new().filename(folder.path().join(DATABASE_FILE));
    let mut db = options.connect().await.unwrap();
    let bodies = "SELECT key FROM idempotency WHERE length(body) > 0 ORDER BY key";
    let kept: Vec<String> = sqlx::query_scalar(bodies).fetch_all(&mut db).await.unwrap();
    assert_eq!(kept, ["here", "job"]);
    store.by(us()).delete_cloud(&here).await.unwrap();
    let kept: Vec<String> = sqlx::query_scalar(bodies).fetch_all(&mut db).await.unwrap();
    assert_eq!(kept, ["job"]);
    let gone = begin("here", uploads).await;
    assert!(matches!(gone, IdempotencyState::CloudGone(_)), "{gone:?}");
}

#[tokio::test]
async fn what_older_databases_hold_is_kept_until_somebody_erases_it() {
    let folder = tempfile::tempdir().unwrap();
    let mut db = database(folder.path(), TENTH).await;
    let (cloud, job) = (CloudId::at(0), JobId::at(0));
    let summary = json!({
        "format": "xyz", "gzipped": false, "points": 20, "normals": false, "dropped_non_finite": 0, "warnings": [],
        "bounds": {"min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 1.0]},
        "labels": {"surface": 20, "interior": 0, "exterior": 0},
    });
    sqlx::query("INSERT INTO clouds VALUES (?1, 'default', 'a', 1, 'xyz', 20, ?2, 1)")
        .bind(cloud.as_str())
        .bind(summary.to_string())
        .execute(&mut db)
        .await
        .unwrap();
    let settings = serde_json::to_string(&Preset::Fast.settings()).unwrap();
    sqlx::query(
        "INSERT INTO jobs (id, cloud_id, status, preset, settings, labels, created_at, finished_at)
         VALUES (?1, ?2, 'cancelled', 'fast', ?3, '{}', 1, 2)",
    )
    .bind(job.as_str())
    .bind(cloud.as_str())
    .bind(settings)
    .execute(&mut db)
    .await
    .unwrap();
    db.close().await.unwrap();

    let store = Store::open(folder.path(), Options::default())
        .await
        .unwrap();
    let found = store.of(ours()).cloud(&cloud).await.unwrap().unwrap();
    assert_eq!((found.expires_at, found.hold), (None, false));
    let found = store.of(ours()).job(&job).await.unwrap().found().unwrap();
    assert_eq!((found.expires_at, found.hold), (None, false));
    assert_eq!(found.keep, Keep::default());
    assert!(store.due_jobs(10).await.unwrap().is_empty());
    assert!(store.due_clouds(10).await.unwrap().is_empty());
    assert!(store.uploads_with_files().await.unwrap().is_empty());
    // It can be held, and kept for a time, like any other.
    let change = KeepChange {
        keep: Some(Keep {
            ms: Some(1),
            once: false,
        }),
        hold: Some(true),
        ..KeepChange::default()
    };
    let held = store.by(us()).keep_job(&job, change).await.unwrap();
    assert!(
        held.found()
            .is_some_and(|job| job.hold && job.expires_at.is_some())
    );
    assert!(store.by(us()).delete_job(&job).await.is_err());
}

#[tokio::test]
async fn jobs_from_before_batches_are_in_none() {
    let folder = tempfile::tempdir().unwrap();
    let mut db = database(folder.path(), FOURTEENTH).await;
    let job = JobId::at(0);
    let settings = serde_json::to_string(&Preset::Fast.settings()).unwrap();
    sqlx::query(
        "INSERT INTO jobs (id, cloud_id, status, preset, settings, labels, created_at, progress)
         VALUES (?1, ?2, 'queued', 'fast', ?3, '{}', 1, 0.5)",
    )
    .bind(job.as_str())
    .bind(CloudId::at(0).as_str())
    .bind(settings)
    .execute(&mut db)
    .await
    .unwrap();
    sqlx::query(
        "INSERT INTO idempotency (tenant, key, scope, request_sha256, job_id, status, created_at)
         VALUES ('default', 'k', 'POST /v1/jobs', 'h', ?1, 202, 1)",
    )
    .bind(job.as_str())
    .execute(&mut db)
    .await
    .unwrap();
    db.close().await.unwrap();

    let store = Store::open(folder.path(), Options::default())
        .await
        .unwrap();
    let found = store.of(ours()).job(&job).await.unwrap().found().unwrap();
    assert_eq!(found.batch_id, None);
    assert!(
        store
            .of(ours())
            .list_batches(None, 10)
            .await
            .unwrap()
            .is_empty()
    );
    let state = store.by(us()).idempotency_begin("k", "POST /v1/jobs", "h");
    let state = state.await.unwrap();
    assert!(matches!(state, IdempotencyState::Replay(_)), "{state:?}");
    // Claimed and begun anew, though it goes back to 0, and erased.
    let claim = store.claim("worker-0-1", 60_000).await.unwrap().unwrap();
    assert_eq!(claim.job_id(), &job);
    store.by(us()).delete_job(&job).await.unwrap();
}

#[tokio::test]
async fn a_batch_from_before_webhooks_is_told_of() {
    let folder = tempfile::tempdir().unwrap();
    let mut db = database(folder.path(), FIFTEENTH).await;
    let (job, batch) = (JobId::at(0), BatchId::at(0));
    let settings = serde_json::to_string(&Preset::Fast.settings()).unwrap();
    let insert = "INSERT INTO batches (id, tenant, made, created_at) VALUES (?1, 'default', 1, 1)";
    let insert = sqlx::query(insert).bind(batch.as_str());
    insert.execute(&mut db).await.unwrap();
    sqlx::query(
        "INSERT INTO jobs (id, cloud_id, status, preset, settings, labels, created_at, batch_id)
         VALUES (?1, ?2, 'queued', 'fast', ?3, '{}', 1, ?4)",
    )
    .bind(job.as_str())
    .bind(CloudId::at(0).as_str())
    .bind(settings)
    .bind(batch.as_str())
    .execute(&mut db)
    .await
    .unwrap();
    db.close().await.unwrap();

    let store = Store::open(folder.path(), Options::default())
        .await
        .unwrap();
    assert!(store.of(ours()).webhooks().await.unwrap().is_empty());
    let new = NewWebhook {
        url: "https://example.org/".to_owned(),
        events: News::ALL.to_vec(),
        secret: vec![7; 32],
    };
    let hook = store
        .by(us())
        .create_webhook(new, 1)
        .await
        .unwrap()
        .unwrap();
    store.by(us()).request_cancel(&job).await.unwrap();
    let told = store
        .of(ours())
        .deliveries(&hook.id, None, 10)
        .await
        .unwrap();
    let names: Vec<_> = told.iter().map(|message| message.news.name()).collect();
    assert_eq!(names, ["batch.ended", "job.cancelled"]);
}
