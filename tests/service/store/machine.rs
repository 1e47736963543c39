//! The life of jobs under random sequences of everything that can be asked, held against a model
//! of a few lines: never two valid claims on a job, no job lost, none finished twice, event ids
//! without a gap, and what is refused changes nothing.

use std::collections::BTreeSet;
use std::time::Duration;

use meshway::jobs::{
    Claim, Error, FailureReason, JobId, Lease, Lookup, NewEvent, Problem, Record, Result, Status,
    Store,
};
use meshway::reconstruction::Warning;
use proptest::prelude::*;
use proptest::test_runner::FileFailurePersistence;

use super::support::{Bench, LEASE_MS, success};
use crate::who::{ours, us};

#[derive(Debug, Clone)]
enum Step {
    Submit,
    Claim,
    /// What a worker does with the n-th claim that was ever given, valid or not.
    Work(usize, Work),
    RequestCancel(usize),
    Delete(usize),
    Reap,
    Pass(i64),
    /// The process dies, and another one opens the folder.
    Restart,
}

#[derive(Debug, Clone, Copy)]
enum Work {
    Renew,
    Record,
    Checkpoint,
    Succeed,
    Fail,
    Cancelled,
    Release,
    Die,
}

fn step() -> impl Strategy<Value = Step> {
    let work = prop::sample::select(vec![
        Work::Renew,
        Work::Record,
        Work::Checkpoint,
        Work::Succeed,
        Work::Fail,
        Work::Cancelled,
        Work::Release,
        Work::Die,
        Work::Die,
    ]);
    prop_oneof![
        3 => Just(Step::Submit),
        6 => Just(Step::Claim),
        9 => (0..1_000_usize, work).prop_map(|(n, work)| Step::Work(n, work)),
        1 => (0..1_000_usize).prop_map(Step::RequestCancel),
        1 => (0..1_000_usize).prop_map(Step::Delete),
        2 => Just(Step::Reap),
        2 => (0..2 * LEASE_MS).prop_map(Step::Pass),
        1 => Just(Step::Restart),
    ]
}

/// A job as the model has it; erased jobs stay in the list.
#[derive(Debug, Clone)]
struct Model {
    id: JobId,
    status: Status,
    attempt: i64,
    failures: i64,
    cancel_requested: bool,
    lease_until: i64,
    events: i64,
    erased: bool,
}

impl Model {
    fn end(&mut self, status: Status) {
        assert!(!self.status.is_final(), "finished twice");
        self.status = status;
        self.events += 1;
    }

    fn release(&mut self) {
        self.end(if self.cancel_requested {
            Status::Cancelled
        } else {
            Status::Queued
        });
    }

    fn attempt_failed(&mut self) {
        self.failures += 1;
        if self.failures == 3 && !self.cancel_requested {
            self.end(Status::Failed);
        } else {
            self.release();
        }
    }
}

struct Machine {
    bench: Bench,
    store: Store,
    jobs: Vec<Model>,
    claims: Vec<Claim>,
}

impl Machine {
    async fn step(&mut self, step: &Step) {
        match *step {
            Step::Submit => {
                let new = self.bench.new_job();
                let job = self.store.by(us()).submit(new, None).await.unwrap();
                self.jobs.push(Model {
                    id: job.id,
                    status: Status::Queued,
                    attempt: 0,
                    failures: 0,
                    cancel_requested: false,
                    lease_until: 0,
                    events: 1,
                    erased: false,
                });
            }
            Step::Claim => self.claim().await,
            Step::Work(n, work) => {
                if !self.claims.is_empty() {
                    let claim = self.claims[n % self.claims.len()].clone();
                    self.work(&claim, work).await;
                }
            }
            Step::RequestCancel(n) => {
                if let Some(job) = pick(&mut self.jobs, n) {
                    let answer = self.store.by(us()).request_cancel(&job.id).await.unwrap();
                    assert_eq!(matches!(answer, Lookup::Gone(_)), job.erased);
                    if !job.erased && !job.status.is_final() {
                        job.cancel_requested = true;
                        if job.status == Status::Queued {
                            job.end(Status::Cancelled);
                        }
                    }
                }
            }
            Step::Delete(n) => {
                if let Some(job) = pick(&mut self.jobs, n) {
                    let answer = self.store.by(us()).delete_job(&job.id).await.unwrap();
                    assert_eq!(matches!(answer, Lookup::Gone(_)), job.erased);
                    job.erased = true;
                }
            }
            Step::Reap => {
                let reaped = self.store.reap_expired(BTreeSet::new()).await.unwrap();
                let now = self.store.now();
                let mut expected = Vec::new();
                for job in self.jobs.iter_mut().filter(|job| !job.erased) {
                    if job.status == Status::Running && job.lease_until < now {
                        job.attempt_failed();
                        expected.push(job.id.clone());
                    }
                }
                assert_eq!(reaped, expected);
            }
            Step::Pass(milliseconds) => self.bench.pass(milliseconds),
            Step::Restart => self.store = self.bench.second().await,
        }
    }

