//! Names with passwords: how often they are tried, and how many are checked at once.
//!
//! A check takes 19 MiB and some tens of milliseconds of a core, so two are under way at most, off the
//! threads that answer requests. An address may fail ten times in a minute, whatever the names; a name
//! may be failed for thirty times in five minutes, whatever the addresses. Who could be locked out of a
//! name that way can still use a key, and sessions that are open go on.

use std::net::{IpAddr, Ipv6Addr};
use std::sync::Arc;

use tokio::sync::Semaphore;

use crate::http::AppState;
use crate::http::door::keys::unauthenticated;
use crate::http::door::window::{Counted, Quota, Windows};
use crate::http::wire::error::{ApiError, Code, Result};
use crate::identity::{Caller, Password};

/// Failures of an address and of a name.
const OF_ADDRESS: Quota = Quota {
    most: 10,
    window_ms: 60_000,
};
const OF_NAME: Quota = Quota {
    most: 30,
    window_ms: 300_000,
};

/// Checks at once, and those that wait for one.
const CHECKS: usize = 2;
const WAITING: usize = 16;

/// What is known of tries so far.
#[derive(Debug)]
pub(in crate::http) struct Passwords {
    addresses: Windows<Option<IpAddr>>,
    names: Windows<String>,
    checks: Arc<Semaphore>,
    waiting: Arc<Semaphore>,
}

impl Default for Passwords {
    fn default() -> Self {
        Self {
            addresses: Windows::default(),
            names: Windows::default(),
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
    let begin = |counted: Counted| match counted.left {
        Some(_) => Ok(()),
        None => Err(too_often(counted.reset)),
    };
    // A try is a failure until it has succeeded: tries at the same time must not all pass.
    begin(tries.addresses.count(address, OF_ADDRESS, now))?;
    // Names that nobody has cannot be guessed at, and would fill the memory.
    if user.is_some() {
        begin(tries.names.count(name.clone(), OF_NAME, now))?;
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
    // Earlier failures stay: they may be somebody else's.
    tries.addresses.take_back(&address);
    tries.names.take_back(&name);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_subscriber_is_an_address_or_a_network() {
        let of = |text: &str| network(text.parse().unwrap()).to_string();
        assert_eq!(of("::ffff:10.0.0.1"), "10.0.0.1");
        assert_eq!(of("2001:db8:1:2:3:4:5:6"), of("2001:db8:1:2::1"));
        assert_ne!(of("2001:db8:1:2::1"), of("2001:db8:1:3::1"));
    }
}
