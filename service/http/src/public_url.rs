//! The address under which people know the service.

use serde::Deserialize;

/// Public address of the service: scheme, host and maybe port, such as
/// `https://fleetcal.example.com`. With https, a proxy before the service ends the encryption.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub struct PublicUrl(String);

impl PublicUrl {
    /// Returns the address without a trailing slash.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// Returns host and maybe port, without the scheme.
    pub fn authority(&self) -> &str {
        self.0
            .split_once("://")
            .map_or("", |(_, authority)| authority)
    }

    /// True if a request for `host` (and maybe port) is meant for it. The scheme's own port may be
    /// left out.
    pub fn is_for(&self, host: &str) -> bool {
        let port = if self.is_https() { ":443" } else { ":80" };
        let bare = |authority: &str| {
            let authority = authority.to_ascii_lowercase();
            authority
                .strip_suffix(port)
                .unwrap_or(&authority)
                .to_owned()
        };
        bare(host) == bare(self.authority())
    }

    /// True if browsers reach the service encrypted.
    pub fn is_https(&self) -> bool {
        self.0.starts_with("https://")
    }
}

impl TryFrom<String> for PublicUrl {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let host = text
            .strip_prefix("https://")
            .or_else(|| text.strip_prefix("http://"))
            .unwrap_or("");
        let accepted =
            |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || ".-:[]".contains(c);
        if !host.is_empty() && host.chars().all(accepted) {
            return Ok(Self(text));
        }
        Err(format!(
            "public_url: got {text:?}, expected scheme, host in lower case and port alone, such \
             as https://fleetcal.example.com"
        ))
    }
}

impl std::str::FromStr for PublicUrl {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::try_from(text.to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_what_browsers_call_an_origin() {
        for (text, https) in [
            ("https://fleetcal.example.com", true),
            ("http://192.0.2.7:8080", false),
            ("http://[2001:db8::1]:8080", false),
        ] {
            let url: PublicUrl = text.parse().unwrap();
            assert_eq!((url.as_str(), url.is_https()), (text, https));
        }
    }

    #[test]
    fn what_is_no_origin_is_refused() {
        for text in [
            "",
            "fleetcal.example.com",
            "ftp://fleetcal.example.com",
            "https://",
            "https://fleetcal.example.com/",
            "https://user@fleetcal.example.com",
            "https://Fleetcal.example.com",
        ] {
            let refused = text.parse::<PublicUrl>().unwrap_err();
            assert!(refused.contains("such as https://"), "{refused}");
        }
    }
}
