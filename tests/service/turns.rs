//! Tenants take turns at one worker, whatever the others have put into the queue.

use meshway::identity::Caller;
use meshway::jobs::{Event, EventKind, JobId, Keep, NewJob};
use meshway::reconstruction::{Preset, Settings};
use serde_json::json;

use crate::server::{Folder, PATIENCE, until};
use crate::store::support::new_cloud;

#[tokio::test]
async fn a_job_of_half_a_second_starts_after_one_of_a_hundred_long_ones() {
    let folder = Folder::new().await;
    let submit = async |caller: &Caller, milliseconds: u64, cost_seconds: f64| {
        let acts = folder.store.by(caller);
        let cloud = acts.insert_cloud(new_cloud(&"a".repeat(64))).await.unwrap();
        let settings = json!({"training": {"seed": milliseconds}});
        let new = NewJob {
            cloud_id: cloud.0.id,
            preset: Preset::Fast,
            settings: Settings::resolve(Preset::Fast, &settings).unwrap(),
            labels: std::collections::BTreeMap::new(),
            source: None,
            derived_from: None,
            priority: 0,
            cost_seconds,
            keep: Keep::default(),
        };
        let acts = folder.store.by(caller);
        acts.submit(new, None).await.unwrap().id
    };
    let of = |tenant: &str| Caller {
        tenant: tenant.parse().unwrap(),
        ..Caller::anybody()
    };
    let (many, few) = (of("many"), of("few"));
    for _ in 0..100 {
        submit(&many, 2_000, 2.0).await;
    }
    let _server = folder.serve(&["--script=seed", "--workers=1"]).await;
    let events = async || folder.store.events_of_all(0, 10_000).await.unwrap();
    let started = |event: &Event| event.kind == EventKind::Started;
    until("a long job runs", PATIENCE, async || {
        events().await.iter().any(started).then_some(())
    })
    .await;
    let short: JobId = submit(&few, 500, 0.5).await;
    let events = until("the short job has ended", PATIENCE, async || {
        let events = events().await;
        let ended = |e: &Event| e.job_id == short && e.kind.is_last();
        events.iter().any(ended).then_some(events)
    })
    .await;
    let find = |kind| {
        let mut events = events.iter();
        events
            .find(|e| e.job_id == short && e.kind == kind)
            .unwrap()
    };
    let (queued, begun) = (find(EventKind::Queued), find(EventKind::Started));
    let between = queued.seq..begun.seq;
    let others = events
        .iter()
        .filter(|e| started(e) && between.contains(&e.seq));
    assert!(others.count() <= 1);
}
