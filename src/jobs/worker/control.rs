//! The flags between the async side of a worker and the thread that computes; and the clock of an attempt.

use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use tokio_util::sync::CancellationToken;

/// Why the thread shall stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stop {
    /// A client wants the job to end.
    Cancel,
    /// The job has used its time.
    TimeLimit,
    /// The process is to end: the job goes back into the queue.
    Release,
    /// The job is no longer ours: nothing is to be written.
    Lost,
}

impl Stop {
    /// Whether nobody wants the work any more, in this attempt or another.
    pub(super) fn is_for_good(self) -> bool {
        matches!(self, Self::Cancel | Self::Lost)
    }
}

/// Asks the thread to stop; the first reason counts. Tells how long the attempt has worked.
#[derive(Debug)]
pub(super) struct Control {
    reason: OnceLock<Stop>,
    asked: CancellationToken,
    begun: Instant,
    delays: Mutex<Delays>,
}

/// How long the database or the object store was away: no time of the job.
#[derive(Debug, Default)]
struct Delays {
    /// Of those that are over.
    total: Duration,
    /// What waits now, and since when anything has without a break.
    waiting: u32,
    since: Option<Instant>,
}

impl Delays {
    fn so_far(&self) -> Duration {
        let now = self.since.map(|since| since.elapsed());
        self.total + now.unwrap_or_default()
    }
}

/// Something waits for the database or the object store, until it is dropped.
#[derive(Debug)]
pub(super) struct Delay<'a>(&'a Control);

impl Drop for Delay<'_> {
    fn drop(&mut self) {
        let mut delays = self.0.delays.lock().unwrap_or_else(PoisonError::into_inner);
        delays.waiting -= 1;
        if delays.waiting == 0 {
            delays.total = delays.so_far();
            delays.since = None;
        }
    }
}

impl Default for Control {
    fn default() -> Self {
        Self {
            reason: OnceLock::new(),
            asked: CancellationToken::new(),
            begun: Instant::now(),
            delays: Mutex::default(),
        }
    }
}

impl Control {
    pub(super) fn stop(&self, reason: Stop) {
        if self.reason.set(reason).is_ok() {
            self.asked.cancel();
        }
    }

    pub(super) fn reason(&self) -> Option<Stop> {
        self.reason.get().copied()
    }

    /// Something has waited since then for the database or the object store, and goes on waiting.
    pub(super) fn delay(&self, since: Instant) -> Delay<'_> {
        let mut delays = self.delays.lock().unwrap_or_else(PoisonError::into_inner);
        delays.waiting += 1;
        delays.since.get_or_insert(since);
        Delay(self)
    }

    /// How long the attempt has worked, without delays.
    pub(super) fn worked(&self) -> Duration {
        let delays = self.delays.lock().unwrap_or_else(PoisonError::into_inner);
        self.begun.elapsed().saturating_sub(delays.so_far())
    }

    /// Waits until the attempt has worked for so long.
    pub(super) async fn has_worked(&self, time: Duration) {
        loop {
            let left = time.saturating_sub(self.worked());
            if left.is_zero() {
                return;
            }
            tokio::time::sleep(left).await;
        }
    }

    /// Waits until a stop is asked for.
    pub(super) async fn asked(&self) {
        self.asked.cancelled().await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn delays_count_once_and_are_no_work() {
        let control = Control {
            begun: Instant::now().checked_sub(Duration::from_mins(10)).unwrap(),
            ..Control::default()
        };
        let ago = |minutes| Instant::now().checked_sub(Duration::from_mins(minutes));
        let minutes = || (control.worked().as_secs() + 30) / 60;
        assert_eq!(minutes(), 10);
        let first = control.delay(ago(4).unwrap());
        assert_eq!(minutes(), 6);
        let second = control.delay(ago(2).unwrap());
        drop(first);
        assert_eq!(minutes(), 6);
        drop(second);
        drop(control.delay(ago(1).unwrap()));
        assert_eq!(minutes(), 5);
    }
}
