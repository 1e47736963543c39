//! People who have signed in with a password: what their cookies stand for.
//!
//! A session is known by the hash of what the cookie holds, in memory alone: nothing of it is on the
//! disk, and the end of the service ends it. So do signing out, another password in the file, half an
//! hour without a request, and twelve hours in any case.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use crate::identity::{Caller, KeyHash, Keyring, Secret, User};

/// Longest time between two requests, and of a session, in milliseconds.
const IDLE_MS: i64 = 30 * 60 * 1_000;
const LONGEST_MS: i64 = 12 * 60 * 60 * 1_000;

/// Most sessions at the same time; beyond it the one that was used least lately ends.
const MOST: usize = 10_000;

/// All sessions.
#[derive(Debug, Default)]
pub(in crate::http) struct Sessions(Mutex<HashMap<KeyHash, Session>>);

#[derive(Debug)]
struct Session {
    user: Arc<User>,
    /// In milliseconds since the epoch.
    began: i64,
    used: i64,
}

impl Session {
    fn is_open(&self, now: i64) -> bool {
        // A clock that was set back must not make it longer.
        (0..LONGEST_MS).contains(&(now - self.began)) && now - self.used < IDLE_MS
    }
}

impl Sessions {
    /// Begins one; gives what the cookie holds.
    ///
    /// # Errors
    /// When the system has no random numbers.
    pub(in crate::http) fn begin(
        &self,
        user: Arc<User>,
        now: i64,
    ) -> Result<Secret, getrandom::Error> {
        let secret = Secret::generate()?;
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if all.len() >= MOST {
            all.retain(|_, session| session.is_open(now));
        }
        if all.len() >= MOST {
            let oldest = all.iter().min_by_key(|(_, session)| session.used);
            let oldest = oldest.map(|(hash, _)| *hash);
            oldest.and_then(|hash| all.remove(&hash));
        }
        let session = Session {
            user,
            began: now,
            used: now,
        };
        all.insert(secret.hash(), session);
        Ok(secret)
    }

    /// Who sends this cookie, if the session is open and the user known as when it began.
    pub(in crate::http) fn find(
        &self,
        secret: &Secret,
        keys: &Keyring,
        now: i64,
    ) -> Option<Caller> {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let session = all.get_mut(&secret.hash())?;
        let caller = keys
            .signed_in(&session.user)
            .filter(|_| session.is_open(now));
        match &caller {
            Some(_) => session.used = now,
            None => drop(all.remove(&secret.hash())),
        }
        caller
    }

    /// Ends one.
    pub(in crate::http) fn end(&self, secret: &Secret) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all.remove(&secret.hash());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identity::Password;

    fn keyring(password: &Password) -> Keyring {
        let text =
            format!("[[users]]\nname = \"anna\"\npassword = \"{password}\"\nscopes = [\"read\"]\n");
        Keyring::of_file(&text).unwrap()
    }

    #[test]
    fn a_session_ends_when_it_is_idle_and_in_any_case() {
        let keys = keyring(&Password::of("correct horse").unwrap());
        let sessions = Sessions::default();
        let begin = || sessions.begin(keys.user("anna").unwrap(), 0).unwrap();
        let secret = begin();
        let found = |secret: &Secret, now| sessions.find(secret, &keys, now).is_some();
        assert!(found(&secret, IDLE_MS - 1) && !found(&secret, 2 * IDLE_MS - 1));
        // It does not come back.
        assert!(!found(&secret, IDLE_MS));
        let busy = begin();
        for now in (0..LONGEST_MS).step_by(1_000_000) {
            assert!(found(&busy, now), "{now}");
        }
        assert!(!found(&busy, LONGEST_MS));
        let ended = begin();
        sessions.end(&ended);
        assert!(!found(&ended, 1) && !found(&Secret::generate().unwrap(), 1));
    }

    #[test]
    fn a_session_ends_with_its_password_and_its_user() {
        let keys = keyring(&Password::of("correct horse").unwrap());
        let sessions = Sessions::default();
        let secret = sessions.begin(keys.user("anna").unwrap(), 0).unwrap();
        keys.replace(&keyring(&Password::of("battery staple").unwrap()))
            .unwrap();
        assert!(sessions.find(&secret, &keys, 1).is_none());
    }
}
