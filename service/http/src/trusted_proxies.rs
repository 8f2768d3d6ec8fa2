//! The proxies before the service whose word about a client's address counts.

use std::net::IpAddr;

use serde::Deserialize;

/// Addresses and networks of trusted proxies. Client addresses that anybody else forwards are
/// ignored.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
#[serde(transparent)]
pub struct TrustedProxies(Vec<AddressRange>);

impl TrustedProxies {
    /// True if one of them has this address.
    pub fn contain(&self, address: IpAddr) -> bool {
        self.0.iter().any(|range| range.contains(address))
    }
}

impl FromIterator<AddressRange> for TrustedProxies {
    fn from_iter<I: IntoIterator<Item = AddressRange>>(ranges: I) -> Self {
        Self(ranges.into_iter().collect())
    }
}

/// One address, or a network in CIDR notation (RFC 4632, RFC 4291).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub struct AddressRange {
    network: IpAddr,
    prefix_bits: u32,
}

impl AddressRange {
    /// True if the address is in it. An IPv4 address that is mapped into IPv6 counts as the IPv4
    /// address.
    pub fn contains(&self, address: IpAddr) -> bool {
        let (network, bits) = bits_of(self.network);
        let (address, of_address) = bits_of(address.to_canonical());
        let differing = network ^ address;
        // A shift by all 128 bits is none in Rust; a prefix of 0 contains everything.
        bits == of_address && differing.checked_shr(bits - self.prefix_bits).unwrap_or(0) == 0
    }
}

/// Returns an address as a number, and its number of bits.
fn bits_of(address: IpAddr) -> (u128, u32) {
    match address {
        IpAddr::V4(address) => (address.to_bits().into(), 32),
        IpAddr::V6(address) => (address.to_bits(), 128),
    }
}

impl TryFrom<String> for AddressRange {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl std::str::FromStr for AddressRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (address, prefix) = match text.split_once('/') {
            None => (text, None),
            Some((address, prefix)) => (address, Some(prefix)),
        };
        let network: Option<IpAddr> = address.parse().ok();
        let range = network.and_then(|network| {
            let (_, bits) = bits_of(network);
            let prefix_bits = match prefix {
                None => bits,
                Some(prefix) => prefix.parse().ok().filter(|prefix| *prefix <= bits)?,
            };
            Some(Self {
                network,
                prefix_bits,
            })
        });
        range.ok_or_else(|| {
            format!(
                "trusted_proxies: got {text:?}, expected an address or a network, such as \
                 192.0.2.7 or 10.0.0.0/8"
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn range(text: &str) -> AddressRange {
        text.parse().unwrap()
    }

    fn address(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    #[test]
    fn a_network_contains_its_addresses_and_no_others() {
        for (network, inside, outside) in [
            ("192.0.2.7", "192.0.2.7", "192.0.2.8"),
            ("10.0.0.0/8", "10.255.0.1", "11.0.0.1"),
            ("10.1.2.3/31", "10.1.2.2", "10.1.2.4"),
            ("10.0.0.0/8", "::ffff:10.0.0.1", "::10.0.0.1"),
            ("0.0.0.0/0", "203.0.113.9", "2001:db8::1"),
            ("2001:db8::/32", "2001:db8:ffff::1", "2001:db9::1"),
            ("::/0", "2001:db8::1", "10.0.0.1"),
            ("::1", "::1", "::2"),
        ] {
            let network = range(network);
            assert!(network.contains(address(inside)), "{network:?} {inside}");
            assert!(!network.contains(address(outside)), "{network:?} {outside}");
        }
    }

    #[test]
    fn what_is_no_network_is_refused() {
        for text in [
            "",
            "proxy",
            "10.0.0.0/33",
            "10.0.0.0/",
            "::1/129",
            "10.0.0/8",
            "1.2.3.4/-1",
        ] {
            let refused = text.parse::<AddressRange>().unwrap_err();
            assert!(
                refused.contains(&format!("got {text:?}, expected")),
                "{refused}"
            );
        }
    }
}
