//! The keys of a service, from its configuration file.
//!
//! ```toml
//! [[keys]]
//! name = "pacs"                       # in the audit trail
//! tenant = "radiology"                # "default" where it is left out
//! hash = "sha256:9f86d08188…"         # of the key, which is nowhere
//! scopes = ["read", "write"]
//! expires = 2027-12-31                # the last day, in UTC; or a moment: 2027-12-31T12:00:00Z
//! networks = ["10.20.0.0/16"]         # addresses that it may come from; all where it is left out
//! ```

use std::collections::{HashMap, HashSet};
use std::net::IpAddr;
use std::sync::{Arc, PoisonError, RwLock};

use ipnet::IpNet;
use serde::Deserialize;
use thiserror::Error;
use time::{Date, Duration, OffsetDateTime, Time, UtcOffset};
use toml::value::{Datetime, Offset};

use super::{Actor, Caller, KeyHash, Scope, Scopes, Secret, Tenant};

/// Most characters of a key's name.
const LONGEST_NAME: usize = 64;

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
}

/// Why the keys of a configuration file are refused.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{0}")]
pub struct KeyFault(String);

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

/// The keys of a service. Clones share them, and see when they are replaced.
#[derive(Debug, Clone, Default)]
pub struct Keyring(Arc<RwLock<Arc<Keys>>>);

impl Keyring {
    /// The keys in the text of a configuration file, whose other settings are not looked at.
    ///
    /// # Errors
    /// [`KeyFault`], which names the key.
    pub fn of_file(text: &str) -> Result<Self, KeyFault> {
        let file: File = toml::from_str(text).map_err(|error| KeyFault(error.to_string()))?;
        let (mut keys, mut names) = (Keys::new(), HashSet::new());
        for (i, written) in file.keys.into_iter().enumerate() {
            let place = format!("keys[{i}] ({:.64})", written.name);
            let key = written.read();
            let key = key.map_err(|fault| KeyFault(format!("{place}: {fault}")))?;
            if !names.insert(Arc::clone(&key.name)) {
                return Err(KeyFault(format!("{place}: another key has the same name")));
            }
            if let Some(other) = keys.insert(key.hash, Arc::new(key)) {
                let fault = format!("{place}: {} has the same hash", other.name);
                return Err(KeyFault(fault));
            }
        }
        Ok(Self(Arc::new(RwLock::new(Arc::new(keys)))))
    }

    /// Whether there are none: anybody may use the service.
    pub fn is_empty(&self) -> bool {
        self.keys().is_empty()
    }

    /// All keys, by their names.
    pub fn all(&self) -> Vec<Arc<Key>> {
        let mut all: Vec<_> = self.keys().values().map(Arc::clone).collect();
        all.sort_by(|a, b| a.name.cmp(&b.name));
        all
    }

    /// Takes over the keys of another one.
    ///
    /// # Errors
    /// [`KeyFault`] where that would open a service to all that had keys: it keeps them.
    pub fn replace(&self, with: &Self) -> Result<(), KeyFault> {
        if with.is_empty() && !self.is_empty() {
            let fault = "the file has no keys any more; they stay until the service starts again";
            return Err(KeyFault(fault.to_owned()));
        }
        let keys = with.keys();
        *self.0.write().unwrap_or_else(PoisonError::into_inner) = keys;
        Ok(())
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
        let keys = self.keys();
        let key = keys.get(&secret.hash()).ok_or(Refusal::Unknown)?;
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
            ..Caller::stranger()
        })
    }

    /// Whether somebody who was let in would be let in now, too.
    pub fn is_good(&self, caller: &Caller, now: i64) -> bool {
        let Actor::Key { id, .. } = &caller.actor else {
            return self.is_empty();
        };
        let keys = self.keys();
        let key = keys.values().find(|key| key.hash.id() == **id);
        key.is_some_and(|key| {
            key.tenant == caller.tenant && key.expires.is_none_or(|end| now < end)
        })
    }

    fn keys(&self) -> Arc<Keys> {
        Arc::clone(&self.0.read().unwrap_or_else(PoisonError::into_inner))
    }
}

/// The part of the file that is about keys.
#[derive(Deserialize)]
struct File {
    #[serde(default)]
    keys: Vec<Written>,
}

/// A key as it stands in the file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    name: String,
    #[serde(default)]
    tenant: Option<String>,
    hash: String,
    scopes: Vec<String>,
    expires: Option<Datetime>,
    #[serde(default)]
    networks: Vec<String>,
}

impl Written {
    fn read(self) -> Result<Key, String> {
        let plain = |c: char| c.is_ascii_graphic();
        if !(1..=LONGEST_NAME).contains(&self.name.len()) || !self.name.chars().all(plain) {
            return Err(format!(
                "name must have 1 to {LONGEST_NAME} visible ASCII characters without blanks"
            ));
        }
        let tenant = self.tenant.map(|name| name.parse::<Tenant>());
        let scopes = self.scopes.iter().map(|name| name.parse::<Scope>());
        let scopes: Scopes = scopes.collect::<Result<_, _>>()?;
        if scopes.is_empty() {
            return Err("scopes is empty: such a key opens nothing".to_owned());
        }
        let network = |text: &String| {
            let single = || text.parse::<IpAddr>().map(IpNet::from);
            text.parse::<IpNet>()
                .or_else(|_| single())
                .map_err(|_| format!("networks: '{text:.64}' is no network, as in 10.20.0.0/16"))
        };
        Ok(Key {
            name: self.name.into(),
            tenant: tenant
                .transpose()
                .map_err(|e| e.to_string())?
                .unwrap_or_default(),
            hash: self.hash.parse()?,
            scopes,
            expires: self.expires.map(|end| moment(&end)).transpose()?,
            networks: self
                .networks
                .iter()
                .map(network)
                .collect::<Result<_, _>>()?,
        })
    }
}

/// When a date ends, or a moment is, in milliseconds since the epoch.
fn moment(written: &Datetime) -> Result<i64, String> {
    let wrong = || {
        format!(
            "expires: {written} is no date, as in 2027-12-31, nor a moment with its zone, as in 2027-12-31T12:00:00Z"
        )
    };
    let date = written.date.ok_or_else(wrong)?;
    let month = time::Month::try_from(date.month).map_err(|_| wrong())?;
    let date = Date::from_calendar_date(date.year.into(), month, date.day);
    let date = date.map_err(|_| wrong())?;
    let end = match (written.time, written.offset) {
        (None, None) => date.midnight().assume_utc() + Duration::DAY,
        (Some(clock), Some(offset)) => {
            let second = clock.second.unwrap_or(0).min(59);
            let clock = Time::from_hms(clock.hour, clock.minute, second).map_err(|_| wrong())?;
            let minutes = match offset {
                Offset::Z => 0,
                Offset::Custom { minutes } => i32::from(minutes),
            };
            let offset = UtcOffset::from_whole_seconds(minutes * 60).map_err(|_| wrong())?;
            OffsetDateTime::new_in_offset(date, clock, offset)
        }
        _ => return Err(wrong()),
    };
    i64::try_from(end.unix_timestamp_nanos() / 1_000_000).map_err(|_| wrong())
}

#[cfg(test)]
mod tests {
    use super::*;

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
