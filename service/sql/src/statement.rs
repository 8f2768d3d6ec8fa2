//! A statement with its values. Values are numbered `$1`, `$2` and so on, as both databases have it.

use std::borrow::Cow;

use crate::value::Value;

/// A statement and its values.
#[derive(Debug, Clone, PartialEq)]
pub struct Statement {
    /// Its text, made of words of this program alone, never of outside input.
    pub sql: Cow<'static, str>,
    /// Values of `$1` and so on.
    pub values: Vec<Value>,
}
