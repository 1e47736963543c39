//! Things that are dear to make and are used by one thread at a time.

use std::sync::{Mutex, PoisonError};

/// Gives each caller one thing of its own and takes it back for the next one.
#[derive(Debug)]
pub(super) struct Pool<T>(Mutex<Vec<T>>);

impl<T> Pool<T> {
    pub(super) fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    /// Lends a thing that nobody else has, made by `make` where all are lent.
    pub(super) fn with<R>(&self, make: impl FnOnce() -> T, work: impl FnOnce(&mut T) -> R) -> R {
        // Nothing happens under the lock that could leave the list half changed.
        let idle = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut thing = idle.unwrap_or_else(make);
        let result = work(&mut thing);
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push(thing);
        result
    }

    /// How many are there that nobody has.
    #[cfg(test)]
    pub(super) fn idle(&self) -> usize {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).len()
    }
}
