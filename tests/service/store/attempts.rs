//! What an attempt is told of those before it.

use std::collections::BTreeSet;
use std::time::Duration;

use meshway::jobs::{EventKind, FailureReason};

use super::support::{Bench, LEASE_MS, success};

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
    bench.reap().await;
    bench.claim().await;
    let events = bench.events(&id).await;
    let started = events
        .iter()
        .filter(|e| e.kind == EventKind::AttemptStarted);
    let reasons: Vec<_> = started.map(|e| &e.data["reason"]["code"]).collect();
    assert_eq!(reasons, ["unresponsive", "released", "lease_expired"]);
}

#[tokio::test]
async fn the_work_of_all_attempts_is_counted_by_the_workers_and_not_by_the_time_of_day() {
    let bench = Bench::new().await;
    let renew = async |claim, worked_ms| {
        let worked = Duration::from_millis(worked_ms);
        bench.store.renew(claim, LEASE_MS, worked).await.unwrap()
    };
    bench.submit().await;
    bench.pass(50);
    let first = bench.claim().await;
    assert_eq!(first.worked.as_millis(), 0);
    renew(&first, 1_000).await;
    // Dead for a day before anybody saw it.
    bench.pass(86_400_000);
    bench.reap().await;
    let second = bench.claim().await;
    assert_eq!(second.worked.as_millis(), 1_000);
    // The clock is set back by an hour, and forward by two.
    bench.pass(-3_600_000);
    renew(&second, 1_010).await;
    bench.pass(7_200_000);
    renew(&second, 1_020).await;
    bench.store.release(&second).await.unwrap();
    assert_eq!(bench.claim().await.worked.as_millis(), 1_020);
}

#[tokio::test]
async fn a_worker_that_is_seen_at_work_keeps_its_job_without_a_lease() {
    let bench = Bench::new().await;
    let id = bench.submit().await.id;
    let claim = bench.claim().await;
    bench.pass(100 * LEASE_MS);
    let seen = BTreeSet::from(["v".to_owned(), "w".to_owned()]);
    assert!(bench.store.reap_expired(seen).await.unwrap().is_empty());
    assert_eq!(bench.job(&id).await.failures, 0);
    bench.store.succeed(&claim, success()).await.unwrap();
}

#[tokio::test]
async fn a_lease_that_the_clock_left_far_ahead_is_cut() {
    let bench = Bench::new().await;
    let id = bench.submit().await.id;
    bench.claim().await;
    assert_eq!(bench.store.cut_leases(LEASE_MS).await.unwrap(), 0);
    bench.pass(-3_600_000);
    assert_eq!(bench.store.cut_leases(LEASE_MS).await.unwrap(), 1);
    bench.pass(LEASE_MS + 1);
    let reaped = bench.reap().await;
    assert_eq!(reaped, [id]);
}
