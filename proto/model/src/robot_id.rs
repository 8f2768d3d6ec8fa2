//! A robot's id: one chunk of a key expression, in a type that can't hold anything else.

use std::borrow::Borrow;
use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Longest id, in bytes.
pub const ROBOT_ID_BYTES_MAX: usize = 63;

/// A robot's id: `[A-Za-z0-9][A-Za-z0-9_-]{0,62}`. Cheap to clone.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[cfg_attr(
    feature = "openapi",
    schema(value_type = String, pattern = "^[A-Za-z0-9][A-Za-z0-9_-]{0,62}$", examples("tugger_01"))
)]
pub struct RobotId(Arc<str>);

/// Reason for which a text is not a robot id.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum RobotIdRefused {
    /// The text is empty.
    #[error("robot id: got nothing, expected 1 to 63 of A-Z, a-z, 0-9, _ and -")]
    Empty,
    /// The text is longer than [`ROBOT_ID_BYTES_MAX`].
    #[error("robot id: got {shown:?}… of {length} bytes, expected at most 63")]
    TooLong {
        /// The id's first characters.
        shown: String,
        /// Its length in bytes.
        length: usize,
    },
    /// The text begins with `_` or `-`, which could be taken for a flag or a hidden name.
    #[error("robot id {id:?} begins with {first:?}, expected a letter or digit first")]
    FirstCharacter {
        /// The id.
        id: String,
        /// Its first character.
        first: char,
    },
    /// A character would have a meaning in a key expression or path, or is not ASCII.
    #[error("robot id {id:?} contains {character:?}, expected A-Z, a-z, 0-9, _ and -")]
    Character {
        /// The id.
        id: String,
        /// The first character that is not accepted.
        character: char,
    },
}

impl RobotId {
    /// Checks a text and makes it an id.
    ///
    /// # Errors
    /// One sentence that names the fault and the accepted form.
    pub fn parse(text: &str) -> Result<Self, RobotIdRefused> {
        if text.len() > ROBOT_ID_BYTES_MAX {
            let shown = text.chars().take(16).collect();
            return Err(RobotIdRefused::TooLong {
                shown,
                length: text.len(),
            });
        }
        let first = text.chars().next().ok_or(RobotIdRefused::Empty)?;
        let accepted = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
        if let Some(character) = text.chars().find(|&c| !accepted(c)) {
            return Err(RobotIdRefused::Character {
                id: text.to_owned(),
                character,
            });
        }
        if !first.is_ascii_alphanumeric() {
            return Err(RobotIdRefused::FirstCharacter {
                id: text.to_owned(),
                first,
            });
        }
        Ok(Self(Arc::from(text)))
    }

    /// Returns the id as text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for RobotId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.0)
    }
}

impl FromStr for RobotId {
    type Err = RobotIdRefused;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::parse(text)
    }
}

impl TryFrom<String> for RobotId {
    type Error = RobotIdRefused;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        Self::parse(&text)
    }
}

impl From<RobotId> for String {
    fn from(id: RobotId) -> Self {
        id.as_str().to_owned()
    }
}

// Lets a map keyed by `RobotId` be asked with a chunk of a key, without making an id of it.
impl Borrow<str> for RobotId {
    fn borrow(&self) -> &str {
        &self.0
    }
}

impl AsRef<str> for RobotId {
    fn as_ref(&self) -> &str {
        &self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ordinary_ids_pass() {
        for text in ["tugger_01", "a", "0", "AGV-7", &"x".repeat(63)] {
            assert_eq!(RobotId::parse(text).unwrap().as_str(), text);
        }
    }

    #[test]
    fn each_refusal_says_what_is_wrong() {
        let cases = [
            ("", "robot id: got nothing"),
            ("a*b", "contains '*'"),
            ("a/b", "contains '/'"),
            ("$*", "contains '$'"),
            ("@alive", "contains '@'"),
            ("rüttler", "contains 'ü'"),
            ("a b", "contains ' '"),
            ("a\0", "contains '\\0'"),
            ("-rf", "begins with '-'"),
            ("_x", "begins with '_'"),
        ];
        for (text, wanted) in cases {
            let sentence = RobotId::parse(text).unwrap_err().to_string();
            assert!(sentence.contains(wanted), "{text:?} gave {sentence:?}");
            assert!(sentence.contains("expected"), "{text:?} gave {sentence:?}");
        }
        let long = RobotId::parse(&"ü".repeat(40)).unwrap_err().to_string();
        assert!(long.contains("80 bytes, expected"), "{long}");
    }

    #[test]
    fn json_goes_through_the_parser() {
        let id: RobotId = serde_json::from_str("\"tugger_01\"").unwrap();
        assert_eq!(serde_json::to_string(&id).unwrap(), "\"tugger_01\"");
        let error = serde_json::from_str::<RobotId>("\"a/b\"")
            .unwrap_err()
            .to_string();
        assert!(error.contains("contains '/'"), "{error}");
    }
}
