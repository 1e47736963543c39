//! What becomes of jobs when leases run out, or seem to, although their workers work.

use meshway::jobs::Status;
use serde_json::json;
use sqlx::SqliteConnection;

use crate::server::Folder;

/// Ends all leases at the given time, in milliseconds since the epoch.
async fn end_leases(db: &mut SqliteConnection, time: i64) {
    let statement = "UPDATE jobs SET lease_until = ?1 WHERE status = 'running'";
    let ended = sqlx::query(statement).bind(time).execute(db).await;
    ended.unwrap();
}

#[tokio::test]
async fn a_living_worker_keeps_its_job_whatever_its_lease_says() {
    let folder = Folder::new().await;
    let server = folder.serve(&["--script=sleep:4"]).await;
    let id = folder.submit(json!({})).await;
    folder.running(&id).await;
    let mut db = folder.connection().await;
    // No renewal lasts: as on a disk that is too slow for them, or with a clock that jumps.
    let job = loop {
        end_leases(&mut db, 1).await;
        let job = folder.job(&id).await;
        if job.status != Status::Running {
            break job;
        }
    };
    assert_eq!(
        (job.status, job.attempt, job.failures),
        (Status::Succeeded, 1, 0),
        "{}",
        server.log()
    );
    folder.events(&id).await;
}

#[tokio::test]
async fn a_job_whose_lease_lies_hours_ahead_does_not_wait_for_it() {
    let folder = Folder::new().await;
    let id = folder.submit(json!({})).await;
    // A worker and its server that died before the clock was set back.
    let claim = folder.store.claim("worker-0-1", 3_600_000).await.unwrap();
    assert_eq!(claim.unwrap().attempt, 1);
    let _server = folder.serve(&["--script=instant"]).await;
    let job = folder.end(&id).await;
    assert_eq!((job.status, job.attempt), (Status::Succeeded, 2));
}
