//! Fitting blocks of a job of another worker, while no job waits.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use tokio::sync::oneshot;
use tokio::time::MissedTickBehavior;

use super::Worker;
use crate::jobs::{Error, Result, Share};
use crate::reconstruction::{Error as Fault, ShareError, fit_share, in_pool};

/// Time between two questions whether the share is still wanted.
const LOOK: Duration = Duration::from_millis(500);

type Outcome = std::result::Result<Vec<u8>, ShareError>;

/// A share that the worker has begun with.
pub(super) struct Help<'a> {
    worker: &'a Worker,
    share: Share,
}

impl<'a> Help<'a> {
    pub(super) fn new(worker: &'a Worker, share: Share) -> Self {
        Self { worker, share }
    }

    /// Fits it. What fails is logged: the worker of the job fits these blocks itself.
    pub(super) async fn run(&self) {
        let (job, share) = (&self.share.job, self.share.number);
        tracing::debug!(%job, share, "blocks of another worker's job are fitted");
        match self.fit().await {
            Ok(()) => tracing::info!(%job, share, "blocks of another worker's job were fitted"),
            Err(Error::Stale) => tracing::debug!(%job, share, "blocks are not wanted any more"),
            Err(error) => {
                tracing::warn!(%job, share, error.message = %error, "blocks were not fitted");
            }
        }
    }

    async fn fit(&self) -> Result<()> {
        let (store, name) = (&self.worker.store, &self.worker.name);
        let begun = Instant::now();
        let input = match store.share_input(&self.share).await {
            Ok(Some(input)) => input,
            Ok(None) => return Err(Error::Stale),
            Err(error) => {
                store.leave_shares(name).await?;
                return Err(error);
            }
        };
        match self.compute(input).await {
            Some(Ok(networks)) => {
                let worked_ms = begun.elapsed().as_millis() as u64;
                store
                    .finish_share((&self.share, name), networks.into(), worked_ms)
                    .await
            }
            Some(Err(ShareError::Fit(Fault::Cancelled))) => {
                store.leave_shares(name).await?;
                Err(Error::Stale)
            }
            // Another one would fail with them, too: they stay with this worker until the attempt ends.
            failed => {
                let (job, share) = (&self.share.job, self.share.number);
                let error = match failed {
                    Some(Err(error)) => error.to_string(),
                    _ => "the computation panicked".to_owned(),
                };
                tracing::error!(%job, share, error.message = error, "the fit of blocks failed");
                Ok(())
            }
        }
    }

    /// The networks, computed on a thread of its own; none where that panicked.
    async fn compute(&self, input: Vec<u8>) -> Option<Outcome> {
        let stop = Arc::new(AtomicBool::new(false));
        let (reply, mut outcome) = oneshot::channel();
        let stopped = Arc::clone(&stop);
        let thread = std::thread::Builder::new().name("help".to_owned());
        let spawned = thread.spawn(move || {
            let outcome = in_pool(move || fit_share(&input, &|| stopped.load(Ordering::Relaxed)));
            // It is waited for to the end.
            drop(reply.send(outcome));
        });
        if let Err(error) = spawned {
            tracing::error!(error.message = %error, "no thread can be started");
            return None;
        }
        let mut looks = tokio::time::interval(LOOK);
        looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut wake = self.worker.signals.wake.clone();
        let mut awake = true;
        loop {
            tokio::select! {
                outcome = &mut outcome => return outcome.ok(),
                _ = looks.tick() => {}
                woken = wake.changed(), if awake => awake = woken.is_ok(),
            }
            if self.worker.signals.stopping.is_cancelled() || self.is_unwanted().await {
                stop.store(true, Ordering::Relaxed);
            }
        }
    }

    async fn is_unwanted(&self) -> bool {
        let wanted = self
            .worker
            .store
            .wants_share(&self.share, &self.worker.name);
        // A database that does not answer may want it.
        matches!(wanted.await, Ok(false))
    }
}
