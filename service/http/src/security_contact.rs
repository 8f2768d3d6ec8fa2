//! The contacts for reports of vulnerabilities.

use serde::Deserialize;

use crate::PublicUrl;

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

/// Contacts of an installation, and its address.
#[derive(Debug, Clone, Default)]
pub struct SecurityContacts {
    /// The contacts, the preferred one first.
    pub contacts: Vec<SecurityContact>,
    /// Public address of the service.
    pub url: Option<PublicUrl>,
}

impl SecurityContacts {
    /// Returns the text of `security.txt` (RFC 9116), which counts until `expires`, RFC 3339; `None`
    /// without a contact.
    pub fn text(&self, expires: &str) -> Option<String> {
        if self.contacts.is_empty() {
            return None;
        }
        let contacts = self.contacts.iter();
        let mut lines: Vec<String> = contacts
            .map(|contact| format!("Contact: {}\n", contact.as_str()))
            .collect();
        lines.push(format!("Expires: {expires}\nPreferred-Languages: en\n"));
        let url = self.url.iter().filter(|url| url.is_https());
        lines.extend(
            url.map(|url| format!("Canonical: {}/.well-known/security.txt\n", url.as_str())),
        );
        Some(lines.concat())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn security_txt_has_the_lines_of_its_standard() {
        let contact = |text: &str| SecurityContact::try_from(text.to_owned()).unwrap();
        let contacts = ["mailto:a@example.com", "https://example.com/report"].map(contact);
        let of = |url: &str| SecurityContacts {
            contacts: contacts.to_vec(),
            url: PublicUrl::try_from(url.to_owned()).ok(),
        };
        let expires = "2027-01-01T00:00:00Z";
        let written = of("https://fleetcal.example.com").text(expires).unwrap();
        let expected = "Contact: mailto:a@example.com\nContact: https://example.com/report\n\
                        Expires: 2027-01-01T00:00:00Z\nPreferred-Languages: en\n\
                        Canonical: https://fleetcal.example.com/.well-known/security.txt\n";
        assert_eq!(written, expected);
        // A canonical address has to be https.
        let plain = of("http://192.0.2.7:8080").text(expires).unwrap();
        assert!(!plain.contains("Canonical"), "{plain}");
        assert_eq!(SecurityContacts::default().text(expires), None);
    }

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
