//! The writer: groups, contention with other processes, what stays after a reopening.

use std::collections::BTreeSet;
use std::time::Duration;

use meshway::jobs::{Error, JobFilter, Lookup, Status};

use super::support::{Bench, LEASE_MS};
use crate::who::ours;

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn eight_claimers_in_four_processes_never_share_a_job() {
    const JOBS: usize = 200;
    let bench = Bench::new().await;
    let submitted = futures_util::future::join_all((0..JOBS).map(|_| bench.submit())).await;
    let mut claimers = Vec::new();
    for process in 0..4 {
        let store = bench.second().await;
        for slot in 0..2 {
            let store = store.clone();
            claimers.push(tokio::spawn(async move {
                let worker = format!("{process}.{slot}");
                let mut claimed = Vec::new();
                while let Some(claim) = store.claim(&worker, LEASE_MS).await.unwrap() {
                    assert_eq!(
                        (claim.attempt, claim.job.worker.as_deref()),
                        (1, Some(&*worker))
                    );
                    claimed.push(claim.job.id);
                }
                claimed
            }));
        }
    }
    let mut claimed = Vec::new();
    for claimer in claimers {
        claimed.extend(claimer.await.unwrap());
    }
    assert_eq!(claimed.len(), JOBS);
    let distinct: BTreeSet<_> = claimed.into_iter().collect();
    assert_eq!(distinct, submitted.into_iter().map(|job| job.id).collect());
}

#[tokio::test]
async fn requests_that_wait_together_are_committed_together() {
    let bench = Bench::new().await;
    let mut changed = bench.store.changed();
    let before = *changed.borrow_and_update();
    futures_util::future::join_all((0..300).map(|_| bench.submit())).await;
    let commits = *changed.borrow_and_update() - before;
    // 300 requests at 64 a group are at least 5; the first of them may go alone, and the queue may
    // be looked at while it fills.
    assert!((5..=30).contains(&commits), "{commits} commits");
    assert_eq!(bench.store.counts().await.unwrap().get(Status::Queued), 300);
}

#[tokio::test]
async fn one_refused_request_does_not_touch_the_others_of_its_group() {
    let bench = Bench::with(|options| options.queue_limit = 5).await;
    let answers =
        futures_util::future::join_all((0..40).map(|_| bench.acts().submit(bench.new_job(), None)))
            .await;
    let accepted: Vec<_> = answers.iter().flatten().collect();
    assert_eq!(accepted.len(), 5);
    for job in accepted {
        assert!(matches!(
            bench.records().job(&job.id).await.unwrap(),
            Lookup::Found(_)
        ));
    }
    let refused = answers
        .iter()
        .filter(|a| matches!(a, Err(Error::QueueFull { .. })))
        .count();
    assert_eq!(refused, 35);
}

#[tokio::test]
async fn an_answer_means_that_another_connection_sees_the_job() {
    let bench = Bench::new().await;
    let mut db = bench.bare().await;
    for _ in 0..20 {
        let job = bench.submit().await;
        let found = format!("SELECT COUNT(*) FROM jobs WHERE id = '{}'", job.id);
        assert_eq!(db.number(&found).await, 1);
    }
}

#[tokio::test]
async fn what_was_answered_is_there_after_a_reopening() {
    let bench = Bench::new().await;
    let queued = bench.submit().await;
    bench.store.close().await;
    let closed = bench.acts().submit(bench.new_job(), None).await;
    assert!(matches!(closed, Err(Error::Closed)), "{closed:?}");
    assert!(matches!(
        bench.records().job(&queued.id).await,
        Err(Error::Closed)
    ));

    let store = bench.second().await;
    assert_eq!(
        store.of(ours()).job(&queued.id).await.unwrap(),
        Lookup::Found(Box::new(queued.clone()))
    );
    // A process that dies closes nothing: what it committed is in the log.
    let claim = store.claim("w", LEASE_MS).await.unwrap().unwrap();
    let again = bench.second().await;
    assert_eq!(
        again.of(ours()).job(&queued.id).await.unwrap().found(),
        Some(claim.job)
    );
}

#[tokio::test]
async fn a_caller_that_goes_away_leaves_all_or_nothing() {
    let bench = Bench::new().await;
    for patience in 0..20 {
        let submit = bench.acts().submit(bench.new_job(), None);
        // However far it came; the write itself is not stopped half-way.
        let _ = tokio::time::timeout(Duration::from_micros(patience * 50), submit).await;
    }
    let last = bench.submit().await;
    let jobs = bench
        .records()
        .list_jobs(&JobFilter::default(), None, 50)
        .await
        .unwrap();
    assert!(jobs.iter().any(|job| job.id == last.id));
    for job in jobs {
        assert_eq!(bench.event_names(&job.id).await, ["job.queued"]);
    }
}

#[tokio::test]
async fn a_change_wakes_who_subscribed_before_reading() {
    let bench = Bench::new().await;
    let mut changed = bench.store.changed();
    bench.submit().await;
    assert!(changed.has_changed().unwrap());
    changed.borrow_and_update();
    bench.store.wake();
    changed.changed().await.unwrap();
}
