//! The contacts for reports of vulnerabilities.

use serde::Deserialize;

/// Longest address of a contact, bytes.
const CONTACT_BYTES_MAX: usize = 256;

/// Address for reports of vulnerabilities, a URI as RFC 9116 asks for: `mailto:`, `https:` or
/// `tel:`.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub struct SecurityContact(String);

impl SecurityContact {
    /// Returns the URI.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl TryFrom<String> for SecurityContact {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let rest = ["mailto:", "https://", "tel:"]
            .iter()
            .find_map(|scheme| text.strip_prefix(scheme));
        let is_line = text.len() <= CONTACT_BYTES_MAX && text.bytes().all(|c| c.is_ascii_graphic());
        if rest.is_some_and(|rest| !rest.is_empty()) && is_line {
            return Ok(Self(text));
        }
        Err(format!(
            "security_contacts: got {text:?}, expected addresses such as \
             mailto:security@example.com or https://example.com/report"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_contact_is_one_uri_without_spaces_or_lines() {
        for good in ["mailto:a@example.com", "https://example.com/x", "tel:+49-1"] {
            let contact = SecurityContact::try_from(good.to_owned()).unwrap();
            assert_eq!(contact.as_str(), good);
        }
        let long = format!("mailto:{}@example.com", "a".repeat(CONTACT_BYTES_MAX));
        for bad in [
            "",
            "mailto:",
            "a@example.com",
            "http://example.com",
            "mailto:a@example.com\nExpires: never",
            "mailto:a b",
            &long,
        ] {
            let refused = SecurityContact::try_from(bad.to_owned()).unwrap_err();
            assert!(refused.contains("mailto:security@example.com"), "{refused}");
        }
    }
}
