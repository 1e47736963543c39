//! Large content: apart from the rows, never lost while it is named, and no room left of it after.

use std::fs;
use std::time::Duration;

use meshway::jobs::store::{CHUNK_BYTES, CONTENT_FILE};
use meshway::jobs::{Error, Lease, NewMesh};

use crate::place::{Place, in_both_places};
use crate::server::{PATIENCE, until};
use super::support::{Bench, LEASE_MS, success};

/// Objects of the content, by their makers.
async fn makers(bench: &Bench) -> Vec<String> {
    let mut db = bench.content().await;
    let select = "SELECT made_by FROM objects ORDER BY made_by";
    sqlx::query_scalar(select).fetch_all(&mut db).await.unwrap()
}

#[tokio::test]
async fn a_large_write_stands_before_no_lease_and_no_submit() {
    let bench = Bench::new().await;
    bench.submit().await;
    let claim = bench.claim().await;
    let mut content = bench.content().await;
    let lock = "BEGIN IMMEDIATE";
    sqlx::query(lock).execute(&mut content).await.unwrap();
    let checkpoint = {
        let (store, claim) = (bench.store.clone(), claim.clone());
        let data = vec![1; 3 * CHUNK_BYTES];
        tokio::spawn(async move { store.put_checkpoint(&claim, 5, data).await })
    };
    let lease = bench.store.renew(&claim, LEASE_MS, Duration::ZERO).await;
    let held = Lease::Held {
        cancel_requested: false,
    };
    assert_eq!(lease.unwrap(), held);
    bench.submit().await;
    assert!(!checkpoint.is_finished());
    sqlx::query("ROLLBACK").execute(&mut content).await.unwrap();
    checkpoint.await.unwrap().unwrap();
    let written = bench.records().checkpoint(claim.job_id()).await.unwrap();
    assert_eq!(written.unwrap().data, vec![1; 3 * CHUNK_BYTES]);
}

#[tokio::test]
async fn what_a_dead_process_left_is_collected_and_nothing_that_is_named() {
    let bench = Bench::new().await;
    let id = bench.submit().await.id;
    let claim = bench.claim().await;
    bench.store.succeed(&claim, success()).await.unwrap();
    let mut content = bench.content().await;
    for (key, maker) in [("k1", "worker-0-1"), ("k2", "worker-0-2")] {
        for statement in [
            "INSERT INTO objects (key, made_by, created_at) VALUES (?1, ?2, 1)",
            "INSERT INTO chunks (object, position, data) VALUES (?1, 0, x'07')",
        ] {
            let insert = sqlx::query(statement).bind(key).bind(maker);
            insert.execute(&mut content).await.unwrap();
        }
    }
    let collect = async |maker| bench.store.collect_garbage(maker).await.unwrap();
    assert_eq!(collect(Some("worker-0-1")).await, 1);
    until("one is gone", PATIENCE, async || {
        (makers(&bench).await == ["", "", "worker-0-2"]).then_some(())
    })
    .await;
    assert_eq!(collect(None).await, 1);
    until("the other is gone", PATIENCE, async || {
        (makers(&bench).await == ["", ""]).then_some(())
    })
    .await;
    assert_eq!(collect(None).await, 0);
    let mesh = bench.records().mesh_info(&id, 0).await.unwrap().unwrap();
    let bytes = bench.store.mesh_bytes(&mesh).await.unwrap().unwrap();
    assert_eq!(bytes, [7; 10]);
    assert_eq!(
        bench.records().model(&id).await.unwrap().unwrap().0,
        [1, 2, 3]
    );
}

in_both_places! {
async fn content_that_was_refused_stale_or_replaced_does_not_stay(place: Place) {
    let bench = Bench::at(place).await;
    bench.submit().await;
    let claim = bench.claim().await;
    for byte in 0..5 {
        let checkpoint = bench.store.put_checkpoint(&claim, 1, vec![byte]);
        checkpoint.await.unwrap();
        let mesh = NewMesh::new(1, 1, vec![byte]);
        bench.store.put_snapshot(&claim, 3, mesh).await.unwrap();
    }
    until("only the last ones are left", PATIENCE, async || {
        (bench.objects().await == 2).then_some(())
    })
    .await;
    bench.store.release(&claim).await.unwrap();
    let stale = bench.store.put_checkpoint(&claim, 1, vec![9]).await;
    assert!(matches!(stale, Err(Error::Stale)), "{stale:?}");
    // The snapshot lies after the checkpoint and is made again; the checkpoint goes with the end.
    let claim = bench.claim().await;
    bench.store.cancelled(&claim).await.unwrap();
    until("nothing is left", PATIENCE, async || {
        (bench.objects().await == 0).then_some(())
    })
    .await;
}

async fn garbage_is_told_from_what_is_about_to_be_named(place: Place) {
    let bench = Bench::at(place).await;
    let id = bench.submit().await.id;
    let claim = bench.claim().await;
    let collector = {
        let store = bench.second().await;
        tokio::spawn(async move {
            loop {
                store.collect_garbage(None).await.unwrap();
            }
        })
    };
    let mut named = 0;
    for evaluation in 1..=40 {
        let data = vec![evaluation as u8; 18 * CHUNK_BYTES];
        let put = bench
            .store
            .put_snapshot(&claim, evaluation, NewMesh::new(1, 1, data));
        match put.await {
            Ok(()) => named += 1,
            // Taken for garbage: a worker writes it again. In the middle of it, its key is gone.
            Err(Error::Busy | Error::Database(_)) => {}
            Err(error) => panic!("{error}"),
        }
    }
    collector.abort();
    let meshes = bench.records().snapshots(&id).await.unwrap();
    assert_eq!(meshes.len(), named);
    for mesh in meshes {
        let bytes = bench.store.mesh_bytes(&mesh).await.unwrap().unwrap();
        assert!(bytes == vec![mesh.evaluation as u8; 18 * CHUNK_BYTES]);
    }
}
}

#[tokio::test]
async fn erasing_gives_the_space_back() {
    let bench = Bench::new().await;
    let id = bench.submit().await.id;
    let claim = bench.claim().await;
    let mut large = success();
    large.mesh = NewMesh::new(1, 1, vec![1; 32 << 20]);
    bench.store.succeed(&claim, large).await.unwrap();
    let bytes = || {
        let files = ["", "-wal"].map(|end| bench.path().join(format!("{CONTENT_FILE}{end}")));
        files
            .iter()
            .map(|file| fs::metadata(file).unwrap().len())
            .sum::<u64>()
    };
    assert!(bytes() > 32 << 20);
    bench.acts().delete_job(&id).await.unwrap();
    until("the files are small", PATIENCE, async || {
        (bytes() < 1 << 20).then_some(())
    })
    .await;
}
