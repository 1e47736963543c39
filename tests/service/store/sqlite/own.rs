//! What is `SQLite`'s own: its lock, a full file, the folder, its settings.

use std::time::Duration;

use meshway::jobs::{Error, Options, Status, Store};

use crate::store::sqlite::support::{Bench, LEASE_MS, new_cloud, success};

#[tokio::test]
async fn a_locked_database_is_busy_after_a_while_and_recovers() {
    let bench = Bench::with(|options| options.busy_timeout = Duration::from_secs(2)).await;
    let job = bench.submit().await;
    let mut other = bench.bare().await;
    other.run("BEGIN IMMEDIATE").await.unwrap();
    let refused = bench.acts().submit(bench.new_job(), None).await;
    assert!(matches!(refused, Err(Error::Busy)), "{refused:?}");
    assert!(matches!(
        bench.store.check_writable().await,
        Err(Error::Busy)
    ));
    assert!(bench.store.claim("w", LEASE_MS).await.is_err());
    assert_eq!(bench.job(&job.id).await, job, "reading goes on");
    other.run("ROLLBACK").await.unwrap();
    bench.store.check_writable().await.unwrap();
    assert_eq!(bench.claim().await.job.id, job.id);
}

#[tokio::test]
async fn a_full_database_refuses_writes_whole_and_recovers() {
    let bench = Bench::new().await;
    let id = bench.submit().await.id;
    let claim = bench.claim().await;
    let mut large = success();
    large.mesh = meshway::jobs::NewMesh::new(1, 1, vec![1; 4 << 20]);
    // A trigger stands in for a full disk: it refuses the second chunk of a mesh.
    let mut db = bench.content().await;
    sqlx::query(
        "CREATE TRIGGER refuse BEFORE INSERT ON chunks WHEN NEW.position = 1
         BEGIN SELECT RAISE(ROLLBACK, 'no room'); END",
    )
    .execute(&mut db)
    .await
    .unwrap();
    let (refused, other) = futures_util::join!(
        bench.store.succeed(&claim, large.clone()),
        bench.acts().insert_cloud(new_cloud("b"))
    );
    assert!(refused.is_err());
    // RAISE(ROLLBACK) ends the transaction as a full disk does: the group fails as one, or the
    // other request was in another group; never is there an answer without a row.
    let there = bench.records().cloud_by_sha256("b").await.unwrap();
    assert_eq!(other.is_ok(), there.is_some());
    assert_eq!(bench.job(&id).await, claim.job);
    assert_eq!(bench.records().mesh_info(&id, 0).await.unwrap(), None);
    assert_eq!(bench.records().model(&id).await.unwrap(), None);
    sqlx::query("DROP TRIGGER refuse")
        .execute(&mut db)
        .await
        .unwrap();
    bench.store.succeed(&claim, large).await.unwrap();
    assert_eq!(bench.job(&id).await.status, Status::Succeeded);
}

#[tokio::test]
async fn processes_that_open_a_new_folder_together_agree() {
    let dir = tempfile::tempdir().unwrap();
    let opened =
        futures_util::future::join_all((0..6).map(|_| Store::open(dir.path(), Options::default())))
            .await;
    for store in opened {
        store.unwrap().check_writable().await.unwrap();
    }
}

#[tokio::test]
async fn a_folder_that_is_not_there_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    assert!(
        Store::open(&dir.path().join("none"), Options::default())
            .await
            .is_err()
    );
    std::fs::write(dir.path().join("meshway.db"), [b'x'; 4096]).unwrap();
    assert!(Store::open(dir.path(), Options::default()).await.is_err());
}

#[tokio::test]
async fn the_database_is_durable_by_its_settings() {
    let bench = Bench::new().await;
    let mut db = bench.bare().await;
    assert_eq!(db.texts("PRAGMA journal_mode").await, ["wal"]);
    assert_eq!(db.texts("PRAGMA integrity_check").await, ["ok"]);
}
