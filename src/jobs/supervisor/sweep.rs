//! Expired leases, and workers that no longer answer.

use std::collections::BTreeSet;
use std::sync::atomic::Ordering;
use std::time::Duration;

use tokio::time::{Instant, MissedTickBehavior};

use super::Supervisor;
use super::pulse::Pulse;
use crate::jobs::Job;

const INTERVAL: Duration = Duration::from_secs(1);
/// More than the running jobs there can be: at most 256 workers, and as many of an earlier server.
const RUNNING_AT_MOST: u32 = 1_000;

impl Supervisor {
    /// Looks at all running jobs, again and again: a job whose lease ran out goes back into the
    /// queue, and a living worker that let it run out is killed if it gives no sign of life.
    pub(super) async fn sweep(&self) {
        let mut interval = tokio::time::interval(INTERVAL);
        interval.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut away: Option<Instant> = None;
        loop {
            interval.tick().await;
            if let Err(error) = self.store.cut_leases(self.store.terms().lease_ms).await {
                tracing::warn!(error.message = %error, "leases far ahead were not cut");
            }
            let (alive, silent) = self.look();
            let Some(running) = self.running().await else {
                away = Some(Instant::now());
                continue;
            };
            let now = self.store.now();
            for job in &running {
                let expired = job.lease_until.is_some_and(|until| until < now);
                if expired
                    && job
                        .worker
                        .as_ref()
                        .is_some_and(|name| silent.contains(name))
                {
                    self.condemn(job);
                }
            }
            // After an outage those who live renew first: nobody's lease says anything before.
            let lease = Duration::from_millis(self.store.terms().lease_ms.unsigned_abs());
            if away.is_some_and(|since| since.elapsed() < lease) {
                continue;
            }
            match self.store.reap_expired(alive).await {
                Ok(reaped) => {
                    for job in reaped {
                        tracing::warn!(%job, "a lease ran out");
                    }
                }
                Err(error) => tracing::warn!(error.message = %error, "leases were not looked at"),
            }
            match self.store.helpers().await {
                Ok(helpers) => self
                    .busy
                    .store(self.at_work(&running, helpers), Ordering::Relaxed),
                Err(error) => {
                    tracing::warn!(error.message = %error, "workers were not looked at");
                }
            }
            self.publish();
        }
    }

    /// Splits the living workers into those that give signs of life and those that do not.
    fn look(&self) -> (BTreeSet<String>, BTreeSet<String>) {
        let living = self.living();
        let workers = living.iter().map(|(name, worker)| (name, &worker.pulse));
        let (alive, silent): (Vec<_>, Vec<_>) = workers.partition(|(_, pulse)| pulse.look());
        let names = |workers: Vec<(&String, &Pulse)>| {
            workers.into_iter().map(|(name, _)| name.clone()).collect()
        };
        (names(alive), names(silent))
    }

    /// The running jobs; none when the database does not answer.
    pub(super) async fn running(&self) -> Option<Vec<Job>> {
        let found = self.store.running_jobs(RUNNING_AT_MOST).await;
        found
            .inspect_err(|error| {
                tracing::warn!(error.message = %error, "running jobs were not looked at");
            })
            .ok()
    }

    fn condemn(&self, job: &Job) {
        let living = self.living();
        if let Some(worker) = job.worker.as_ref().and_then(|name| living.get(name)) {
            tracing::error!(job = %job.id, worker = ?job.worker, "a worker does not answer");
            worker.condemned.cancel();
        }
    }

    /// How many of the living workers hold a job or fit blocks of one.
    fn at_work(&self, running: &[Job], helpers: Vec<String>) -> u32 {
        let holders = running.iter().filter_map(|job| job.worker.clone());
        let at_work: BTreeSet<String> = holders.chain(helpers).collect();
        let living = self.living();
        at_work
            .iter()
            .filter(|name| living.contains_key(*name))
            .count() as u32
    }
}
