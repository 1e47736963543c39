//! The one look at the wall clock; everything else takes a [`Clock`] or a time.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

/// Tells the time in milliseconds since the epoch. The store takes one, so that a test can let
/// leases expire without waiting.
pub type Clock = Arc<dyn Fn() -> i64 + Send + Sync>;

/// Milliseconds since the Unix epoch; 0 on a machine whose clock stands before it.
pub fn now() -> i64 {
    SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .map_or(0, |since| since.as_millis() as i64)
}

/// The clock of another machine, read off that of this one: their difference is seen whenever the
/// other one tells its time. Until then it is that of this machine.
#[derive(Debug, Clone, Default)]
pub(in crate::jobs) struct RemoteClock {
    ahead: Arc<AtomicI64>,
}

impl RemoteClock {
    /// Milliseconds since the epoch.
    pub(in crate::jobs) fn now(&self) -> i64 {
        now() + self.ahead()
    }

    /// How far it is ahead of the clock of this machine, in milliseconds.
    pub(in crate::jobs) fn ahead(&self) -> i64 {
        self.ahead.load(Ordering::Relaxed)
    }

    /// The other machine says that it is this time, in milliseconds since the epoch.
    pub(in crate::jobs) fn set(&self, told: i64) {
        self.set_ahead(told - now());
    }

    /// The other machine's clock is ahead by so many milliseconds.
    pub(in crate::jobs) fn set_ahead(&self, milliseconds: i64) {
        self.ahead.store(milliseconds, Ordering::Relaxed);
    }
}
