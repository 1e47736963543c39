//! The life of a job: every legal way, and the refusal of every other.

use std::time::Duration;

use meshway::jobs::{
    Claim, CloudDeletion, Error, FailureReason, Lease, Lookup, NewEvent, NewMesh, Problem, Record,
    Status, Store,
};
use serde_json::json;

use super::support::{Bench, LEASE_MS, success};

fn crash() -> FailureReason {
    FailureReason::WorkerCrashed {
        signal: Some(9),
        exit_code: None,
    }
}

#[tokio::test]
async fn a_job_goes_from_the_queue_to_its_mesh() {
    let bench = Bench::new().await;
    let submitted = bench.submit().await;
    assert_eq!(submitted.status, Status::Queued);
    assert_eq!(submitted.settings, bench.new_job().settings);
    assert_eq!(submitted.labels, bench.new_job().labels);
    assert_eq!(bench.position(&submitted.id).await, Some(1));

    let claim = bench.claim().await;
    assert_eq!(claim.job.id, submitted.id);
    assert_eq!((claim.attempt, claim.job.status), (1, Status::Running));
    assert_eq!(claim.job.lease_until, Some(bench.store.now() + LEASE_MS));
    assert_eq!(
        bench.store.held_by("w").await.unwrap().unwrap().id,
        submitted.id
    );
    assert_eq!(bench.position(&submitted.id).await, None);

    bench.pass(LEASE_MS - 1);
    let held = Lease::Held {
        cancel_requested: false,
    };
    assert_eq!(bench.renew(&claim).await, held);
    let record = Record {
        progress: Some(0.5),
        eta_seconds: Some(3.0),
        events: vec![NewEvent::Progress {
            fraction: 0.5,
            eta_seconds: None,
        }],
        ..Record::default()
    };
    bench.store.record(&claim, record).await.unwrap();
    bench
        .store
        .put_checkpoint(&claim, 7, vec![1])
        .await
        .unwrap();
    bench.store.succeed(&claim, success()).await.unwrap();

    let job = bench.job(&submitted.id).await;
    assert_eq!(job.status, Status::Succeeded);
    assert_eq!(job.report, Some(json!({"closed": true})));
    assert_eq!(
        (job.progress.to_bits(), job.eta_seconds),
        (1.0_f64.to_bits(), None)
    );
    assert_eq!((job.worker, job.lease_until), (None, None));
    assert_eq!(job.finished_at, Some(bench.store.now()));
    assert_eq!((job.evaluations, job.loss), (300, Some(0.5)));
    assert_eq!(bench.records().checkpoint(&job.id).await.unwrap(), None);
    assert_eq!(
        bench.event_names(&job.id).await,
        ["job.queued", "job.started", "job.progress", "job.succeeded"]
    );
    let counts = bench.store.counts().await.unwrap();
    assert_eq!(
        (counts.get(Status::Succeeded), counts.get(Status::Running)),
        (1, 0)
    );
}

#[tokio::test]
async fn jobs_are_claimed_in_their_order() {
    let bench = Bench::new().await;
    let first = bench.submit().await;
    let second = bench.submit().await;
    assert_eq!(bench.position(&second.id).await, Some(2));
    let listed = bench.records().places().await.unwrap();
    assert_eq!(listed[&second.id].position, 2);
    assert_eq!((listed.len(), listed[&first.id].position), (2, 1));
    assert_eq!(
        bench.store.oldest_queued().await.unwrap(),
        Some(first.created_at)
    );
    let claim = bench.claim().await;
    assert_eq!(claim.job.id, first.id);
    // A job that goes back keeps its place.
    bench.store.release(&claim).await.unwrap();
    assert_eq!(bench.claim().await.job.id, first.id);
    assert_eq!(bench.claim().await.job.id, second.id);
    assert_eq!(bench.store.claim("w", LEASE_MS).await.unwrap(), None);
}

/// Everything that a worker can write, with the given claim; each is refused as stale.
async fn assert_writes_nothing(store: &Store, claim: &Claim) {
    let mesh = || NewMesh::new(3, 1, vec![1]);
    let refused = [
        store.record(claim, Record::default()).await,
        store.put_snapshot(claim, 5, mesh()).await,
        store.put_checkpoint(claim, 5, vec![1]).await,
        store.succeed(claim, success()).await,
        store.fail(claim, Problem::new("no_surface", "none")).await,
        store.cancelled(claim).await,
        store.release(claim).await,
        store
            .attempt_failed(claim.job_id(), claim.attempt, crash())
            .await
            .map(drop),
    ];
    for (number, outcome) in refused.into_iter().enumerate() {
        assert!(
            matches!(outcome, Err(Error::Stale)),
            "write {number}: {outcome:?}"
        );
    }
    assert_eq!(
        store.renew(claim, LEASE_MS, Duration::ZERO).await.unwrap(),
        Lease::Lost
    );
}

