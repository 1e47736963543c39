//! Data folders of versions that kept meshes, models and checkpoints among the rows.

use std::path::Path;

use meshway::jobs::store::{CHUNK_BYTES, DATABASE_FILE};
use meshway::jobs::{CloudId, JobId, Options, Store};
use meshway::reconstruction::Preset;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection, SqliteConnection};

use crate::store::migrations::{FOURTH, database};
use crate::who::{ours, us};

/// Bytes of the result, more than one transaction takes.
const MESH_BYTES: usize = 20 * CHUNK_BYTES + 9;

/// What a folder of that version holds: a job with a result, and one with a snapshot and a
/// checkpoint that waits to go on.
struct Old {
    done: JobId,
    waiting: JobId,
    mesh: Vec<u8>,
}

async fn insert_job(db: &mut SqliteConnection, id: &JobId, done: bool) {
    let settings = serde_json::to_string(&Preset::Fast.settings()).unwrap();
    sqlx::query(
        "INSERT INTO jobs (id, cloud_id, status, preset, settings, labels, created_at, attempt,
             finished_at, report, events)
         VALUES (?1, ?2, ?3, 'fast', ?4, '{}', 1, 1, ?5, ?6, 1)",
    )
    .bind(id.as_str())
    .bind(CloudId::at(0).as_str())
    .bind(if done { "succeeded" } else { "queued" })
    .bind(settings)
    .bind(done.then_some(2))
    .bind(done.then_some("{}"))
    .execute(&mut *db)
    .await
    .unwrap();
    sqlx::query(
        "INSERT INTO events (job_id, id, event, time, attempt, data)
         VALUES (?1, 1, 'job.queued', 1, 1, '{\"reason\": {\"code\": \"released\"}}')",
    )
    .bind(id.as_str())
    .execute(db)
    .await
    .unwrap();
}

async fn insert_mesh(db: &mut SqliteConnection, job: &JobId, evaluation: i64, data: &[u8]) {
    let mesh: i64 = sqlx::query_scalar(
        "INSERT INTO meshes (job_id, evaluation, vertices, triangles, bytes, sha256, created_at)
         VALUES (?1, ?2, 4, 4, ?3, 'hash', 1) RETURNING id",
    )
    .bind(job.as_str())
    .bind(evaluation)
    .bind(data.len() as i64)
    .fetch_one(&mut *db)
    .await
    .unwrap();
    for (position, chunk) in (0_i64..).zip(data.chunks(CHUNK_BYTES)) {
        sqlx::query("INSERT INTO mesh_chunks VALUES (?1, ?2, ?3)")
            .bind(mesh)
            .bind(position)
            .bind(chunk)
            .execute(&mut *db)
            .await
            .unwrap();
    }
}

impl Old {
    async fn make(folder: &Path) -> Self {
        let mut db = database(folder, FOURTH).await;
        let old = Self {
            done: JobId::at(0),
            waiting: JobId::at(0),
            mesh: (0..MESH_BYTES).map(|i| (i % 251) as u8).collect(),
        };
        insert_job(&mut db, &old.done, true).await;
        insert_job(&mut db, &old.waiting, false).await;
        insert_mesh(&mut db, &old.done, 0, &old.mesh).await;
        insert_mesh(&mut db, &old.waiting, 3, b"snapshot").await;
        for (statement, job) in [
            (
                "INSERT INTO models VALUES (?1, CAST('network' AS BLOB), 'h')",
                &old.done,
            ),
            (
                "INSERT INTO checkpoints VALUES (?1, 1, 5, CAST('state' AS BLOB), 7)",
                &old.waiting,
            ),
        ] {
            let insert = sqlx::query(statement).bind(job.as_str());
            insert.execute(&mut db).await.unwrap();
        }
        db.close().await.unwrap();
        old
    }

    /// Everything is there.
    async fn check(&self, store: &Store) {
        let result = store
            .of(ours())
            .mesh_info(&self.done, 0)
            .await
            .unwrap()
            .unwrap();
        assert_eq!((result.bytes, &*result.sha256), (MESH_BYTES as u64, "hash"));
        let data = store.mesh_bytes(&result).await.unwrap();
        assert!(data.as_ref() == Some(&self.mesh));
        let model = store.of(ours()).model(&self.done).await.unwrap().unwrap();
        assert_eq!((&*model.0, &*model.1), (&b"network"[..], "h"));
        let snapshots = store.of(ours()).snapshots(&self.waiting).await.unwrap();
        let snapshot = store.mesh_bytes(&snapshots[0]).await.unwrap().unwrap();
        assert_eq!((snapshots[0].evaluation, &*snapshot), (3, &b"snapshot"[..]));
        let checkpoint = store
            .of(ours())
            .checkpoint(&self.waiting)
            .await
            .unwrap()
            .unwrap();
        assert_eq!(
            (checkpoint.attempt, checkpoint.evaluation, &*checkpoint.data),
            (1, 5, &b"state"[..])
        );
        assert_eq!(checkpoint.created_at, 7);
    }
}

async fn connect(folder: &Path) -> SqliteConnection {
    let options = SqliteConnectOptions::new().filename(folder.join(DATABASE_FILE));
    options.connect().await.unwrap()
}

#[tokio::test]
async fn content_of_an_older_folder_is_moved_out_of_the_rows() {
    let folder = tempfile::tempdir().unwrap();
    let old = Old::make(folder.path()).await;
    let open = || Store::open(folder.path(), Options::default());
    for _ in 0..2 {
        let store = open().await.unwrap();
        old.check(&store).await;
        assert_eq!(store.collect_garbage(None).await.unwrap(), 0);
        store.close().await;
    }
    let mut db = connect(folder.path()).await;
    let pages = "SELECT page_count * page_size FROM pragma_page_count, pragma_page_size";
    let bytes: i64 = sqlx::query_scalar(pages).fetch_one(&mut db).await.unwrap();
    assert!(bytes < 1 << 20, "{bytes}");
    let mode: i64 = sqlx::query_scalar("PRAGMA auto_vacuum")
        .fetch_one(&mut db)
        .await
        .unwrap();
    assert_eq!(mode, 2, "incremental");
    let store = open().await.unwrap();
    // The job goes on from its checkpoint.
    let claim = store.claim("w", 6_000).await.unwrap().unwrap();
    assert_eq!((claim.job_id(), claim.job.evaluations), (&old.waiting, 5));
    store.by(us()).delete_job(&old.done).await.unwrap();
    assert_eq!(store.of(ours()).model(&old.done).await.unwrap(), None);
}

#[tokio::test]
async fn moving_that_broke_off_goes_on() {
    for table in ["mesh_chunks", "models", "checkpoints"] {
        let folder = tempfile::tempdir().unwrap();
        let old = Old::make(folder.path()).await;
        let mut db = connect(folder.path()).await;
        // Its bytes are written, and then the process ends.
        let trigger = format!(
            "CREATE TRIGGER ends BEFORE DELETE ON {table}
             BEGIN SELECT RAISE(ABORT, 'the end'); END"
        );
        let made = sqlx::query(sqlx::AssertSqlSafe(trigger));
        made.execute(&mut db).await.unwrap();
        let open = || Store::open(folder.path(), Options::default());
        assert!(open().await.is_err(), "{table}");
        sqlx::query("DROP TRIGGER ends")
            .execute(&mut db)
            .await
            .unwrap();
        let store = open().await.unwrap();
        old.check(&store).await;
        assert_eq!(store.collect_garbage(None).await.unwrap(), 1, "{table}");
        old.check(&store).await;
    }
}
