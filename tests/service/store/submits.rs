//! Jobs that are submitted at the same time: written together, each as if it were alone.

use futures_util::future::join_all;
use meshway::identity::{Allowance, Caller, Limits};
use meshway::jobs::store::{Idempotency, IdempotencyState, StoredResponse};
use meshway::jobs::{CloudId, Error, Job, Keep, NewJob, Status};

use super::support::{Bench, new_cloud};
use crate::who::us;

const JOBS: usize = 150;

fn queued(limit: u32) -> Caller {
    let queued = Limits {
        queued_jobs: Some(limit),
        ..Limits::default()
    };
    Caller {
        allowance: Allowance {
            tenant: Limits::default(),
            account: queued,
        },
        ..us().clone()
    }
}

#[tokio::test]
async fn whatever_becomes_of_the_others_each_job_gets_its_own_answer() {
    let bench = Bench::new().await;
    let some = NewJob {
        priority: 1,
        ..bench.new_job()
    };
    let without_cloud = NewJob {
        cloud_id: CloudId::at(0),
        ..bench.new_job()
    };
    // No row may say that a job is kept for no time at all.
    let refused_by_its_row = NewJob {
        keep: Keep {
            ms: Some(0),
            once: false,
        },
        ..bench.new_job()
    };
    for broken in [None, Some(refused_by_its_row)] {
        let kinds: Vec<NewJob> = [
            bench.new_job(),
            some.clone(),
            without_cloud.clone(),
            broken.clone().unwrap_or_else(|| bench.new_job()),
        ]
        .into();
        let before = bench.store.counts().await.unwrap().get(Status::Queued);
        let submits = (0..JOBS).map(|k| bench.acts().submit(kinds[k % 4].clone(), None));
        let answers: Vec<Result<Job, Error>> = join_all(submits).await;
        let mut taken = 0;
        for (k, answer) in answers.iter().enumerate() {
            match k % 4 {
                2 => assert!(
                    matches!(answer, Err(Error::CloudMissing(_))),
                    "{k}: {answer:?}"
                ),
                3 if broken.is_some() => assert!(
                    matches!(answer, Err(Error::Inconsistent { .. } | Error::Database(_))),
                    "{k}: {answer:?}"
                ),
                kind => {
                    let job = answer.as_ref().unwrap();
                    assert_eq!(job.priority, kinds[kind].priority, "{k}");
                    assert_eq!(bench.job(&job.id).await, *job);
                    assert_eq!(bench.event_names(&job.id).await, ["job.queued"]);
                    taken += 1;
                }
            }
        }
        let now = bench.store.counts().await.unwrap().get(Status::Queued);
        assert_eq!(now - before, taken);
    }
}

#[tokio::test]
async fn a_quota_counts_those_that_come_together() {
    let bench = Bench::new().await;
    let limited = queued(3);
    let submits = (0..40).map(|k| {
        let caller = if k % 2 == 0 { &limited } else { us() };
        bench.store.by(caller).submit(bench.new_job(), None)
    });
    let answers = join_all(submits).await;
    let (of_limited, others): (Vec<_>, Vec<_>) =
        (0..).zip(&answers).partition(|(k, _)| k % 2 == 0);
    assert!(others.iter().all(|(_, answer)| answer.is_ok()));
    let refused = |(_, answer): &&(usize, &Result<Job, Error>)| {
        matches!(answer, Err(Error::Quota { .. }))
    };
    // Theirs are jobs of the same account: none is here before the first limited one, two before the second.
    assert_eq!(of_limited.iter().filter(refused).count(), 18);
}

#[tokio::test]
async fn each_is_told_its_place_and_the_answers_are_kept() {
    for tenants in [1, 2] {
        let bench = Bench::new().await;
        if tenants == 2 {
            let other = Caller {
                tenant: "other".parse().unwrap(),
                ..Caller::anybody()
            };
            let acts = bench.store.by(&other);
            let (cloud, _) = acts.insert_cloud(new_cloud("a")).await.unwrap();
            let new = NewJob {
                cloud_id: cloud.id,
                ..bench.new_job()
            };
            for _ in 0..5 {
                bench.store.by(&other).submit(new.clone(), None).await.unwrap();
            }
        }
        let submit = async |k: usize| {
            let (key, scope) = (format!("key-{k}"), "POST /v1/jobs");
            let acts = bench.acts();
            acts.idempotency_begin(&key, scope, "hash").await.unwrap();
            let kept = Idempotency {
                key,
                scope: scope.to_owned(),
                respond: Box::new(|job: &Job| StoredResponse {
                    status: 202,
                    headers: Vec::new(),
                    body: job.id.as_str().into(),
                }),
            };
            let acts = bench.acts();
            acts.submit(bench.new_job(), Some(kept)).await.unwrap().id
        };
        let ids = join_all((0..JOBS).map(submit)).await;
        for (k, id) in ids.iter().enumerate() {
            let key = format!("key-{k}");
            let acts = bench.acts();
            let again = acts.idempotency_begin(&key, "POST /v1/jobs", "hash").await;
            let IdempotencyState::Replay(answer) = again.unwrap() else {
                panic!("{k}")
            };
            assert_eq!(answer.body, id.as_str().as_bytes());
        }
        // Nothing that came later is before any of them.
        for id in &ids {
            let told = bench.events(id).await[0].data["position"].as_u64();
            assert!(told.is_some());
            assert_eq!(told, bench.position(id).await, "{tenants}");
        }
    }
}