#[tokio::test]
async fn a_stale_claim_writes_nothing() {
    let bench = Bench::new().await;
    let id = bench.submit().await.id;
    let stale = bench.claim().await;
    bench
        .store
        .attempt_failed(&id, stale.attempt, crash())
        .await
        .unwrap();
    // While the job waits, …
    let waiting = bench.job(&id).await;
    assert_writes_nothing(&bench.store, &stale).await;
    assert_eq!(bench.job(&id).await, waiting);
    // … runs in another attempt, …
    let claim = bench.claim().await;
    assert_eq!(claim.attempt, 2);
    assert_writes_nothing(&bench.store, &stale).await;
    assert_eq!(bench.job(&id).await, claim.job);
    assert_eq!(bench.records().mesh_info(&id, 0).await.unwrap(), None);
    assert_eq!(bench.records().mesh_info(&id, 5).await.unwrap(), None);
    assert_eq!(bench.records().checkpoint(&id).await.unwrap(), None);
    // … and is erased.
    bench.acts().delete_job(&id).await.unwrap();
    assert_writes_nothing(&bench.store, &stale).await;
    assert_writes_nothing(&bench.store, &claim).await;
}

#[tokio::test]
async fn final_states_are_final() {
    for wanted in [Status::Succeeded, Status::Failed, Status::Cancelled] {
        let bench = Bench::new().await;
        let id = bench.submit().await.id;
        let claim = bench.claim().await;
        match wanted {
            Status::Succeeded => bench.store.succeed(&claim, success()).await.unwrap(),
            Status::Failed => {
                let problem = Problem::new("no_surface", "none");
                bench.store.fail(&claim, problem).await.unwrap();
            }
            _ => bench.store.cancelled(&claim).await.unwrap(),
        }
        let job = bench.job(&id).await;
        assert_eq!(job.status, wanted);
        assert_writes_nothing(&bench.store, &claim).await;
        let asked = bench.acts().request_cancel(&id).await.unwrap().found();
        assert_eq!(
            asked,
            Some(job.clone()),
            "a lost race is no error and changes nothing"
        );
        bench.pass(10 * LEASE_MS);
        assert!(bench.reap().await.is_empty());
        assert_eq!(bench.store.claim("w", LEASE_MS).await.unwrap(), None);
        assert_eq!(bench.job(&id).await, job);
    }
}

#[tokio::test]
async fn a_queued_job_is_cancelled_at_once_and_a_running_one_by_its_worker() {
    let bench = Bench::new().await;
    let queued = bench.submit().await.id;
    let cancelled = bench
        .acts()
        .request_cancel(&queued)
        .await
        .unwrap()
        .found()
        .unwrap();
    assert_eq!(cancelled.status, Status::Cancelled);
    assert_eq!(
        bench.event_names(&queued).await,
        ["job.queued", "job.cancelled"]
    );

    let running = bench.submit().await.id;
    let claim = bench.claim().await;
    let asked = bench
        .acts()
        .request_cancel(&running)
        .await
        .unwrap()
        .found()
        .unwrap();
    assert_eq!(
        (asked.status, asked.cancel_requested),
        (Status::Running, true)
    );
    let held = Lease::Held {
        cancel_requested: true,
    };
    assert_eq!(bench.renew(&claim).await, held);
    bench.store.cancelled(&claim).await.unwrap();
    assert_eq!(bench.job(&running).await.status, Status::Cancelled);
}

#[tokio::test]
async fn a_job_that_shall_end_does_not_wait_again() {
    let bench = Bench::new().await;
    for ending in 0..3 {
        let id = bench.submit().await.id;
        let claim = bench.claim().await;
        bench.acts().request_cancel(&id).await.unwrap();
        match ending {
            0 => bench.store.release(&claim).await.unwrap(),
            1 => drop(bench.store.attempt_failed(&id, 1, crash()).await.unwrap()),
            _ => {
                bench.pass(LEASE_MS + 1);
                assert_eq!(bench.reap().await, std::slice::from_ref(&id));
            }
        }
        assert_eq!(bench.job(&id).await.status, Status::Cancelled);
    }
}

