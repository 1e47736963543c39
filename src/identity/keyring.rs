//! The keys and users of a service, from its configuration file and, made by its API, from its database.
//!
//! ```toml
//! [[keys]]
//! name = "pacs"                       # in the audit trail
//! tenant = "radiology"                # "default" where it is left out
//! hash = "sha256:9f86d08188…"         # of the key, which is nowhere
//! scopes = ["read", "write"]
//! expires = 2027-12-31                # the last day, in UTC; or a moment: 2027-12-31T12:00:00Z
//! networks = ["10.20.0.0/16"]         # addresses that it may come from; all where it is left out
//! limits = { requests_per_minute = 600, queued_jobs = 20, compute_seconds_per_day = 3600 }
//!
//! [[users]]
//! name = "anna"
//! tenant = "radiology"
//! password = "$argon2id$v=19$…"       # of `meshway user passwd`
//! scopes = ["read", "write"]
//!
//! [[tenants]]
//! name = "radiology"
//! limits = { stored_mib = 20480 }
//! ```

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, PoisonError, RwLock};

use ipnet::IpNet;
use thiserror::Error;

use super::{Actor, Allowance, Caller, KeyHash, Limits, Scopes, Secret, Tenant, User, file};

/// A key as it is configured.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Key {
    /// Its name, one for each key.
    pub name: Arc<str>,
    /// Whose records it opens.
    pub tenant: Tenant,
    /// Hash of its text.
    pub hash: KeyHash,
    /// What it allows.
    pub scopes: Scopes,
    /// When it ends, in milliseconds since the epoch.
    pub expires: Option<i64>,
    /// The addresses that it may come from; empty: all.
    pub networks: Vec<IpNet>,
    /// What it may take.
    pub limits: Limits,
    /// Whether it stands in the file; else the API made it.
    pub in_file: bool,
}

/// Why the keys of a configuration file are refused.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{0}")]
pub struct KeyFault(pub(super) String);

/// Why a key opens nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// There is no such key.
    Unknown,
    /// It has ended.
    Expired,
    /// It may not come from that address.
    Elsewhere,
}

impl Refusal {
    /// Its name in the log.
    pub fn name(self) -> &'static str {
        match self {
            Self::Unknown => "unknown",
            Self::Expired => "expired",
            Self::Elsewhere => "elsewhere",
        }
    }
}

/// Keys by their hashes. Found by the hash of what was sent: what a look-up's time tells is about a
/// hash, from which nobody gets to a key.
type Keys = HashMap<KeyHash, Arc<Key>>;

/// Who is known.
#[derive(Debug, Clone, Default)]
pub(super) struct Ring {
    pub(super) keys: Keys,
    pub(super) users: HashMap<Arc<str>, Arc<User>>,
    pub(super) tenants: HashMap<Tenant, Limits>,
}

impl Ring {
    /// Whether the file names nobody.
    fn names_nobody(&self) -> bool {
        self.users.is_empty() && !self.keys.values().any(|key| key.in_file)
    }
}

/// The keys of a service. Clones share them, and see when they are replaced.
#[derive(Debug, Clone, Default)]
pub struct Keyring(Arc<RwLock<Arc<Ring>>>);

impl Keyring {
    /// Keys, users and tenants in the text of a configuration file, whose other settings are not
    /// looked at.
    ///
    /// # Errors
    /// [`KeyFault`], which names the key.
    pub fn of_file(text: &str) -> Result<Self, KeyFault> {
        let ring = file::read(text)?;
        Ok(Self(Arc::new(RwLock::new(Arc::new(ring)))))
    }

    /// Whether there are none, nor users: anybody may use the service.
    pub fn is_empty(&self) -> bool {
        let ring = self.ring();
        ring.keys.is_empty() && ring.users.is_empty()
    }

    /// Whether people can sign in with a password.
    pub fn has_users(&self) -> bool {
        !self.ring().users.is_empty()
    }

    /// All keys, by their names.
    pub fn all(&self) -> Vec<Arc<Key>> {
        let mut all: Vec<_> = self.ring().keys.values().map(Arc::clone).collect();
        all.sort_by(|a, b| a.name.cmp(&b.name));
        all
    }

    /// The user of this name.
    pub fn user(&self, name: &str) -> Option<Arc<User>> {
        self.ring().users.get(name).map(Arc::clone)
    }

