//! Which addresses messages may go to.

use std::net::{IpAddr, SocketAddr};
use std::sync::LazyLock;

use ipnet::IpNet;
use url::{Host, Url};

use crate::config::Config;

/// Most characters of the address of a webhook.
const LONGEST: usize = 2_000;

/// Ports that any receiver may have, besides those that the operator names.
const PORTS: [std::ops::RangeInclusive<u16>; 3] = [80..=80, 443..=443, 8_000..=9_999];

/// Networks that are not the public internet: the special-purpose registries of IANA, with what leads to
/// IPv4 addresses in disguise.
static NOT_PUBLIC: LazyLock<Vec<IpNet>> = LazyLock::new(|| {
    let networks = [
        "0.0.0.0/8",
        "10.0.0.0/8",
        "100.64.0.0/10",
        "127.0.0.0/8",
        "169.254.0.0/16",
        "172.16.0.0/12",
        "192.0.0.0/24",
        "192.0.2.0/24",
        "192.88.99.0/24",
        "192.168.0.0/16",
        "198.18.0.0/15",
        "198.51.100.0/24",
        "203.0.113.0/24",
        "224.0.0.0/4",
        "240.0.0.0/4",
        "::/96",
        "64:ff9b::/96",
        "64:ff9b:1::/48",
        "100::/64",
        "2001::/23",
        "2001:db8::/32",
        "2002::/16",
        "3fff::/20",
        "5f00::/16",
        "fc00::/7",
        "fe80::/10",
        "fec0::/10",
        "ff00::/8",
    ];
    let parsed = networks.iter().map(|network| network.parse());
    parsed
        .collect::<Result<_, _>>()
        .expect("networks are well-formed")
});

/// What the operator allows. Nothing but the public internet over TLS, where nothing is named.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Policy {
    /// Networks of the house that receivers may be in, also without TLS.
    pub networks: Vec<IpNet>,
    /// Ports that receivers may have, besides the usual ones.
    pub ports: Vec<u16>,
}

impl Policy {
    /// What the settings of a service say.
    pub fn of(config: &Config) -> Self {
        Self {
            networks: config.webhook_networks(),
            ports: config.webhook_ports(),
        }
    }

    /// The address of a webhook, as far as it can be judged without resolving its name.
    ///
    /// # Errors
    /// What is wrong with it, in one sentence.
    pub fn url(&self, text: &str) -> Result<Url, String> {
        if text.len() > LONGEST {
            return Err(format!("must have at most {LONGEST} characters"));
        }
        let url = Url::parse(text).map_err(|error| {
            format!("must be an address such as https://example.org/hook: {error}")
        })?;
        if !matches!(url.scheme(), "https" | "http") {
            return Err(
                "must begin with https:// (or http:// in a network of --webhook-networks)"
                    .to_owned(),
            );
        }
        if !url.username().is_empty() || url.password().is_some() {
            return Err("must have no name or password before its host".to_owned());
        }
        if url.fragment().is_some() {
            return Err("must have no part after #".to_owned());
        }
        let port = url.port_or_known_default().unwrap_or_default();
        if !self.ports.contains(&port) && !PORTS.iter().any(|ports| ports.contains(&port)) {
            return Err(format!(
                "port {port} is not allowed: 80, 443, 8000 to 9999 and those of --webhook-ports are"
            ));
        }
        let literal = match url.host() {
            Some(Host::Ipv4(address)) => Some(IpAddr::V4(address)),
            Some(Host::Ipv6(address)) => Some(IpAddr::V6(address)),
            Some(Host::Domain(_)) => None,
            None => return Err("must have a host".to_owned()),
        };
        if let Some(address) = literal {
            self.check(&url, &[SocketAddr::new(address, port)])?;
        } else if url.scheme() == "http" && self.networks.is_empty() {
            return Err(Self::unencrypted());
        }
        Ok(url)
    }

