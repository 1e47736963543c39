//! Blocks that a worker offers to idle ones: who gets them, and that none outlives the attempt.

use meshway::jobs::store::Offered;
use meshway::jobs::{Claim, Error, FailureReason, Share};

use super::support::{Bench, LEASE_MS, success};
use crate::place::{Place, in_both_places};
use crate::server::{PATIENCE, until};

/// What the processors of helpers are called here.
const FAST: &str = "fast";

async fn offer(bench: &Bench, claim: &Claim, number: usize, processor: &str) {
    let input = format!("input {number}").into_bytes();
    let offer = (processor.to_owned(), input.into());
    bench.store.offer_share(claim, number, offer).await.unwrap();
}

async fn take(bench: &Bench, worker: &str) -> Option<Share> {
    bench.store.take_share(worker, FAST).await.unwrap()
}

async fn offered(bench: &Bench, claim: &Claim) -> Vec<Offered> {
    bench.store.offered_shares(claim).await.unwrap()
}

/// Waits until only so many objects are left.
async fn left(bench: &Bench, objects: usize) {
    until("the bytes are gone", PATIENCE, async || {
        (bench.objects().await == objects).then_some(())
    })
    .await;
}

in_both_places! {
async fn a_share_goes_to_an_idle_worker_and_comes_back(place: Place) {
    let bench = Bench::at(place).await;
    bench.submit().await;
    let claim = bench.claim().await;
    for number in [3, 5] {
        offer(&bench, &claim, number, FAST).await;
    }
    offer(&bench, &claim, 4, "slow").await;
    // The one that waits longest, and only what this processor can fit with the same bits.
    let first = take(&bench, "a").await.unwrap();
    assert_eq!((&first.job, first.number), (claim.job_id(), 3));
    assert_eq!(take(&bench, "b").await.unwrap().number, 5);
    assert_eq!(take(&bench, "c").await, None);
    assert_eq!(bench.store.helpers().await.unwrap(), ["a", "b"]);
    let input = bench.store.share_input(&first).await.unwrap();
    assert_eq!(input.unwrap(), b"input 3");
    assert!(bench.store.wants_share(&first, "a").await.unwrap());
    assert!(!bench.store.wants_share(&first, "b").await.unwrap());
    let finish = bench.store.finish_share((&first, "a"), b"networks".to_vec().into(), 1_500);
    finish.await.unwrap();
    let found = offered(&bench, &claim).await;
    let states: Vec<_> = found.iter().map(|s| (s.number, s.is_begun, s.is_fitted())).collect();
    assert_eq!(states, [(3, true, true), (4, false, false), (5, true, false)]);
    let networks = bench.store.networks(&found[0]).await.unwrap();
    assert_eq!(networks.unwrap(), b"networks");
    assert_eq!(bench.store.networks(&found[1]).await.unwrap(), None);
    // Who has begun may go on; the others end.
    for number in [3, 4, 5] {
        bench.store.close_share(&claim, number).await.unwrap();
    }
    let numbers: Vec<_> = offered(&bench, &claim).await.iter().map(|s| s.number).collect();
    assert_eq!(numbers, [5]);
    left(&bench, 1).await;
    // The tenant is told the time of the helper, too.
    let select = "SELECT CAST(SUM(ms) AS TEXT) FROM compute";
    assert_eq!(bench.bare().await.texts(select).await, ["1500"]);
}
}

in_both_places! {
async fn no_share_outlives_the_attempt(place: Place) {
    let bench = Bench::at(place).await;
    let id = bench.submit().await.id;
    let ends: [&str; 5] = ["failed attempt", "release", "lease", "new input", "success"];
    for (i, end) in ends.into_iter().enumerate() {
        let claim = bench.claim().await;
        offer(&bench, &claim, 1, FAST).await;
        offer(&bench, &claim, 2, FAST).await;
        let share = take(&bench, "a").await.unwrap();
        assert!(bench.store.wants_share(&share, "a").await.unwrap(), "{end}");
        match i {
            0 => {
                let reason = FailureReason::Internal { detail: end.to_owned() };
                bench.store.attempt_failed(&id, claim.attempt, reason).await.unwrap();
            }
            1 => bench.store.release(&claim).await.unwrap(),
            2 => {
                bench.pass(LEASE_MS + 1);
                assert_eq!(bench.reap().await.as_slice(), std::slice::from_ref(&id));
            }
            3 => {
                // A share of the same number in the next attempt is another one.
                bench.store.release(&claim).await.unwrap();
                let next = bench.claim().await;
                offer(&bench, &next, share.number, FAST).await;
                assert!(!bench.store.wants_share(&share, "a").await.unwrap());
                bench.store.release(&next).await.unwrap();
            }
            _ => bench.store.succeed(&claim, success()).await.unwrap(),
        }
        assert!(!bench.store.wants_share(&share, "a").await.unwrap(), "{end}");
        assert_eq!(take(&bench, "b").await, None, "{end}");
        let finish = bench.store.finish_share((&share, "a"), b"late".to_vec().into(), 1);
        assert!(matches!(finish.await, Err(Error::Stale)), "{end}");
        let late = bench.store.offer_share(&claim, 7, (FAST.to_owned(), b"late".to_vec().into()));
        assert!(matches!(late.await, Err(Error::Stale)), "{end}");
        // Of a success its mesh and its network stay.
        left(&bench, if i == 4 { 2 } else { 0 }).await;
    }
}
}

#[tokio::test]
async fn a_job_that_is_erased_takes_its_shares_along() {
    let bench = Bench::new().await;
    let id = bench.submit().await.id;
    let claim = bench.claim().await;
    offer(&bench, &claim, 1, FAST).await;
    let share = take(&bench, "a").await.unwrap();
    bench.acts().delete_job(&id).await.unwrap();
    assert_eq!(bench.store.share_input(&share).await.unwrap(), None);
    assert!(!bench.store.wants_share(&share, "a").await.unwrap());
    left(&bench, 0).await;
}

#[tokio::test]
async fn a_job_that_waits_comes_before_shares() {
    let bench = Bench::new().await;
    assert_eq!(bench.store.spare_workers(3).await.unwrap(), 3);
    bench.submit().await;
    assert_eq!(bench.store.spare_workers(3).await.unwrap(), 0);
    let claim = bench.claim().await;
    assert_eq!(bench.store.spare_workers(3).await.unwrap(), 2);
    assert_eq!(bench.store.spare_workers(1).await.unwrap(), 0);
    offer(&bench, &claim, 1, FAST).await;
    let share = take(&bench, "a").await.unwrap();
    bench.submit().await;
    assert_eq!(bench.store.spare_workers(3).await.unwrap(), 0);
    assert!(!bench.store.wants_share(&share, "a").await.unwrap());
    // Somebody may begin with it again.
    bench.store.leave_shares("a").await.unwrap();
    assert_eq!(take(&bench, "b").await.unwrap().number, 1);
}