    async fn claim(&mut self) {
        let claim = self.store.claim("w", LEASE_MS).await.unwrap();
        let next = self
            .jobs
            .iter_mut()
            .find(|job| !job.erased && job.status == Status::Queued);
        assert_eq!(
            claim.as_ref().map(Claim::job_id),
            next.as_ref().map(|job| &job.id)
        );
        if let (Some(claim), Some(job)) = (claim, next) {
            job.status = Status::Running;
            job.attempt += 1;
            job.lease_until = self.store.now() + LEASE_MS;
            job.events += 1;
            assert_eq!(claim.attempt, job.attempt);
            self.claims.push(claim);
        }
    }

    async fn work(&mut self, claim: &Claim, work: Work) {
        let now = self.store.now();
        let job = self
            .jobs
            .iter_mut()
            .find(|job| job.id == claim.job.id)
            .unwrap();
        let valid = !job.erased && job.status == Status::Running && job.attempt == claim.attempt;
        if let Work::Renew = work {
            let lease = self
                .store
                .renew(claim, LEASE_MS, Duration::ZERO)
                .await
                .unwrap();
            let expected = if valid {
                job.lease_until = now + LEASE_MS;
                Lease::Held {
                    cancel_requested: job.cancel_requested,
                }
            } else {
                Lease::Lost
            };
            assert_eq!(lease, expected);
            return;
        }
        let outcome = write(&self.store, claim, work).await;
        if !valid {
            assert!(
                matches!(outcome, Err(Error::Stale)),
                "{work:?}: {outcome:?}"
            );
            return;
        }
        outcome.unwrap();
        match work {
            Work::Renew | Work::Checkpoint => {}
            Work::Record => job.events += 2,
            Work::Succeed => job.end(Status::Succeeded),
            Work::Fail => job.end(Status::Failed),
            Work::Cancelled => job.end(Status::Cancelled),
            Work::Release => job.release(),
            Work::Die => job.attempt_failed(),
        }
    }

    async fn check(&self) {
        let mut waiting = 0;
        for model in &self.jobs {
            let place = self.store.of(ours()).place(&model.id).await.unwrap();
            let waits = !model.erased && model.status == Status::Queued;
            waiting += u64::from(waits);
            // The sums from which it is told are those of the jobs, whatever has happened to them.
            assert_eq!(place.map(|place| place.position), waits.then_some(waiting));
            let found = self.store.of(ours()).job(&model.id).await.unwrap();
            if model.erased {
                assert!(matches!(found, Lookup::Gone(_)), "{found:?}");
                continue;
            }
            let job = found.found().unwrap();
            assert_eq!(
                (
                    job.status,
                    job.attempt,
                    job.failures,
                    job.cancel_requested,
                    job.events
                ),
                (
                    model.status,
                    model.attempt,
                    model.failures,
                    model.cancel_requested,
                    model.events
                )
            );
            let lease = (model.status == Status::Running).then_some(model.lease_until);
            assert_eq!(job.lease_until, lease);
            let mesh = self.store.of(ours()).mesh_info(&job.id, 0).await.unwrap();
            assert_eq!(mesh.is_some(), job.status == Status::Succeeded);
        }
    }
}

fn pick(jobs: &mut [Model], n: usize) -> Option<&mut Model> {
    let count = jobs.len();
    (count > 0).then(|| &mut jobs[n % count])
}

async fn write(store: &Store, claim: &Claim, work: Work) -> Result<()> {
    match work {
        Work::Renew => store.renew(claim, LEASE_MS, Duration::ZERO).await.map(drop),
        Work::Record => {
            let progress = NewEvent::Progress {
                fraction: 0.5,
                eta_seconds: None,
            };
            let warning = NewEvent::Warning(Warning::new("odd", "something is odd"));
            let record = Record {
                events: vec![progress, warning],
                ..Record::default()
            };
            store.record(claim, record).await
        }
        Work::Checkpoint => store.put_checkpoint(claim, 3, vec![1]).await,
        Work::Succeed => store.succeed(claim, success()).await,
        Work::Fail => store.fail(claim, Problem::new("no_surface", "none")).await,
        Work::Cancelled => store.cancelled(claim).await,
        Work::Release => store.release(claim).await,
        Work::Die => {
            let reason = FailureReason::WorkerCrashed {
                signal: None,
                exit_code: Some(1),
            };
            let failed = store.attempt_failed(claim.job_id(), claim.attempt, reason);
            failed.await.map(drop)
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 48, // about 3,000 steps; some seconds, most of them flushes of the disk
        failure_persistence: Some(Box::new(FileFailurePersistence::Off)),
        ..ProptestConfig::default()
    })]

    #[test]
    fn jobs_live_as_the_model_says(steps in prop::collection::vec(step(), 20..100)) {
        tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .unwrap()
            .block_on(async {
                let bench = Bench::new().await;
                let store = bench.store.clone();
                let mut machine = Machine {
                    bench,
                    store,
                    jobs: Vec::new(),
                    claims: Vec::new(),
                };
                for step in &steps {
                    machine.step(step).await;
                    machine.check().await;
                }
                for model in machine.jobs.iter().filter(|job| !job.erased) {
                    machine.bench.event_names(&model.id).await;
                }
            });
    }
}
