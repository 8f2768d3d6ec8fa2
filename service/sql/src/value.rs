//! Values that go into statements and come out of rows.

/// A value of one of the types that both databases have.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// A whole number.
    Integer(Option<i64>),
    /// A real number.
    Real(Option<f64>),
    /// A text.
    Text(Option<String>),
    /// Bytes.
    Bytes(Option<Vec<u8>>),
    /// A boolean; SQLite stores 1 or 0.
    Boolean(Option<bool>),
    /// Null, in a row whose driver knows no type for it.
    Null,
}

/// One row of an answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Row(pub Vec<Value>);

/// Error of a column that holds another type.
#[derive(Debug, thiserror::Error)]
#[error("column {index}: got {found:?}, expected {expected}")]
pub(crate) struct UnexpectedValue {
    index: usize,
    found: Option<Value>,
    expected: &'static str,
}

/// Type that a column can be read as.
pub(crate) trait FromValue: Sized {
    /// Name of the type in an error.
    const EXPECTED: &'static str;

    /// Converts the value to this type.
    fn from_value(value: Value) -> Result<Self, Value>;
}

impl Row {
    /// Returns the integer of a column; `None` without one.
    pub fn integer(&self, index: usize) -> Option<i64> {
        self.get(index).ok()
    }

    /// Returns the value of a column.
    pub(crate) fn get<T: FromValue>(&self, index: usize) -> Result<T, UnexpectedValue> {
        let unexpected = |found| UnexpectedValue {
            index,
            found,
            expected: T::EXPECTED,
        };
        let value = self.0.get(index).ok_or_else(|| unexpected(None))?;
        T::from_value(value.clone()).map_err(|value| unexpected(Some(value)))
    }
}

/// Implements reading a type from its variant, and `NULL` as its `None`.
macro_rules! read_from {
    ($type:ty, $expected:literal, $($pattern:pat => $read:expr),+) => {
        impl FromValue for $type {
            const EXPECTED: &'static str = $expected;

            fn from_value(value: Value) -> Result<Self, Value> {
                match value {
                    $($pattern => Ok($read),)+
                    other => Err(other),
                }
            }
        }
    };
}

read_from!(i64, "an integer", Value::Integer(Some(number)) => number);
read_from!(f64, "a real number", Value::Real(Some(number)) => number);
read_from!(String, "a text", Value::Text(Some(text)) => text);
read_from!(Vec<u8>, "bytes", Value::Bytes(Some(bytes)) => bytes);
read_from!(bool, "a boolean",
    Value::Boolean(Some(yes)) => yes,
    Value::Integer(Some(0)) => false,
    Value::Integer(Some(1)) => true);

impl FromValue for u32 {
    const EXPECTED: &'static str = "an integer of 32 bits that is not negative";

    fn from_value(value: Value) -> Result<Self, Value> {
        match value {
            Value::Integer(Some(number)) => Self::try_from(number).map_err(|_| value),
            other => Err(other),
        }
    }
}

impl<T: FromValue> FromValue for Option<T> {
    const EXPECTED: &'static str = T::EXPECTED;

    fn from_value(value: Value) -> Result<Self, Value> {
        match value {
            Value::Null
            | Value::Integer(None)
            | Value::Real(None)
            | Value::Text(None)
            | Value::Bytes(None)
            | Value::Boolean(None) => Ok(None),
            value => T::from_value(value).map(Some),
        }
    }
}

/// Implements making a value of a type, and of an option of it.
macro_rules! write_as {
    ($type:ty, $variant:ident, $convert:expr) => {
        impl From<$type> for Value {
            fn from(value: $type) -> Self {
                Self::$variant(Some($convert(value)))
            }
        }

        impl From<Option<$type>> for Value {
            fn from(value: Option<$type>) -> Self {
                Self::$variant(value.map($convert))
            }
        }
    };
}

write_as!(i64, Integer, std::convert::identity);
write_as!(u32, Integer, i64::from);
write_as!(f64, Real, std::convert::identity);
write_as!(bool, Boolean, std::convert::identity);
write_as!(String, Text, std::convert::identity);
write_as!(&str, Text, str::to_owned);
write_as!(&[u8], Bytes, <[u8]>::to_vec);

impl From<&String> for Value {
    fn from(text: &String) -> Self {
        Self::from(text.as_str())
    }
}

impl From<&Option<String>> for Value {
    fn from(text: &Option<String>) -> Self {
        Self::from(text.as_deref())
    }
}