    /// Takes over what another one has of the file. Keys that the API made stay.
    ///
    /// # Errors
    /// [`KeyFault`] where that would open a service to all that had keys: it keeps them.
    pub fn replace(&self, with: &Self) -> Result<(), KeyFault> {
        let new = with.ring();
        self.change(|old| {
            if new.names_nobody() && !old.names_nobody() {
                let fault =
                    "the file has no keys any more; they stay until the service starts again";
                return Err(KeyFault(fault.to_owned()));
            }
            let made = old.keys.iter().filter(|(_, key)| !key.in_file);
            let made: Vec<_> = made.map(|(hash, key)| (*hash, Arc::clone(key))).collect();
            *old = Ring::clone(&new);
            for (hash, key) in made {
                old.keys.entry(hash).or_insert(key);
            }
            Ok(())
        })
    }

    /// Adds a key that the API made.
    pub fn add(&self, key: Key) {
        self.change(|ring| {
            ring.keys.entry(key.hash).or_insert_with(|| Arc::new(key));
        });
    }

    /// Has these as all keys that APIs made: those of this process and of others with the same records.
    pub fn take_made(&self, made: Vec<Key>) {
        let ring = self.ring();
        let had = ring.keys.values().filter(|key| !key.in_file);
        let mut had: Vec<&Key> = had.map(|key| &**key).collect();
        had.sort_by_key(|key| key.hash.to_string());
        let mut has: Vec<&Key> = made.iter().collect();
        has.sort_by_key(|key| key.hash.to_string());
        if had == has {
            return;
        }
        self.change(|ring| {
            ring.keys.retain(|_, key| key.in_file);
            for key in made {
                ring.keys.entry(key.hash).or_insert_with(|| Arc::new(key));
            }
        });
    }

    /// Takes out a key that the API made.
    pub fn remove(&self, hash: &KeyHash) {
        self.change(|ring| {
            if ring.keys.get(hash).is_some_and(|key| !key.in_file) {
                ring.keys.remove(hash);
            }
        });
    }

    fn change<T>(&self, change: impl FnOnce(&mut Ring) -> T) -> T {
        let mut shared = self.0.write().unwrap_or_else(PoisonError::into_inner);
        change(Arc::make_mut(&mut shared))
    }

    /// Who holds the key, at a time in milliseconds since the epoch.
    ///
    /// # Errors
    /// [`Refusal`].
    pub fn identify(
        &self,
        secret: &Secret,
        address: Option<IpAddr>,
        now: i64,
    ) -> Result<Caller, Refusal> {
        let ring = self.ring();
        let key = ring.keys.get(&secret.hash()).ok_or(Refusal::Unknown)?;
        if key.expires.is_some_and(|end| now >= end) {
            return Err(Refusal::Expired);
        }
        let from = |address: IpAddr| {
            // An IPv6 socket shows IPv4 clients as ::ffff:a.b.c.d.
            let address = address.to_canonical();
            key.networks.iter().any(|net| net.contains(&address))
        };
        if !key.networks.is_empty() && !address.is_some_and(from) {
            return Err(Refusal::Elsewhere);
        }
        Ok(Caller {
            tenant: key.tenant.clone(),
            scopes: key.scopes,
            actor: Actor::Key {
                name: Arc::clone(&key.name),
                id: key.hash.id().into(),
            },
            allowance: ring.allowance(&key.tenant, key.limits),
            ..Caller::stranger()
        })
    }

    /// The caller that a user is who has signed in, if the user is still known as then.
    pub fn signed_in(&self, user: &User) -> Option<Caller> {
        let ring = self.ring();
        let known = ring.users.get(&user.name)?;
        (known.password == user.password).then(|| Caller {
            tenant: known.tenant.clone(),
            scopes: known.scopes,
            actor: Actor::User {
                name: Arc::clone(&known.name),
            },
            allowance: ring.allowance(&known.tenant, known.limits),
            ..Caller::stranger()
        })
    }

    /// Whether somebody who was let in would be let in now, too.
    pub fn is_good(&self, caller: &Caller, now: i64) -> bool {
        let ring = self.ring();
        match &caller.actor {
            Actor::Key { id, .. } => {
                let key = ring.keys.values().find(|key| key.hash.id() == **id);
                key.is_some_and(|key| {
                    key.tenant == caller.tenant && key.expires.is_none_or(|end| now < end)
                })
            }
            Actor::User { name } => {
                let user = ring.users.get(name);
                user.is_some_and(|user| user.tenant == caller.tenant)
            }
            Actor::Service => true,
            Actor::Anybody | Actor::Stranger => self.is_empty(),
        }
    }

