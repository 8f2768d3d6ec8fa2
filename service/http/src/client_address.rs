//! Address of a request's client: the connection's, or the one that trusted proxies forward.

use std::convert::Infallible;
use std::net::{IpAddr, SocketAddr};

use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName, header};

use crate::instances::{InstanceAddresses, is_forwarded};
use crate::trusted_proxies::TrustedProxies;

/// Header that most proxies set.
static X_FORWARDED_FOR: HeaderName = HeaderName::from_static("x-forwarded-for");

/// Address of a request's client: forwarded by trusted proxies, else the connection's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PeerAddress(pub Option<IpAddr>);

impl<S: Send + Sync> FromRequestParts<S> for PeerAddress {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        Ok(parts.extensions.get().copied().unwrap_or(Self(None)))
    }
}

impl PeerAddress {
    /// Returns the key for counting. An IPv6 address counts by its network, which belongs to one
    /// site with many addresses.
    pub fn key(self) -> String {
        match self.0.map(|address| address.to_canonical()) {
            None => "unknown".to_owned(),
            Some(IpAddr::V4(address)) => address.to_string(),
            Some(IpAddr::V6(address)) => {
                let [a, b, c, d, ..] = address.segments();
                format!("{a:x}:{b:x}:{c:x}:{d:x}::/64")
            }
        }
    }

    /// Returns the key for counting a name at this address; names have no line breaks.
    pub fn with_name(self, name: &str) -> String {
        format!("{}\n{name}", self.key())
    }

    /// Returns the address of a request's client, for a connection from `self`: the last hop that
    /// is neither a trusted proxy nor, for a request that an instance forwards, another instance.
    /// From any other sender these headers are ignored.
    ///
    /// Proxies append to one header and pass the other on as the client sent it. If both are given
    /// and differ, the proxy's cannot be identified: then it is the proxy's address.
    pub(crate) fn behind(
        self,
        headers: &HeaderMap,
        trusted: &TrustedProxies,
        instances: &InstanceAddresses,
    ) -> Self {
        let is_forwarded = is_forwarded(headers);
        let trusts = |hop: IpAddr| trusted.contain(hop) || (is_forwarded && instances.contain(hop));
        let Some(proxy) = self.0.filter(|peer| trusts(*peer)) else {
            return self;
        };
        let forwarded = hops(headers, &header::FORWARDED, node_of_forwarded);
        let listed = hops(headers, &X_FORWARDED_FOR, |entry| Some(entry.trim()));
        let client = |hops: Vec<Option<IpAddr>>| last_untrusted(proxy, &hops, &trusts);
        let address = match (forwarded.map(client), listed.map(client)) {
            (Some(one), None) | (None, Some(one)) => one,
            (Some(one), Some(other)) if one == other => one,
            (Some(_), Some(_)) | (None, None) => proxy,
        };
        Self(Some(address))
    }
}

/// Returns the last address that is not a trusted proxy. Behind an entry without an address, which
/// may be forged, it is the hop that sent it.
fn last_untrusted(
    proxy: IpAddr,
    hops: &[Option<IpAddr>],
    trusts: &impl Fn(IpAddr) -> bool,
) -> IpAddr {
    let mut last = proxy;
    for hop in hops.iter().rev() {
        let Some(address) = hop else { return last };
        last = *address;
        if !trusts(last) {
            return last;
        }
    }
    last
}

/// Returns the addresses in a header, in the order in which they were appended; `None` without the
/// header.
fn hops(
    headers: &HeaderMap,
    name: &HeaderName,
    node: impl Fn(&str) -> Option<&str>,
) -> Option<Vec<Option<IpAddr>>> {
    headers.get(name)?;
    let values = headers.get_all(name).iter();
    let entries = values.flat_map(|value| value.to_str().unwrap_or("").split(','));
    Some(
        entries
            .map(|entry| node(entry).and_then(address_of))
            .collect(),
    )
}

/// Extracts the node of one element of `Forwarded` (RFC 7239): `for=192.0.2.60;proto=http`.
fn node_of_forwarded(element: &str) -> Option<&str> {
    element.split(';').find_map(|pair| {
        let (name, value) = pair.trim().split_once('=')?;
        let is_for = name.trim().eq_ignore_ascii_case("for");
        is_for.then(|| value.trim().trim_matches('"'))
    })
}