    /// Whether messages may go to a name that stands for these addresses: to all of them, since it cannot
    /// be known which of them the next look finds first.
    ///
    /// # Errors
    /// What is wrong with them, in one sentence.
    pub fn check(&self, url: &Url, addresses: &[SocketAddr]) -> Result<(), String> {
        if addresses.is_empty() {
            return Err("the name of the host has no address".to_owned());
        }
        for address in addresses {
            // ::ffff:a.b.c.d is a.b.c.d.
            let address = address.ip().to_canonical();
            if self
                .networks
                .iter()
                .any(|network| network.contains(&address))
            {
                continue;
            }
            if NOT_PUBLIC.iter().any(|network| network.contains(&address)) {
                return Err(format!(
                    "{address} is no address of the public internet; the operator can allow its \
                     network with --webhook-networks"
                ));
            }
            if url.scheme() == "http" {
                return Err(Self::unencrypted());
            }
        }
        Ok(())
    }

    fn unencrypted() -> String {
        "must begin with https://: http:// is for the networks of --webhook-networks".to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn policy(networks: &[&str]) -> Policy {
        Policy {
            networks: networks
                .iter()
                .map(|network| network.parse().unwrap())
                .collect(),
            ports: vec![4_430],
        }
    }

    #[test]
    fn public_addresses_are_good_over_tls_only() {
        let policy = policy(&[]);
        for good in [
            "https://example.org/hook?token=1",
            "https://example.org:4430/",
            "https://8.8.8.8:9000/",
            "https://[2606:4700::1111]/",
        ] {
            assert!(policy.url(good).is_ok(), "{good}");
        }
        for (bad, said) in [
            ("http://example.org/", "https://"),
            ("http://8.8.8.8/", "https://"),
            ("ftp://example.org/", "https://"),
            ("https://example.org:22/", "port 22"),
            ("https://anna:secret@example.org/", "password"),
            ("https://example.org/#part", "#"),
            ("example.org", "must be an address"),
            ("https://", "must be an address"),
        ] {
            let fault = policy.url(bad).unwrap_err();
            assert!(fault.contains(said), "{bad}: {fault}");
        }
    }

    #[test]
    fn addresses_that_only_the_service_can_reach_are_refused_in_every_spelling() {
        let policy = policy(&["10.20.0.0/16"]);
        for bad in [
            "https://127.0.0.1/",
            "https://127.1/",
            "https://0x7f000001/",
            "https://2130706433/",
            "https://0177.0.0.1/",
            "https://[::1]/",
            "https://[::ffff:127.0.0.1]/",
            "https://[::ffff:169.254.169.254]/",
            "https://[64:ff9b::7f00:1]/",
            "https://[2002:7f00:1::]/",
            "https://[::127.0.0.1]/",
            "https://169.254.169.254/latest/meta-data",
            "https://10.21.0.1/",
            "https://192.168.1.1/",
            "https://100.64.0.1/",
            "https://0.0.0.0/",
            "https://255.255.255.255/",
            "https://224.0.0.1/",
            "https://[fd00::1]/",
            "https://[fe80::1]/",
        ] {
            let fault = policy.url(bad).unwrap_err();
            assert!(fault.contains("--webhook-networks"), "{bad}: {fault}");
        }
        for good in [
            "http://10.20.3.4:8080/",
            "https://10.20.3.4/",
            "http://[::ffff:10.20.3.4]/",
        ] {
            assert!(policy.url(good).is_ok(), "{good}");
        }
    }

    #[test]
    fn a_name_is_judged_by_all_of_its_addresses() {
        let policy = policy(&["10.20.0.0/16"]);
        let check = |url: &str, addresses: &[&str]| {
            let addresses: Vec<_> = addresses.iter().map(|a| a.parse().unwrap()).collect();
            policy.check(&Url::parse(url).unwrap(), &addresses)
        };
        assert!(check("https://a.example/", &["8.8.8.8:443", "10.20.0.1:443"]).is_ok());
        assert!(check("https://a.example/", &["8.8.8.8:443", "10.0.0.1:443"]).is_err());
        assert!(check("http://a.example/", &["10.20.0.1:80"]).is_ok());
        assert!(check("http://a.example/", &["10.20.0.1:80", "8.8.8.8:80"]).is_err());
        assert!(check("https://a.example/", &[]).is_err());
    }
}
