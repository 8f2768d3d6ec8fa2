//! A value of a description, or the reason for which it cannot be derived.

use thiserror::Error;

/// A value and the parts of the description that it comes from.
#[derive(Debug, Clone, PartialEq)]
pub struct Derived<T> {
    /// The value.
    pub value: T,
    /// Joints, links or frames, in words.
    pub source: String,
}

impl<T> Derived<T> {
    pub(crate) fn new(value: T, source: impl Into<String>) -> Self {
        let source = source.into();
        Self { value, source }
    }
}

/// Reason for which one value cannot be derived from a description.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{field}: got {found}, expected {expected}")]
pub struct Underivable {
    /// Name of the value.
    pub field: &'static str,
    /// Content of the description in its place, with names of joints or links.
    pub found: String,
    /// Content that it would be derived from.
    pub expected: &'static str,
}

impl Underivable {
    /// Makes a reason.
    pub(crate) fn new(
        field: &'static str,
        found: impl Into<String>,
        expected: &'static str,
    ) -> Self {
        Self {
            field,
            found: found.into(),
            expected,
        }
    }

    /// The same reason for another value that depends on this one.
    pub(crate) fn of(&self, field: &'static str) -> Self {
        Self {
            field,
            ..self.clone()
        }
    }
}
