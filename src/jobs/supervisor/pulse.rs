//! Whether a worker gives signs of life.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

/// Looks without a sign of life after which a worker counts as silent. There is one look a second,
/// and a worker gives one sign a second.
const LOOKS: u32 = 5;

/// Counts the looks since the last sign of life. Looks, not seconds: nobody looks while the machine
/// sleeps or the server is stopped, so a worker that was stopped too is not blamed.
#[derive(Clone, Default)]
pub(super) struct Pulse(Arc<AtomicU32>);

impl Pulse {
    /// A sign of life came.
    pub(super) fn heard(&self) {
        self.0.store(0, Ordering::Relaxed);
    }

    /// Looks: whether there was a sign of life not long ago.
    pub(super) fn look(&self) -> bool {
        self.0.fetch_add(1, Ordering::Relaxed) < LOOKS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_looks_make_a_worker_silent() {
        let pulse = Pulse::default();
        for _ in 0..2 {
            assert!((0..LOOKS).all(|_| pulse.look()));
            assert!(!pulse.look() && !pulse.look());
            pulse.heard();
        }
        assert!(pulse.look());
    }
}
