//! Address of another instance.

use std::fmt;

use serde::Deserialize;

/// Address of an instance: scheme, host and port if any, such as `https://b.example.com:8443`.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub struct PeerUrl(String);

impl PeerUrl {
    /// Text of the address, without a slash at its end.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// True if the connection is encrypted, and authenticated by a certificate.
    pub fn is_https(&self) -> bool {
        self.0.starts_with("https://")
    }

    /// Host, and port if any.
    pub fn authority(&self) -> &str {
        let parts = self.0.split_once("://");
        parts.map_or("", |(_, authority)| authority)
    }

    /// Host and port, by default the scheme's.
    pub(super) fn host_and_port(&self) -> (&str, u16) {
        let port = if self.is_https() { 443 } else { 80 };
        let authority = self.authority();
        let (host, port) = match split_port(authority) {
            Some((host, named)) => (host, named.parse().unwrap_or(port)),
            None => (authority, port),
        };
        (host.trim_matches(['[', ']']), port)
    }
}

/// Splits off the port of an authority; the colons of a literal IPv6 address are in brackets.
fn split_port(authority: &str) -> Option<(&str, &str)> {
    let (host, port) = authority.rsplit_once(':')?;
    (!port.ends_with(']')).then_some((host, port))
}

fn is_of_name(c: char) -> bool {
    c.is_ascii_lowercase() || c.is_ascii_digit() || matches!(c, '.' | '-')
}

/// True if a text is a valid host, with a port if any.
fn is_authority(authority: &str) -> bool {
    let (host, port) = match split_port(authority) {
        Some((host, port)) => (host, Some(port)),
        None => (authority, None),
    };
    let literal = host
        .strip_prefix('[')
        .and_then(|rest| rest.strip_suffix(']'));
    let is_host = match literal {
        Some(literal) => literal.parse::<std::net::Ipv6Addr>().is_ok(),
        None => !host.is_empty() && host.chars().all(is_of_name),
    };
    is_host && port.is_none_or(|port| port.parse::<u16>().is_ok_and(|port| port > 0))
}

impl TryFrom<String> for PeerUrl {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let authority = ["https://", "http://"]
            .iter()
            .find_map(|scheme| text.strip_prefix(scheme));
        if authority.is_some_and(is_authority) {
            return Ok(Self(text));
        }
        Err(format!(
            "cluster: got {text:?}, expected scheme, host in lower case and port alone, such as \
             https://b.example.com:8443"
        ))
    }
}

impl std::str::FromStr for PeerUrl {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::try_from(text.to_owned())
    }
}

impl fmt::Display for PeerUrl {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn host_and_port_are_those_of_the_text() {
        for (text, authority, host, port) in [
            (
                "https://b.example.com",
                "b.example.com",
                "b.example.com",
                443,
            ),
            ("http://b:8080", "b:8080", "b", 8080),
            ("http://192.0.2.7", "192.0.2.7", "192.0.2.7", 80),
            (
                "https://[2001:db8::1]:8443",
                "[2001:db8::1]:8443",
                "2001:db8::1",
                8443,
            ),
            ("https://[2001:db8::1]", "[2001:db8::1]", "2001:db8::1", 443),
        ] {
            let url: PeerUrl = text.parse().unwrap();
            assert_eq!(url.authority(), authority);
            assert_eq!(url.host_and_port(), (host, port));
            assert_eq!(url.is_https(), text.starts_with("https"));
        }
    }

    #[test]
    fn what_is_more_or_less_than_an_address_is_refused() {
        for text in [
            "",
            "b.example.com",
            "ftp://b.example.com",
            "https://",
            "https://b.example.com/",
            "https://user@b.example.com",
            "https://b.example.com:0",
            "https://b.example.com:70000",
            "https://b.example.com?x",
            "https://[b]",
            "https://B.example.com",
        ] {
            let refused = text.parse::<PeerUrl>().unwrap_err();
            assert!(refused.contains("such as https://"), "{refused}");
        }
    }
}
