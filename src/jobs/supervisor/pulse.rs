//! Whether a worker gives signs of life.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

/// Looks without a sign of life after which a worker counts as silent: five seconds of them, of
/// which it gives one each.
const LOOKS: u32 = 5;

/// Counts the looks since the last sign of life. Not seconds: while the machine sleeps or the server
/// is stopped nobody looks, and a worker that was stopped with it is not blamed.
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
