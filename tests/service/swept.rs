//! Sweeps of servers that are killed.

use std::time::Duration;

use meshway::jobs::{Keep, Lookup, NewJob, NewMesh, Record, Success};
use meshway::reconstruction::Preset;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::json;

use crate::erasure::holds;
use crate::http::support::tetrahedron;
use crate::server::{Folder, PATIENCE, until};
use crate::who::{ours, us};

const JOBS: usize = 40;
/// Kills of servers, which cost a start each.
const KILLS: usize = 10;

#[tokio::test]
async fn what_has_expired_goes_once_whenever_the_server_is_killed() {
    let folder = Folder::new().await;
    let mut ids = Vec::new();
    for _ in 0..JOBS {
        let new = NewJob {
            cloud_id: folder.cloud_id().clone(),
            preset: Preset::Fast,
            settings: Preset::Fast.settings(),
            labels: [("patient".to_owned(), "a-name-of-somebody".to_owned())].into(),
            source: None,
            derived_from: None,
            priority: 0,
            cost_seconds: 1.0,
            keep: Keep {
                ms: Some(1),
                once: false,
            },
        };
        let job = folder.store.by(us()).submit(new, None).await.unwrap();
        let claim = folder.store.claim("worker-0-1", 60_000).await.unwrap();
        let success = Success {
            mesh: NewMesh::new(4, 4, tetrahedron()),
            report: json!({}),
            model: b"the network of somebody".to_vec(),
            last: Record::default(),
        };
        folder
            .store
            .succeed(&claim.unwrap(), success)
            .await
            .unwrap();
        ids.push(job.id);
    }
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let left = async || folder.store.due_jobs(1_000).await.unwrap().len();
    let mut kills = 0;
    while left().await > 0 && kills < KILLS {
        let server = folder.serve(&[]).await;
        tokio::time::sleep(Duration::from_millis(random.random_range(0..200))).await;
        drop(server);
        kills += 1;
    }
    let _server = folder.serve(&[]).await;
    until("all have gone", PATIENCE, async || {
        (left().await == 0).then_some(())
    })
    .await;
    for id in &ids {
        let found = folder.store.of(ours()).job(id).await.unwrap();
        assert!(
            matches!(&found, Lookup::Gone(stone) if stone.reason == "expired"),
            "{found:?}"
        );
    }
    // Each has its row of the trail, and none has two.
    let trail = folder.store.audit_after(0, 1_000).await.unwrap();
    let mut told: Vec<_> = trail.iter().map(|row| row.object.clone()).collect();
    let mut expected: Vec<_> = ids.iter().map(ToString::to_string).collect();
    told.sort();
    expected.sort();
    assert_eq!(told, expected);
    assert!(trail.iter().all(|row| row.event == "job.delete"));
    assert!(folder.store.audit_verify(&[]).await.unwrap().is_ok());
    for mark in [
        b"a-name-of-somebody".as_slice(),
        b"the network of somebody",
        &tetrahedron()[100..160],
    ] {
        until("nothing is left", PATIENCE, async || {
            (!holds(folder.path(), mark)).then_some(())
        })
        .await;
    }
}
