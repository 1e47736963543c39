//! Who may ask, as the configuration file of a service says it.

use std::collections::{HashMap, HashSet};
use std::net::IpAddr;
use std::sync::Arc;

use ipnet::IpNet;
use serde::Deserialize;
use time::{Date, Duration, OffsetDateTime, Time, UtcOffset};
use toml::value::{Datetime, Offset};

use super::keyring::{Key, KeyFault, Ring};
use super::{Limits, Password, Scope, Scopes, Secret, Tenant, User};

/// Most characters of a name.
const LONGEST_NAME: usize = 64;

/// The parts of the file that are read here. Other settings are not looked at.
#[derive(Deserialize)]
struct File {
    #[serde(default)]
    keys: Vec<WrittenKey>,
    #[serde(default)]
    users: Vec<WrittenUser>,
    #[serde(default)]
    tenants: Vec<WrittenTenant>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenKey {
    name: String,
    tenant: Option<String>,
    hash: String,
    scopes: Vec<String>,
    expires: Option<Datetime>,
    #[serde(default)]
    networks: Vec<String>,
    #[serde(default)]
    limits: Limits,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenUser {
    name: String,
    tenant: Option<String>,
    password: String,
    scopes: Vec<String>,
    #[serde(default)]
    limits: Limits,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenTenant {
    name: String,
    #[serde(default)]
    limits: Limits,
}

/// What is wrong with a file in TOML, by the number of its line. The line itself is not shown: there may be a
/// secret in it, and this goes into logs.
pub(crate) fn told(error: &toml::de::Error, text: &str) -> String {
    let start = error.span().map_or(0, |span| span.start);
    let before = text.get(..start).unwrap_or_default();
    let number = 1 + before.matches('\n').count();
    let line = text.lines().nth(number - 1).unwrap_or_default();
    let secret = line.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
    if secret.filter(|part| part.parse::<Secret>().is_ok()).count() > 0 {
        return format!(
            "line {number} has a key in it, which is for its holder alone: the file gets the block with its hash \
             that `meshway key new` prints below it. Make another key, since this one was readable here"
        );
    }
    format!("line {number}: {}", error.message())
}

/// Reads keys, users and tenants.
///
/// # Errors
/// [`KeyFault`], which names the place in the file.
pub(super) fn read(text: &str) -> Result<Ring, KeyFault> {
    let file: File = toml::from_str(text).map_err(|error| KeyFault(told(&error, text)))?;
    let mut ring = Ring::default();
    let mut names = HashSet::new();
    for (i, written) in file.keys.into_iter().enumerate() {
        let place = format!("keys[{i}] ({:.64})", written.name);
        let at = |fault: String| KeyFault(format!("{place}: {fault}"));
        let key = written.read().map_err(at)?;
        if !names.insert(Arc::clone(&key.name)) {
            return Err(at("another key has the same name".to_owned()));
        }
        if let Some(other) = ring.keys.insert(key.hash, Arc::new(key)) {
            return Err(at(format!("{} has the same hash", other.name)));
        }
    }
    ring.users = users(file.users)?;
    for (i, written) in file.tenants.into_iter().enumerate() {
        let place = format!("tenants[{i}] ({:.64})", written.name);
        let at = |fault: String| KeyFault(format!("{place}: {fault}"));
        let name = written.name.parse::<Tenant>();
        let name = name.map_err(|error| at(error.to_string()))?;
        if ring.tenants.insert(name, written.limits).is_some() {
            return Err(at("the tenant is there twice".to_owned()));
        }
    }
    Ok(ring)
}

fn users(written: Vec<WrittenUser>) -> Result<HashMap<Arc<str>, Arc<User>>, KeyFault> {
    let mut users = HashMap::new();
    for (i, written) in written.into_iter().enumerate() {
        let place = format!("users[{i}] ({:.64})", written.name);
        let at = |fault: String| KeyFault(format!("{place}: {fault}"));
        let user = written.read().map_err(at)?;
        if users
            .insert(Arc::clone(&user.name), Arc::new(user))
            .is_some()
        {
            return Err(at("another user has the same name".to_owned()));
        }
    }
    Ok(users)
}

impl WrittenKey {
    fn read(self) -> Result<Key, String> {
        Ok(Key {
            name: name(&self.name)?,
            tenant: tenant(self.tenant.as_deref())?,
            hash: self.hash.parse()?,
            scopes: scopes(&self.scopes)?,
            expires: self.expires.map(|end| moment(&end)).transpose()?,
            networks: networks(&self.networks)?,
            limits: of_account(self.limits)?,
            in_file: true,
        })
    }
}

impl WrittenUser {
    fn read(self) -> Result<User, String> {
        Ok(User {
            name: name(&self.name)?,
            tenant: tenant(self.tenant.as_deref())?,
            password: self.password.parse::<Password>()?,
            scopes: scopes(&self.scopes)?,
            limits: of_account(self.limits)?,
        })
    }
}

/// A name in lists and in the audit trail.
///
/// # Errors
/// What is allowed.
pub fn name(text: &str) -> Result<Arc<str>, String> {
    let plain = |c: char| c.is_ascii_graphic();
    if (1..=LONGEST_NAME).contains(&text.len()) && text.chars().all(plain) {
        Ok(text.into())
    } else {
        Err(format!(
            "name must have 1 to {LONGEST_NAME} visible ASCII characters without blanks"
        ))
    }
}

/// Scopes by their names.
///
/// # Errors
/// What is allowed.
pub fn scopes(names: &[String]) -> Result<Scopes, String> {
    let scopes = names.iter().map(|name| name.parse::<Scope>());
    let scopes: Scopes = scopes.collect::<Result<_, _>>()?;
    if scopes.is_empty() {
        return Err("scopes is empty: such a key opens nothing".to_owned());
    }
    Ok(scopes)
}

/// Networks, or single addresses.
///
/// # Errors
/// Which is none.
pub fn networks(texts: &[String]) -> Result<Vec<IpNet>, String> {
    let network = |text: &String| {
        let single = || text.parse::<IpAddr>().map(IpNet::from);
        text.parse::<IpNet>()
            .or_else(|_| single())
            .map_err(|_| format!("networks: '{text:.64}' is no network, as in 10.20.0.0/16"))
    };
    texts.iter().map(network).collect()
}

/// Limits of a key or a user: what is stored is the tenant's.
///
/// # Errors
/// When it is limited.
pub fn of_account(limits: Limits) -> Result<Limits, String> {
    match limits.stored_mib {
        None => Ok(limits),
        Some(_) => {
            Err("limits: stored_mib is for [[tenants]], whose keys share what is stored".to_owned())
        }
    }
}

fn tenant(name: Option<&str>) -> Result<Tenant, String> {
    let tenant = name.map(str::parse::<Tenant>).transpose();
    Ok(tenant
        .map_err(|error| error.to_string())?
        .unwrap_or_default())
}

/// When a date ends, or a moment is, in milliseconds since the epoch.
pub(crate) fn moment(written: &Datetime) -> Result<i64, String> {
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
