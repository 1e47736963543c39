//! What is tried again while something delays it: another process, a full disk, a database server or an
//! object store that is away.

use std::future::Future;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use tokio::time::sleep;
use tokio_util::sync::CancellationToken;

use super::control::{Control, Stop};
use crate::jobs::{Claim, Error, NewEvent, Record, Result, Store};
use crate::reconstruction::Warning;

/// How long a computation that nobody wants any more may take to stop: two seconds are promised to who
/// cancels. Between two questions of a large surface whether to stop lies more than that.
const LEFT_AFTER: Duration = Duration::from_millis(1_500);
/// Pause between two tries.
const PAUSE: Duration = Duration::from_millis(500);
/// Longest pause between two tries while the object store is away.
const LONGEST_PAUSE: Duration = Duration::from_secs(10);
/// How long an object store may be away: an hour is promised.
const AWAY: Duration = Duration::from_hours(2);

/// Tries again for an attempt.
#[derive(Clone)]
pub(super) struct Insist {
    pub(super) store: Store,
    pub(super) claim: Claim,
    pub(super) control: Arc<Control>,
    /// Cancelled when the worker is to end.
    pub(super) stopping: CancellationToken,
    /// How long what is to stop may take.
    pub(super) grace: Duration,
    /// Whether the job's events say that the object store is away.
    pub(super) told: Arc<AtomicBool>,
}

impl Insist {
    /// Repeats what is asked of the rows, as long as the terms of the store allow. The time is none of the job's.
    pub(super) async fn rows<T, F>(&self, write: impl Fn() -> F) -> Result<T>
    where
        F: Future<Output = Result<T>>,
    {
        let begun = Instant::now();
        let mut delay = None;
        let mut tries = 1;
        loop {
            match write().await {
                Err(error @ (Error::Busy | Error::Full(_))) if tries < self.store.terms().tries => {
                    if tries.is_power_of_two() {
                        tracing::warn!(tries, error.message = %error, "the database is asked again");
                    }
                    tries += 1;
                    delay.get_or_insert_with(|| self.control.delay(begun));
                    sleep(PAUSE).await;
                }
                result => return result,
            }
        }
    }

    /// Repeats what writes or reads content. Without the object store it goes on trying until that is
    /// back, or the attempt is to stop.
    ///
    /// # Errors
    /// `ContentUnavailable` then, and after two hours.
    pub(super) async fn content<T, F>(&self, work: impl Fn() -> F) -> Result<T>
    where
        F: Future<Output = Result<T>>,
    {
        if self.store.keeps_files() {
            return self.rows(work).await;
        }
        let since = Instant::now();
        let mut pause = PAUSE;
        let mut delay = None;
        let work = async {
            loop {
                match self.rows(&work).await {
                    Err(error @ Error::ContentUnavailable(_)) if since.elapsed() < AWAY => {
                        tracing::warn!(job = %self.claim.job_id(), error.message = %error,
                            "content is tried again");
                        delay.get_or_insert_with(|| self.control.delay(since));
                        self.tell().await;
                        sleep(pause).await;
                        pause = (2 * pause).min(LONGEST_PAUSE);
                    }
                    result => return result,
                }
            }
        };
        tokio::select! {
            result = work => result,
            () = self.overdue() => {
                Err(Error::ContentUnavailable("the attempt does not wait for it".to_owned()))
            }
        }
    }

    /// Waits until the attempt was asked to stop, and what it still did took longer than it may.
    pub(super) async fn overdue(&self) {
        tokio::select! {
            () = self.control.asked() => {}
            () = self.stopping.cancelled() => self.control.stop(Stop::Release),
        }
        let unwanted = self.control.reason().is_some_and(Stop::is_for_good);
        let grace = if unwanted {
            LEFT_AFTER.min(self.grace)
        } else {
            self.grace
        };
        sleep(grace).await;
    }

    /// Says once in the events of the job that the object store is away.
    async fn tell(&self) {
        if self.told.swap(true, Ordering::Relaxed) {
            return;
        }
        let warning = Warning::new(
            "storage_unavailable",
            "the object store does not answer; what the job needs of it waits",
        );
        let record = Record {
            events: vec![NewEvent::Warning(warning)],
            ..Record::default()
        };
        let told = self.rows(|| self.store.record(&self.claim, record.clone()));
        if let Err(error) = told.await {
            tracing::debug!(error.message = %error, "a warning was not written");
        }
    }
}
