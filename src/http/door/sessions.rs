//! People who have signed in with a password: what their cookies stand for.
//!
//! A session is a row under the hash of what the cookie holds, so that it goes on after a start of the
//! service and on every node. It ends by signing out, by another password in the file, after half an hour
//! without a request, and after twelve hours in any case.

use sha2::{Digest, Sha256};

use crate::http::AppState;
use crate::http::wire::error::{ApiError, Result};
use crate::identity::{Caller, Secret, User};
use crate::jobs::{self, Session};

/// Longest time between two requests, and of a session, in milliseconds.
const IDLE_MS: i64 = 30 * 60 * 1_000;
const LONGEST_MS: i64 = 12 * 60 * 60 * 1_000;

/// Time between two notes that a session is used: each is a write, and a session may end so much too early.
const NOTED_MS: i64 = 60 * 1_000;

/// Most sessions at the same time; beyond it the one that was used least lately ends.
const MOST: u32 = 10_000;

/// Begins a session; gives what the cookie holds.
///
/// # Errors
/// Those of the store.
pub(in crate::http) async fn begin(app: &AppState, user: &User) -> Result<Secret> {
    let (secret, now) = (
        Secret::generate().map_err(ApiError::internal)?,
        app.store.now(),
    );
    let session = Session {
        user: user.name.to_string(),
        password: mark_of(user),
        began_at: now,
        used_at: now,
    };
    let bounds = (now - IDLE_MS, MOST);
    let begun = app.store.begin_session(hash_of(&secret), session, bounds);
    begun.await?;
    Ok(secret)
}

/// Who sends this cookie, if the session is open and the user known as when it began.
///
/// # Errors
/// Those of the store.
pub(in crate::http) async fn find(app: &AppState, secret: &Secret) -> Result<Option<Caller>> {
    let (hash, now) = (hash_of(secret), app.store.now());
    let Some(session) = app.store.session(&hash).await? else {
        return Ok(None);
    };
    let user = app.config.keys.user(&session.user);
    let known = user.filter(|user| mark_of(user) == session.password && is_open(&session, now));
    let Some(caller) = known.and_then(|user| app.config.keys.signed_in(&user)) else {
        app.store.end_session(hash).await?;
        return Ok(None);
    };
    if now - session.used_at >= NOTED_MS
        && let Err(error) = app.store.use_session(hash, now).await
    {
        // With a full disk people go on working.
        tracing::warn!(error.message = %error, "the use of a session was not noted");
    }
    Ok(Some(caller))
}

/// Ends a session.
///
/// # Errors
/// Those of the store.
pub(in crate::http) async fn end(app: &AppState, secret: &Secret) -> jobs::Result<()> {
    app.store.end_session(hash_of(secret)).await
}

fn is_open(session: &Session, now: i64) -> bool {
    // A clock that was set back must not make it longer.
    (0..LONGEST_MS).contains(&(now - session.began_at)) && now - session.used_at < IDLE_MS
}

fn hash_of(secret: &Secret) -> String {
    secret.hash().to_string()
}

/// What tells a password from another one of the same name, and does not help to guess it.
fn mark_of(user: &User) -> String {
    hex::encode(Sha256::digest(user.password.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_session_ends_when_it_is_idle_and_in_any_case() {
        let open = |began_at, used_at, now| {
            let session = Session {
                user: "anna".to_owned(),
                password: String::new(),
                began_at,
                used_at,
            };
            is_open(&session, now)
        };
        assert!(open(0, 0, IDLE_MS - 1) && !open(0, 0, IDLE_MS));
        let end = LONGEST_MS;
        assert!(open(0, end - 2, end - 1) && !open(0, end - 1, end));
        assert!(!open(1, 1, 0));
    }
}
