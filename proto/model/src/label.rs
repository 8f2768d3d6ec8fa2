//! Labels by which people group robots: a site, a type of vehicle, a tag.

use std::fmt;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Characters of a label.
pub const LABEL_CHARS_MAX: usize = 64;
/// Tags of one robot.
pub const TAGS_MAX: usize = 16;

/// Reason for which a label or a list of tags was refused.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum LabelRefused {
    /// Text that is no label.
    #[error(
        "got {0:?}, expected 1 to {LABEL_CHARS_MAX} characters without control characters and \
         without spaces around them"
    )]
    Text(String),
    /// More tags than a robot may have.
    #[error("got {0} tags, expected at most {TAGS_MAX}")]
    Count(usize),
}

/// Name of a site, of a type of vehicle, or a tag. Labels that differ in upper and lower case alone
/// name the same.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Label(String);

impl Label {
    /// Parses a label.
    ///
    /// # Errors
    /// [`LabelRefused::Text`] with what is accepted.
    pub fn parse(text: &str) -> Result<Self, LabelRefused> {
        let chars = text.chars().count();
        let fits = (1..=LABEL_CHARS_MAX).contains(&chars);
        if fits && text.trim() == text && !text.chars().any(char::is_control) {
            Ok(Self(text.to_owned()))
        } else {
            let shown = text.chars().take(LABEL_CHARS_MAX).collect();
            Err(LabelRefused::Text(shown))
        }
    }

    /// The label.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// The label in lower case, by which labels are compared and sorted.
    pub fn folded(&self) -> String {
        self.0.to_lowercase()
    }
}

impl fmt::Display for Label {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl TryFrom<String> for Label {
    type Error = LabelRefused;

    fn try_from(text: String) -> Result<Self, LabelRefused> {
        Self::parse(&text)
    }
}

impl From<Label> for String {
    fn from(label: Label) -> Self {
        label.0
    }
}

/// Tags of a robot: each once, in the order of the alphabet.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(try_from = "Vec<Label>", into = "Vec<Label>")]
pub struct Tags(Vec<Label>);

impl Tags {
    /// The tags.
    pub fn as_slice(&self) -> &[Label] {
        &self.0
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl TryFrom<Vec<Label>> for Tags {
    type Error = LabelRefused;

    fn try_from(mut tags: Vec<Label>) -> Result<Self, LabelRefused> {
        tags.sort_by_cached_key(Label::folded);
        tags.dedup_by_key(|tag| tag.folded());
        match tags.len() {
            0..=TAGS_MAX => Ok(Self(tags)),
            count => Err(LabelRefused::Count(count)),
        }
    }
}

impl From<Tags> for Vec<Label> {
    fn from(tags: Tags) -> Self {
        tags.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_is_text_that_a_person_can_type() {
        for text in ["Hamburg", "Halle 3", "EKX 516/k", "北", &"x".repeat(64)] {
            assert_eq!(Label::parse(text).unwrap().as_str(), text);
        }
        for text in ["", " ", " a", "a ", "a\tb", "a\nb", &"x".repeat(65)] {
            let refused = Label::parse(text).unwrap_err().to_string();
            assert!(refused.contains("expected 1 to 64 characters"), "{refused}");
        }
    }

    #[test]
    fn tags_are_each_there_once_and_few() {
        let read = |text: &str| serde_json::from_str::<Tags>(text);
        let tags = read(r#"["night", "Leased", "NIGHT", "gate 4"]"#).unwrap();
        let written = serde_json::to_string(&tags).unwrap();
        assert_eq!(written, r#"["gate 4","Leased","night"]"#);
        let many: Vec<String> = (0..17).map(|number| format!("tag {number}")).collect();
        let refused = read(&serde_json::to_string(&many).unwrap()).unwrap_err();
        assert_eq!(refused.to_string(), "got 17 tags, expected at most 16");
        assert!(read(&serde_json::to_string(&many[..16]).unwrap()).is_ok());
    }
}
