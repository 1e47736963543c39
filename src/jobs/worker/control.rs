//! The flags between the async side of a worker and the thread that computes.

use std::sync::OnceLock;

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

/// Asks the thread to stop; the first reason counts.
#[derive(Debug, Default)]
pub(super) struct Control {
    reason: OnceLock<Stop>,
    asked: CancellationToken,
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

    /// Waits until a stop is asked for.
    pub(super) async fn asked(&self) {
        self.asked.cancelled().await;
    }
}
