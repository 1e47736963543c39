//! Where the rows are: the address of a Postgres database.

use std::fmt;
use std::net::IpAddr;
use std::str::FromStr;

use serde::{Serialize, Serializer};
use url::Url;

/// Its address, as in `postgres://meshway@db.example/meshway?sslmode=verify-full`. It may have a
/// password in it, and is shown without.
#[derive(Clone, PartialEq, Eq)]
pub struct DatabaseUrl(Url);

impl DatabaseUrl {
    /// The address with its password: for who connects, not to be shown.
    pub fn secret(&self) -> &str {
        self.0.as_str()
    }

    /// What a network between here and the server could read or change; none where nothing is between,
    /// or TLS is asked for with a certificate of that name.
    pub(super) fn exposure(&self) -> Option<String> {
        let modes = self.values(&["sslmode", "ssl-mode"]);
        let checked = modes.last().is_some_and(|mode| mode == "verify-full");
        if checked || self.is_local() {
            return None;
        }
        Some(format!(
            "--database {self}: the server is on another machine, and whoever is between could read \
             or change what is stored; add sslmode=verify-full to the address (and sslrootcert=FILE \
             for an authority of your own), or give --insecure-backend"
        ))
    }

    /// Whether all hosts that it names are this machine.
    fn is_local(&self) -> bool {
        let mut hosts = self.values(&["host", "hostaddr"]);
        if hosts.is_empty() {
            hosts.extend(self.0.host_str().map(str::to_owned));
        }
        hosts.iter().all(|host| {
            let host = host.trim_matches(['[', ']']);
            let loopback = |address: IpAddr| address.is_loopback();
            host == "localhost"
                || host.starts_with('/')
                || host.starts_with("%2F")
                || host.starts_with("%2f")
                || host.parse().is_ok_and(loopback)
        })
    }

    fn values(&self, names: &[&str]) -> Vec<String> {
        let pairs = self.0.query_pairs();
        pairs
            .filter(|(name, _)| names.contains(&name.as_ref()))
            .map(|(_, value)| value.into_owned())
            .collect()
    }
}

impl FromStr for DatabaseUrl {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        const FORM: &str = "must be as in postgres://user@host/database?sslmode=verify-full";
        let url = Url::parse(text).map_err(|error| format!("{FORM}: {error}"))?;
        if !["postgres", "postgresql"].contains(&url.scheme()) {
            return Err(format!("{FORM}: the scheme is {}", url.scheme()));
        }
        Ok(Self(url))
    }
}

impl fmt::Display for DatabaseUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut shown = self.0.clone();
        // Fails where there can be none.
        let _ = shown.set_password(None);
        let pairs: Vec<(String, String)> = shown.query_pairs().into_owned().collect();
        let shown_pairs = pairs.iter().filter(|(name, _)| name != "password");
        if pairs.iter().any(|(name, _)| name == "password") {
            shown.query_pairs_mut().clear().extend_pairs(shown_pairs);
        }
        if shown.query() == Some("") {
            shown.set_query(None);
        }
        f.write_str(shown.as_str())
    }
}

impl fmt::Debug for DatabaseUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl Serialize for DatabaseUrl {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn url(text: &str) -> DatabaseUrl {
        text.parse().unwrap()
    }

    #[test]
    fn its_password_is_not_shown() {
        for (text, shown) in [
            ("postgres://a:secret@b/c", "postgres://a@b/c"),
            ("postgres://a@b/c?password=secret", "postgres://a@b/c"),
            (
                "postgres://a@b/c?password=secret&sslmode=require",
                "postgres://a@b/c?sslmode=require",
            ),
        ] {
            let url = url(text);
            assert_eq!(url.to_string(), shown);
            assert!(!format!("{url:?}").contains("secret"));
            assert!(url.secret().contains("secret"));
        }
    }

    #[test]
    fn a_server_elsewhere_needs_a_certificate() {
        for (text, exposed) in [
            ("postgres://a@localhost/c", false),
            ("postgres://a@127.0.0.1:5433/c", false),
            ("postgres://a@[::1]/c", false),
            ("postgres:///c?host=/run/postgresql", false),
            ("postgres://a@%2Frun%2Fpostgresql/c", false),
            ("postgres://a@db.example/c?sslmode=verify-full", false),
            ("postgres://a@db.example/c", true),
            ("postgres://a@db.example/c?sslmode=require", true),
            (
                "postgres://a@db.example/c?sslmode=verify-full&sslmode=disable",
                true,
            ),
            ("postgres://a@localhost/c?host=db.example", true),
        ] {
            assert_eq!(url(text).exposure().is_some(), exposed, "{text}");
        }
    }

    #[test]
    fn other_addresses_are_refused() {
        for text in ["mysql://a@b/c", "meshway.db", ""] {
            let refused = text.parse::<DatabaseUrl>().unwrap_err();
            assert!(refused.contains("postgres://"), "{refused}");
        }
    }
}