/// Parses the address of a node, with or without a port.
fn address_of(node: &str) -> Option<IpAddr> {
    if let Ok(address) = node.parse() {
        return Some(address);
    }
    if let Ok(address) = node.parse::<SocketAddr>() {
        return Some(address.ip());
    }
    node.strip_prefix('[')?.strip_suffix(']')?.parse().ok()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use axum::http::HeaderValue;
    use tokio::sync::watch;

    use super::*;

    fn proxies() -> TrustedProxies {
        let ranges = ["127.0.0.1", "10.0.0.0/8"];
        ranges
            .into_iter()
            .map(|range| range.parse().unwrap())
            .collect()
    }

    /// Returns the client of a request with these headers on a connection from `peer`.
    fn client(peer: &str, headers: &[(&'static str, &'static str)]) -> String {
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            map.append(*name, HeaderValue::from_static(value));
        }
        let peer = PeerAddress(Some(peer.parse().unwrap()));
        let instances = BTreeSet::from(["192.0.2.11".parse().unwrap()]);
        let instances = InstanceAddresses::watched(watch::channel(instances).1);
        let found = peer.behind(&map, &proxies(), &instances);
        found.0.unwrap().to_string()
    }

    #[test]
    fn an_instance_is_believed_of_what_it_passes_on_alone() {
        let said = ("x-forwarded-for", "203.0.113.9");
        let passed_on = [said, ("x-fleetcal-forwarded-by", "a")];
        assert_eq!(client("192.0.2.11", &passed_on), "203.0.113.9");
        // Somebody who works at that machine.
        assert_eq!(client("192.0.2.11", &[said]), "192.0.2.11");
        // Anybody can write the header.
        assert_eq!(client("192.0.2.12", &passed_on), "192.0.2.12");
        // Over the proxy before this instance, which adds whom it hears.
        let over_proxy = |hops| [("x-forwarded-for", hops), ("x-fleetcal-forwarded-by", "a")];
        let by_instance = over_proxy("203.0.113.9, 192.0.2.11");
        assert_eq!(client("10.0.0.7", &by_instance), "203.0.113.9");
        let by_other = over_proxy("203.0.113.9, 192.0.2.12");
        assert_eq!(client("10.0.0.7", &by_other), "192.0.2.12");
    }

    #[test]
    fn only_a_trusted_proxy_says_who_the_client_is() {
        let claimed = [("x-forwarded-for", "203.0.113.9")];
        assert_eq!(client("192.0.2.1", &claimed), "192.0.2.1");
        assert_eq!(client("127.0.0.1", &claimed), "203.0.113.9");
        assert_eq!(client("127.0.0.1", &[]), "127.0.0.1");
    }

    #[test]
    fn the_last_untrusted_hop_counts() {
        for (name, value, wanted) in [
            (
                "x-forwarded-for",
                "198.51.100.1, 203.0.113.9",
                "203.0.113.9",
            ),
            (
                "x-forwarded-for",
                "203.0.113.9, 10.0.0.7, 10.1.0.7",
                "203.0.113.9",
            ),
            ("x-forwarded-for", "10.0.0.8, 10.0.0.7", "10.0.0.8"),
            (
                "x-forwarded-for",
                "198.51.100.1, garbage, 10.0.0.7",
                "10.0.0.7",
            ),
            ("x-forwarded-for", "203.0.113.9:4711", "203.0.113.9"),
            ("x-forwarded-for", "2001:db8::1", "2001:db8::1"),
            ("forwarded", "for=203.0.113.9;proto=https", "203.0.113.9"),
            ("forwarded", "for=\"[2001:db8::1]:4711\"", "2001:db8::1"),
            (
                "forwarded",
                "for=198.51.100.1, For=203.0.113.9",
                "203.0.113.9",
            ),
            ("forwarded", "for=unknown", "127.0.0.1"),
            (
                "forwarded",
                "for=\"198.51.100.1, for=203.0.113.9",
                "203.0.113.9",
            ),
        ] {
            assert_eq!(
                client("127.0.0.1", &[(name, value)]),
                wanted,
                "{name}: {value}"
            );
        }
        let lines = [
            ("x-forwarded-for", "198.51.100.1"),
            ("x-forwarded-for", "203.0.113.9"),
        ];
        assert_eq!(client("127.0.0.1", &lines), "203.0.113.9");
    }

    #[test]
    fn two_headers_that_differ_name_nobody() {
        let both = |forwarded, listed| {
            client(
                "127.0.0.1",
                &[("forwarded", forwarded), ("x-forwarded-for", listed)],
            )
        };
        assert_eq!(both("for=203.0.113.9", "203.0.113.9"), "203.0.113.9");
        assert_eq!(both("for=198.51.100.1", "203.0.113.9"), "127.0.0.1");
    }

    #[test]
    fn a_network_of_ipv6_is_one_site() {
        let key = |text: &str| PeerAddress(Some(text.parse().unwrap())).key();
        assert_eq!(key("2001:db8:1:2:3::4"), "2001:db8:1:2::/64");
        assert_eq!(key("::ffff:192.0.2.1"), "192.0.2.1");
        assert_eq!(PeerAddress(None).key(), "unknown");
    }
}
