//! Lists in a setting: values with commas between them.

use std::fmt::Display;
use std::str::FromStr;

use ipnet::IpNet;

use super::Config;

impl Config {
    /// Origins of other sites whose pages may use the service.
    pub fn origins(&self) -> impl Iterator<Item = &str> {
        parts(&self.allowed_origins)
    }

    /// Names that the service goes by besides localhost and its addresses.
    pub fn hosts(&self) -> impl Iterator<Item = &str> {
        parts(&self.allowed_hosts)
    }

    /// Networks of proxies that tell where a request comes from.
    pub fn trusted_proxies(&self) -> Vec<IpNet> {
        values(&self.trusted_proxies)
    }

    /// Networks that receivers of webhooks may be in.
    pub fn webhook_networks(&self) -> Vec<IpNet> {
        values(&self.webhook_networks)
    }

    /// Ports that they may have besides the usual ones.
    pub fn webhook_ports(&self) -> Vec<u16> {
        values(&self.webhook_ports)
    }
}

/// Values with commas between them, as they were given.
pub(super) fn list<T: FromStr<Err: Display>>(text: &str) -> Result<String, String> {
    let faults = parts(text).filter_map(|part| {
        let fault = part.parse::<T>().err()?;
        Some(format!("{part}: {fault}"))
    });
    match faults.collect::<Vec<_>>() {
        faults if faults.is_empty() => Ok(text.to_owned()),
        faults => Err(faults.join("; ")),
    }
}

/// The values of a list that was accepted.
fn values<T: FromStr>(list: &str) -> Vec<T> {
    parts(list).filter_map(|part| part.parse().ok()).collect()
}

/// The parts of a list with commas.
fn parts(list: &str) -> impl Iterator<Item = &str> {
    let parts = list.split(',').map(str::trim);
    parts.filter(|part| !part.is_empty())
}
