//! Fields whose JSON form is not what serde would derive.

use std::fmt;
use std::marker::PhantomData;
use std::sync::Arc;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::de::{Error, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serializer};

use crate::cdr::STRINGS_MAX;

/// Serializes beams; a number that JSON cannot represent becomes `null`.
pub(super) fn beams<S: Serializer>(values: &Arc<[f32]>, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(values.iter())
}

/// Reads ranges; `null` is a missing return, which is infinite (ROS REP 117).
pub(super) fn ranges<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Arc<[f32]>, D::Error> {
    deserializer.deserialize_seq(Beams {
        null_is: f32::INFINITY,
    })
}

/// Reads intensities; `null` is not a number.
pub(super) fn intensities<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Arc<[f32]>, D::Error> {
    deserializer.deserialize_seq(Beams { null_is: f32::NAN })
}

pub(super) fn no_beams() -> Arc<[f32]> {
    Arc::from([])
}

struct Beams {
    null_is: f32,
}

impl<'de> Visitor<'de> for Beams {
    type Value = Arc<[f32]>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an array of numbers or null")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut beams: A) -> Result<Self::Value, A::Error> {
        let mut values = Vec::new();
        while let Some(value) = beams.next_element::<Option<f32>>()? {
            values.push(value.unwrap_or(self.null_is));
        }
        Ok(values.into())
    }
}

/// Serializes an array that is longer than serde's own.
pub(super) fn long_array<S: Serializer, const N: usize>(
    values: &[f64; N],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(values.iter())
}

/// Reads an array that is longer than serde's own; its length must be exact.
pub(super) fn long_array_of<'de, D: Deserializer<'de>, const N: usize>(
    deserializer: D,
) -> Result<[f64; N], D::Error> {
    deserializer.deserialize_seq(LongArray::<N>(PhantomData))
}

struct LongArray<const N: usize>(PhantomData<[f64; N]>);

impl<'de, const N: usize> Visitor<'de> for LongArray<N> {
    type Value = [f64; N];

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "an array of {N} numbers")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Self::Value, A::Error> {
        let mut values = [0.0; N];
        for (index, value) in values.iter_mut().enumerate() {
            let item = items.next_element()?;
            *value = item.ok_or_else(|| A::Error::invalid_length(index, &self))?;
        }
        match items.next_element::<f64>()? {
            None => Ok(values),
            Some(_) => Err(A::Error::invalid_length(N + 1, &self)),
        }
    }
}

/// Reads at most [`STRINGS_MAX`] strings.
pub(super) fn names<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<String>, D::Error> {
    deserializer.deserialize_seq(AtMost::<String, STRINGS_MAX>(PhantomData))
}

/// Reads at most `N` elements of an array.
pub(super) fn at_most<'de, T: Deserialize<'de>, const N: usize, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Vec<T>, D::Error> {
    deserializer.deserialize_seq(AtMost::<T, N>(PhantomData))
}

struct AtMost<T, const N: usize>(PhantomData<T>);

impl<'de, T: Deserialize<'de>, const N: usize> Visitor<'de> for AtMost<T, N> {
    type Value = Vec<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "an array of at most {N} elements")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Self::Value, A::Error> {
        let mut elements = Vec::new();
        while let Some(element) = items.next_element()? {
            if elements.len() == N {
                return Err(A::Error::invalid_length(N + 1, &self));
            }
            elements.push(element);
        }
        Ok(elements)
    }
}

/// Writes bytes as base64, as ROS's JSON bridges do.
pub(super) fn base64<S: Serializer>(bytes: &Arc<[u8]>, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&STANDARD.encode(bytes))
}

/// Reads bytes from base64 or from an array of numbers.
pub(super) fn bytes<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Arc<[u8]>, D::Error> {
    deserializer.deserialize_any(Bytes)
}

struct Bytes;

impl<'de> Visitor<'de> for Bytes {
    type Value = Arc<[u8]>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("bytes as a string in base64 or an array of numbers")
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Self::Value, E> {
        match STANDARD.decode(text) {
            Ok(bytes) => Ok(bytes.into()),
            Err(error) => Err(E::custom(format!("no base64: {error}"))),
        }
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Self::Value, A::Error> {
        let mut bytes = Vec::new();
        while let Some(byte) = items.next_element()? {
            bytes.push(byte);
        }
        Ok(bytes.into())
    }
}