    pub(super) fn ring(&self) -> Arc<Ring> {
        Arc::clone(&self.0.read().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Ring {
    fn allowance(&self, tenant: &Tenant, account: Limits) -> Allowance {
        Allowance {
            tenant: self.tenants.get(tenant).copied().unwrap_or_default(),
            account,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identity::Scope;

    fn file(secret: &Secret, more: &str) -> String {
        let hash = secret.hash();
        format!(
            "listen = \"127.0.0.1:0\"\n[[keys]]\nname = \"pacs\"\nhash = \"{hash}\"\n\
             scopes = [\"read\", \"write\"]\n{more}\n"
        )
    }

    #[test]
    fn a_key_opens_what_the_file_says() {
        let secret = Secret::generate().unwrap();
        let more =
            "tenant = \"radiology\"\nnetworks = [\"10.20.0.0/16\", \"::1\"]\nexpires = 2027-12-31";
        let keyring = Keyring::of_file(&file(&secret, more)).unwrap();
        let ask =
            |address: &str, now| keyring.identify(&secret, Some(address.parse().unwrap()), now);
        let caller = ask("10.20.3.4", 0).unwrap();
        assert_eq!(caller.tenant.as_str(), "radiology");
        assert!(caller.may(Scope::Write) && !caller.may(Scope::Delete));
        assert!(ask("::ffff:10.20.3.4", 0).is_ok() && ask("::1", 0).is_ok());
        assert_eq!(ask("10.21.0.1", 0), Err(Refusal::Elsewhere));
        assert_eq!(keyring.identify(&secret, None, 0), Err(Refusal::Elsewhere));
        // 2028-01-01T00:00:00Z, by `date -u -d 2028-01-01 +%s`.
        let end = 1_830_297_600_000;
        assert!(ask("::1", end - 1).is_ok());
        assert_eq!(ask("::1", end), Err(Refusal::Expired));
        let other = Secret::generate().unwrap();
        assert_eq!(keyring.identify(&other, None, 0), Err(Refusal::Unknown));
    }

    #[test]
    fn a_moment_has_a_zone() {
        let secret = Secret::generate().unwrap();
        let at = |text: &str| {
            let keyring = Keyring::of_file(&file(&secret, &format!("expires = {text}")));
            keyring.map(|keyring| keyring.all()[0].expires)
        };
        assert_eq!(at("2028-01-01T01:00:00+01:00"), Ok(Some(1_830_297_600_000)));
        assert_eq!(at("2028-01-01T00:00:00Z"), Ok(Some(1_830_297_600_000)));
        for wrong in ["2028-01-01T01:00:00", "01:00:00"] {
            assert!(
                at(wrong).unwrap_err().to_string().contains("expires"),
                "{wrong}"
            );
        }
    }

    #[test]
    fn what_is_wrong_names_its_key() {
        let secret = Secret::generate().unwrap();
        let good = file(&secret, "");
        for (text, said) in [
            (
                file(&secret, "tenant = \"A B\""),
                "keys[0] (pacs): the name of a tenant",
            ),
            (
                file(&secret, "networks = [\"10.0.0.0/33\"]"),
                "'10.0.0.0/33' is no network",
            ),
            (file(&secret, "scope = 1"), "unknown field `scope`"),
            (
                format!("{}\n{good}", secret.reveal()),
                "line 1 has a key in it",
            ),
            (format!("{good}\nx"), "line 8: "),
            (good.replace("\"write\"", "\"all\""), "not 'all'"),
            (good.replace("\"read\", \"write\"", ""), "scopes is empty"),
            (
                good.replace("sha256:", "md5:"),
                "a hash has the form sha256:",
            ),
            (good.replace("\"pacs\"", "\"\""), "name must have 1 to 64"),
            (
                format!("{good}{}", &good[good.find("[[").unwrap()..]),
                "same name",
            ),
        ] {
            let fault = Keyring::of_file(&text).unwrap_err().to_string();
            assert!(fault.contains(said), "{said}: {fault}");
            assert!(!fault.contains(secret.reveal()), "{fault}");
        }
    }

    #[test]
    fn keys_are_replaced_for_all_clones_but_never_by_none() {
        let (old, new) = (Secret::generate().unwrap(), Secret::generate().unwrap());
        let keyring = Keyring::of_file(&file(&old, "")).unwrap();
        let clone = keyring.clone();
        clone
            .replace(&Keyring::of_file(&file(&new, "")).unwrap())
            .unwrap();
        let caller = keyring.identify(&new, None, 0).unwrap();
        assert!(keyring.is_good(&caller, 0) && !keyring.is_good(&Caller::anybody(), 0));
        assert_eq!(keyring.identify(&old, None, 0), Err(Refusal::Unknown));
        assert!(clone.replace(&Keyring::default()).is_err());
        clone
            .replace(&Keyring::of_file(&file(&old, "")).unwrap())
            .unwrap();
        assert!(!keyring.is_good(&caller, 0));
        assert!(!keyring.is_empty());
    }
}
