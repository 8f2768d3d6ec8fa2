//! Names of users and tokens.

use serde::{Serialize, Serializer};
use thiserror::Error;

use crate::limits;

/// Name of the service in the audit; users and tokens cannot have it.
const OWN_NAME: &str = "fleetcal";

/// Reason for which a name was refused.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "name: got {shown:?}, expected 1 to {} letters, digits, spaces, and . _ - @ + in between, \
     and not \"{OWN_NAME}\"",
    limits::ACCOUNT_NAME_CHARS_MAX
)]
pub struct NameRefused {
    shown: String,
}

/// The name of a user or a token, as the audit shows it.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct AccountName(String);

impl AccountName {
    /// Parses a name.
    ///
    /// # Errors
    /// [`NameRefused`] with what is accepted.
    pub fn parse(text: &str) -> Result<Self, NameRefused> {
        let chars = text.chars().count();
        let ends_well = text.chars().next().is_some_and(char::is_alphanumeric)
            && !text.ends_with(char::is_whitespace);
        let accepted = |c: char| c.is_alphanumeric() || " ._-@+".contains(c);
        if chars <= limits::ACCOUNT_NAME_CHARS_MAX
            && ends_well
            && text.chars().all(accepted)
            && !text.eq_ignore_ascii_case(OWN_NAME)
        {
            Ok(Self(text.to_owned()))
        } else {
            let shown = text.chars().take(limits::ACCOUNT_NAME_CHARS_MAX).collect();
            Err(NameRefused { shown })
        }
    }

    /// The name.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl std::fmt::Display for AccountName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl Serialize for AccountName {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_people_and_tools_are_accepted() {
        for name in [
            "ann",
            "Ann Smith",
            "ann.smith@example.com",
            "CI-2",
            "Zoë",
            "7",
        ] {
            assert_eq!(AccountName::parse(name).unwrap().as_str(), name);
        }
    }

    #[test]
    fn what_could_be_mistaken_is_refused() {
        let long = "x".repeat(limits::ACCOUNT_NAME_CHARS_MAX + 1);
        for name in [
            "",
            " ann",
            "ann ",
            "a\nb",
            "a\u{202e}b",
            "-a",
            "Fleetcal",
            "a/b",
            &long,
        ] {
            let refused = AccountName::parse(name).unwrap_err().to_string();
            assert!(refused.contains("expected 1 to 64"), "{refused}");
        }
    }
}
