//! What an attempt is told of those before it.

use meshway::jobs::{FailureReason, NewEvent, Record};
use serde_json::json;

use crate::store_support::{Bench, LEASE_MS};

#[tokio::test]
async fn an_attempt_tells_why_the_one_before_it_ended() {
    let bench = Bench::new().await;
    let id = bench.submit().await.id;
    let first = bench.claim().await;
    bench
        .store
        .attempt_failed(&id, first.attempt, FailureReason::Unresponsive)
        .await
        .unwrap();
    bench.store.release(&bench.claim().await).await.unwrap();
    bench.claim().await;
    bench.pass(LEASE_MS + 1);
    bench.store.reap_expired().await.unwrap();
    bench.claim().await;
    let events = bench.events(&id).await;
    let started = events.iter().filter(|e| e.event == "job.attempt_started");
    let reasons: Vec<_> = started.map(|e| &e.data["reason"]["code"]).collect();
    assert_eq!(reasons, ["unresponsive", "released", "lease_expired"]);
}

#[tokio::test]
async fn the_work_of_all_attempts_is_counted_and_no_wait() {
    let bench = Bench::new().await;
    let told = || Record {
        events: vec![NewEvent::new("job.progress", json!({"fraction": 0.5}))],
        ..Record::default()
    };
    bench.submit().await;
    bench.pass(50);
    let first = bench.claim().await;
    assert_eq!(first.worked.as_millis(), 0);
    bench.pass(1_000);
    bench.store.record(&first, told()).await.unwrap();
    // Dead for a day before anybody saw it.
    bench.pass(86_400_000);
    bench.store.reap_expired().await.unwrap();
    bench.pass(500);
    let second = bench.claim().await;
    assert_eq!(second.worked.as_millis(), 1_000);
    bench.pass(20);
    bench.store.record(&second, told()).await.unwrap();
    bench.store.release(&second).await.unwrap();
    assert_eq!(bench.claim().await.worked.as_millis(), 1_020);
}
