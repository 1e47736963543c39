//! Names with passwords: how often they are tried, and how many are checked at once.
//!
//! A check takes 19 MiB and some tens of milliseconds of a core, so two are under way at most, off the
//! threads that answer requests. An address may fail ten times in a minute, whatever the names; a name
//! may be failed for thirty times in five minutes, whatever the addresses. Who could be locked out of a
//! name that way can still use a key, and sessions that are open go on.

use std::collections::HashMap;
use std::hash::Hash;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::Semaphore;

use crate::http::AppState;
use crate::http::door::keys::unauthenticated;
use crate::http::wire::error::{ApiError, Code, Result};
use crate::identity::{Caller, Password};

/// Failures of an address and of a name, and the milliseconds that they are remembered.
const OF_ADDRESS: Bound = Bound {
    failures: 10,
    window_ms: 60_000,
};
const OF_NAME: Bound = Bound {
    failures: 30,
    window_ms: 300_000,
};

/// Most addresses, and most names, that are remembered.
const MOST: usize = 16_384;

/// Checks at once, and those that wait for one.
const CHECKS: usize = 2;
const WAITING: usize = 16;

#[derive(Debug, Clone, Copy)]
struct Bound {
    failures: u32,
    window_ms: i64,
}

/// What is known of tries so far.
#[derive(Debug)]
pub(in crate::http) struct Passwords {
    addresses: Tries<Option<IpAddr>>,
    names: Tries<String>,
    checks: Arc<Semaphore>,
    waiting: Arc<Semaphore>,
}

impl Default for Passwords {
    fn default() -> Self {
        Self {
            addresses: Tries::new(OF_ADDRESS),
            names: Tries::new(OF_NAME),
            checks: Arc::new(Semaphore::new(CHECKS)),
            waiting: Arc::new(Semaphore::new(WAITING)),
        }
    }
}

/// Who has this name and this password.
///
/// # Errors
/// [`Code::Unauthenticated`]; [`Code::RateLimited`] after too many failures, and while too many are
/// checked.
pub(in crate::http) async fn check(
    app: &AppState,
    (name, password): (String, String),
    address: Option<IpAddr>,
) -> Result<Caller> {
    let (now, address) = (app.store.now(), address.map(network));
    let user = app.config.keys.user(&name);
    let tries = &app.passwords;
    tries.addresses.begin(address, now).map_err(too_often)?;
    // Names that nobody has cannot be guessed at, and would fill the memory.
    if user.is_some() {
        tries.names.begin(name.clone(), now).map_err(too_often)?;
    }
    let waiting = Arc::clone(&tries.waiting).try_acquire_owned();
    let waiting = waiting.map_err(|_| too_often(1))?;
    let check = Arc::clone(&tries.checks).acquire_owned().await;
    let check = check.map_err(ApiError::internal)?;
    drop(waiting);
    let known = user.as_ref().map(|user| user.password.clone());
    let right = tokio::task::spawn_blocking(move || {
        // Held until the work is done, also when the client has gone.
        let _held = check;
        known.as_ref().unwrap_or(Password::nobodys()).is(&password)
    });
    let right = right.await.map_err(ApiError::internal)?;
    let caller = user.filter(|_| right);
    let caller = caller.and_then(|user| app.config.keys.signed_in(&user));
    let caller = caller
        .ok_or_else(|| unauthenticated("name or password is wrong", Some("invalid_token")))?;
    tries.addresses.succeeded(&address);
    tries.names.succeeded(&name);
    Ok(caller)
}

fn too_often(seconds: u32) -> ApiError {
    let detail = format!("too many passwords were tried; try again in {seconds} s");
    ApiError::new(Code::RateLimited, detail).retry_after(seconds)
}

/// What one subscriber has: an IPv4 address, or a /64 of IPv6.
fn network(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) => {
            let [a, b, c, d, ..] = address.segments();
            Ipv6Addr::new(a, b, c, d, 0, 0, 0, 0).into()
        }
        address @ IpAddr::V4(_) => address,
    }
}

/// Failures by whom they are counted for.
#[derive(Debug)]
struct Tries<K> {
    bound: Bound,
    /// When the window began, and the failures in it.
    of: Mutex<HashMap<K, (i64, u32)>>,
}

impl<K: Eq + Hash + Clone> Tries<K> {
    fn new(bound: Bound) -> Self {
        Self {
            bound,
            of: Mutex::default(),
        }
    }

    /// Counts a try as a failure until it has succeeded: tries at the same time must not all pass.
    ///
    /// # Errors
    /// Seconds until the next try is allowed.
    fn begin(&self, whose: K, now: i64) -> std::result::Result<(), u32> {
        let Bound {
            failures,
            window_ms,
        } = self.bound;
        let mut all = self.of.lock().unwrap_or_else(PoisonError::into_inner);
        let open = |began: i64| (0..window_ms).contains(&(now - began));
        if all.len() >= MOST && !all.contains_key(&whose) {
            all.retain(|_, (began, _)| open(*began));
            let oldest = all.iter().min_by_key(|(_, (began, _))| *began);
            let oldest = oldest.map(|(whose, _)| whose.clone());
            if let Some(oldest) = oldest.filter(|_| all.len() >= MOST) {
                all.remove(&oldest);
            }
        }
        let (began, count) = all.entry(whose).or_insert((now, 0));
        if !open(*began) {
            (*began, *count) = (now, 0);
        }
        if *count >= failures {
            return Err(((*began + window_ms - now) as u32).div_ceil(1_000));
        }
        *count += 1;
        Ok(())
    }

    /// Takes the last try back. Earlier failures stay: they may be somebody else's.
    fn succeeded(&self, whose: &K) {
        let mut all = self.of.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, count)) = all.get_mut(whose) {
            *count = count.saturating_sub(1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failures_are_counted_in_windows_and_successes_are_not() {
        let tries = Tries::new(OF_ADDRESS);
        for _ in 0..100 {
            assert_eq!(tries.begin('a', 0), Ok(()));
            tries.succeeded(&'a');
        }
        for _ in 0..10 {
            assert_eq!(tries.begin('a', 1_000), Ok(()));
        }
        assert_eq!(tries.begin('a', 1_000), Err(59));
        assert_eq!(tries.begin('b', 1_000), Ok(()));
        assert_eq!(tries.begin('a', 60_000), Ok(()));
        assert_eq!(tries.begin('a', 0), Ok(()));
    }

    #[test]
    fn new_addresses_push_out_the_oldest_and_never_more() {
        let tries = Tries::new(OF_ADDRESS);
        for i in 0..=MOST {
            assert_eq!(tries.begin(i, i as i64 / 1_000), Ok(()));
        }
        assert_eq!(tries.of.lock().unwrap().len(), MOST);
    }

    #[test]
    fn a_subscriber_is_an_address_or_a_network() {
        let of = |text: &str| network(text.parse().unwrap()).to_string();
        assert_eq!(of("::ffff:10.0.0.1"), "10.0.0.1");
        assert_eq!(of("2001:db8:1:2:3:4:5:6"), of("2001:db8:1:2::1"));
        assert_ne!(of("2001:db8:1:2::1"), of("2001:db8:1:3::1"));
    }
}