#[tokio::test]
async fn the_third_failed_attempt_is_the_last_and_a_release_counts_for_none() {
    let bench = Bench::new().await;
    let id = bench.submit().await.id;
    let first = bench.claim().await;
    bench.store.release(&first).await.unwrap();
    assert_eq!(bench.job(&id).await.failures, 0);

    let second = bench.claim().await;
    let job = bench
        .store
        .attempt_failed(&id, second.attempt, crash())
        .await
        .unwrap();
    assert_eq!((job.status, job.failures), (Status::Queued, 1));
    assert_eq!(job.failure_reason, Some(crash()));

    bench.claim().await;
    bench.pass(LEASE_MS);
    assert!(bench.reap().await.is_empty(), "its last millisecond");
    bench.pass(1);
    assert_eq!(bench.reap().await, std::slice::from_ref(&id));
    assert_eq!(
        bench.job(&id).await.failure_reason,
        Some(FailureReason::LeaseExpired)
    );

    let fourth = bench.claim().await;
    let reason = FailureReason::OutOfMemory { limit_bytes: 9 };
    let job = bench
        .store
        .attempt_failed(&id, fourth.attempt, reason)
        .await
        .unwrap();
    assert_eq!(
        (job.status, job.failures, job.attempt),
        (Status::Failed, 3, 4)
    );
    let error = job.error.unwrap();
    assert_eq!(
        (error.code.as_str(), error.retryable),
        ("out_of_memory", false)
    );
    assert!(error.detail.contains("--worker-memory-mib"), "{error:?}");
    assert_eq!(
        bench.event_names(&id).await,
        [
            "job.queued",
            "job.started",
            "job.queued",
            "job.attempt_started",
            "job.queued",
            "job.attempt_started",
            "job.queued",
            "job.attempt_started",
            "job.failed"
        ]
    );
    let events = bench.events(&id).await;
    assert_eq!(
        events[5].data["reason"],
        json!({"code": "worker_crashed", "signal": 9})
    );
    assert_eq!(events[5].attempt, 3);
}

#[tokio::test]
async fn a_failure_that_is_sure_is_the_last_at_once() {
    let bench = Bench::new().await;
    let id = bench.submit().await.id;
    let claim = bench.claim().await;
    let reason = FailureReason::OutOfMemory { limit_bytes: 9 };
    let failed = bench.store.attempt_failed(&id, claim.attempt, reason);
    let job = failed.await.unwrap();
    assert_eq!((job.status, job.failures), (Status::Failed, 1));
    let error = job.error.unwrap();
    assert_eq!(error.code, "out_of_memory");
    assert!(error.detail.ends_with("; 1 attempt failed"), "{error:?}");
}

#[tokio::test]
async fn the_queue_has_a_limit_that_a_retry_does_not_meet() {
    let bench = Bench::with(|options| options.queue_limit = 2).await;
    bench.submit().await;
    bench.submit().await;
    let refused = bench.acts().submit(bench.new_job(), None).await;
    assert!(
        matches!(refused, Err(Error::QueueFull { limit: 2 })),
        "{refused:?}"
    );
    let claim = bench.claim().await;
    bench.submit().await;
    bench.store.release(&claim).await.unwrap();
    assert_eq!(bench.store.counts().await.unwrap().get(Status::Queued), 3);
}

#[tokio::test]
async fn a_cloud_stays_while_an_unfinished_job_needs_it() {
    let bench = Bench::new().await;
    bench.submit().await;
    assert_eq!(
        bench.acts().delete_cloud(&bench.cloud_id).await.unwrap(),
        CloudDeletion::InUse
    );
    let claim = bench.claim().await;
    assert_eq!(
        bench.acts().delete_cloud(&bench.cloud_id).await.unwrap(),
        CloudDeletion::InUse
    );
    bench.store.succeed(&claim, success()).await.unwrap();
    let deleted = bench.acts().delete_cloud(&bench.cloud_id).await.unwrap();
    assert!(matches!(deleted, CloudDeletion::Deleted(cloud) if cloud.sha256 == "a"));
    assert_eq!(
        bench.acts().delete_cloud(&bench.cloud_id).await.unwrap(),
        CloudDeletion::Missing
    );
    assert_eq!(bench.job(claim.job_id()).await.cloud_id, bench.cloud_id);
    let refused = bench.acts().submit(bench.new_job(), None).await;
    assert!(
        matches!(refused, Err(Error::CloudMissing(_))),
        "{refused:?}"
    );
}

#[tokio::test]
async fn an_unknown_job_is_missing_everywhere() {
    let bench = Bench::new().await;
    let id = meshway::jobs::JobId::at(0);
    assert_eq!(bench.records().job(&id).await.unwrap(), Lookup::Missing);
    assert_eq!(
        bench.acts().request_cancel(&id).await.unwrap(),
        Lookup::Missing
    );
    assert_eq!(bench.acts().delete_job(&id).await.unwrap(), Lookup::Missing);
    assert!(
        bench
            .records()
            .events_after(&id, 0, 10)
            .await
            .unwrap()
            .is_empty()
    );
}
