//! Counting in windows of time.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Mutex, PoisonError};

/// Most names that are remembered: as many as tenants, keys and addresses are seen in minutes, with room.
const MOST: usize = 65_536;

/// How many there may be in a window, and how long that is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quota {
    pub(super) most: u64,
    pub(super) window_ms: i64,
}

/// What came of counting one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Counted {
    /// How many there may still be; none where this one was too many.
    pub(super) left: Option<u64>,
    /// Seconds until the window ends.
    pub(super) reset: u32,
}

/// Windows by whom they are counted for. A restart begins them anew: they are minutes long.
#[derive(Debug)]
pub(super) struct Windows<K>(Mutex<HashMap<K, Window>>);

#[derive(Debug, Clone, Copy)]
struct Window {
    /// In milliseconds since the epoch.
    began: i64,
    length: i64,
    count: u64,
}

impl Window {
    /// A clock that was set back must not lock anybody out for longer than a window.
    fn is_open(&self, now: i64) -> bool {
        (0..self.length).contains(&(now - self.began))
    }
}

impl<K> Default for Windows<K> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<K: Eq + Hash + Clone> Windows<K> {
    /// Counts one, at a time in milliseconds since the epoch; no more of them than the quota. Where too many names are
    /// remembered, the oldest window makes room.
    pub(super) fn count(&self, whose: K, quota: Quota, now: i64) -> Counted {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if all.len() >= MOST && !all.contains_key(&whose) {
            all.retain(|_, window| window.is_open(now));
            if all.len() >= MOST {
                let oldest = all.iter().min_by_key(|(_, window)| window.began);
                let oldest = oldest.map(|(whose, _)| whose.clone());
                oldest.map(|oldest| all.remove(&oldest));
            }
        }
        let new = Window {
            began: now,
            length: quota.window_ms,
            count: 0,
        };
        let window = all.entry(whose).or_insert(new);
        if !window.is_open(now) {
            *window = new;
        }
        let free = window.count < quota.most;
        window.count += u64::from(free);
        Counted {
            left: free.then(|| quota.most - window.count),
            reset: ((window.began + window.length - now) as u32).div_ceil(1_000),
        }
    }

    /// Takes the last one back.
    pub(super) fn take_back(&self, whose: &K) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(window) = all.get_mut(whose) {
            window.count = window.count.saturating_sub(1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUOTA: Quota = Quota {
        most: 10,
        window_ms: 60_000,
    };

    #[test]
    fn what_was_taken_back_does_not_count() {
        let windows = Windows::default();
        let left = |whose, now| windows.count(whose, QUOTA, now).left;
        for _ in 0..100 {
            assert_eq!(left('a', 0), Some(9));
            windows.take_back(&'a');
        }
        for i in 1..=10 {
            assert_eq!(left('a', 1_000), Some(10 - i));
        }
        let full = Counted {
            left: None,
            reset: 59,
        };
        assert_eq!(windows.count('a', QUOTA, 1_000), full);
        assert_eq!(left('b', 1_000), Some(9));
        assert_eq!(left('a', 60_000), Some(9));
        // The clock was set back.
        assert_eq!(left('a', 0), Some(9));
    }

    #[test]
    fn new_names_push_out_the_oldest_and_there_are_never_more() {
        let windows = Windows::default();
        for i in 0..=MOST {
            assert_eq!(windows.count(i, QUOTA, i as i64 / 2_000).left, Some(9));
        }
        assert_eq!(windows.0.lock().unwrap().len(), MOST);
        assert_eq!(windows.count(MOST, QUOTA, 100).left, Some(8));
    }
}
