//! Leases that ran out, and who let them.

use std::sync::atomic::Ordering;
use std::time::Duration;

use tokio::time::MissedTickBehavior;

use super::Supervisor;
use crate::jobs::{Job, JobFilter, Status};

const INTERVAL: Duration = Duration::from_secs(1);
/// More jobs than there are workers: at most 256, and as many of a server before this one.
const RUNNING_AT_MOST: u32 = 1_000;

impl Supervisor {
    /// Looks at all running jobs, again and again: a job whose lease ran out goes back into the
    /// queue, and a living worker that let it run out is killed, for it does not answer.
    pub(super) async fn sweep(&self) {
        let mut interval = tokio::time::interval(INTERVAL);
        interval.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            interval.tick().await;
            let running = self.running().await;
            let now = self.store.now();
            for job in &running {
                if job.lease_until.is_some_and(|until| until < now) {
                    self.condemn(job);
                }
            }
            match self.store.reap_expired().await {
                Ok(reaped) => {
                    for job in reaped {
                        tracing::warn!(%job, "a lease ran out");
                    }
                }
                Err(error) => tracing::warn!(error.message = %error, "leases were not looked at"),
            }
            self.busy.store(self.held(&running), Ordering::Relaxed);
            self.publish();
        }
    }

    /// The running jobs; none when the database does not answer.
    pub(super) async fn running(&self) -> Vec<Job> {
        let filter = JobFilter {
            status: Some(Status::Running),
            ..JobFilter::default()
        };
        let found = self.store.list_jobs(&filter, None, RUNNING_AT_MOST).await;
        found.unwrap_or_else(|error| {
            tracing::warn!(error.message = %error, "running jobs were not looked at");
            Vec::new()
        })
    }

    fn condemn(&self, job: &Job) {
        let living = self.living();
        if let Some(condemned) = job.worker.as_ref().and_then(|name| living.get(name)) {
            tracing::error!(job = %job.id, worker = ?job.worker, "a worker does not answer");
            condemned.cancel();
        }
    }

    /// How many of the jobs a living worker holds.
    fn held(&self, running: &[Job]) -> u32 {
        let living = self.living();
        let held = |job: &&Job| {
            job.worker
                .as_ref()
                .is_some_and(|name| living.contains_key(name))
        };
        running.iter().filter(held).count() as u32
    }
}
