//! Where a request comes from: the other end of its connection or, behind proxies, what these tell.

use std::net::IpAddr;

use axum::http::HeaderMap;
use ipnet::IpNet;

/// The header in which each proxy adds, at the end, who asked it.
const FORWARDED: &str = "x-forwarded-for";

/// The address that a request comes from. It is that of keys, audit trail, limits and log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::http) struct Client(pub(in crate::http) IpAddr);

impl Client {
    /// Who is behind the peer. Each address of the header was written by the one after it, and the last one by
    /// the peer, so that it is worth as much as that one is trusted: what a client writes itself comes to nothing.
    pub(in crate::http) fn behind(peer: IpAddr, headers: &HeaderMap, trusted: &[IpNet]) -> Self {
        let is_trusted = |address: &IpAddr| trusted.iter().any(|network| network.contains(address));
        let told = headers.get_all(FORWARDED).iter().rev();
        let told = told.flat_map(|text| text.to_str().unwrap_or_default().rsplit(','));
        let mut client = peer.to_canonical();
        for told in told {
            if !is_trusted(&client) {
                break;
            }
            // What is no address is not gone beyond: the proxy that wrote it is all that is known.
            let Ok(address) = told.trim().parse::<IpAddr>() else {
                break;
            };
            client = address.to_canonical();
        }
        Self(client)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_trusted_proxies_are_believed() {
        let trusted: Vec<IpNet> = ["10.0.0.0/8", "::1/128"].map(|n| n.parse().unwrap()).into();
        let from = |peer: &str, told: &[&str]| {
            let mut headers = HeaderMap::new();
            for told in told {
                headers.append(FORWARDED, told.parse().unwrap());
            }
            let client = Client::behind(peer.parse().unwrap(), &headers, &trusted);
            client.0.to_string()
        };
        assert_eq!(from("10.0.0.1", &[]), "10.0.0.1");
        assert_eq!(from("10.0.0.1", &["203.0.113.7"]), "203.0.113.7");
        assert_eq!(from("::1", &["2001:db8::1"]), "2001:db8::1");
        // A peer over a socket for both families.
        assert_eq!(from("::ffff:10.0.0.1", &["203.0.113.7"]), "203.0.113.7");
        // Two proxies, in one header or two; what the client wrote before is not looked at.
        assert_eq!(
            from("10.0.0.1", &["6.6.6.6, 203.0.113.7, 10.0.0.2"]),
            "203.0.113.7"
        );
        assert_eq!(
            from("10.0.0.1", &["6.6.6.6,203.0.113.7", "10.0.0.2"]),
            "203.0.113.7"
        );
        // No proxy of ours.
        assert_eq!(from("203.0.113.7", &["6.6.6.6"]), "203.0.113.7");
        // What is no address.
        assert_eq!(from("10.0.0.1", &["6.6.6.6, unknown"]), "10.0.0.1");
        assert_eq!(from("10.0.0.1", &["10.0.0.3"]), "10.0.0.3");
    }
}
