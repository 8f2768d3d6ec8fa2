//! A checkpoint as bytes: the number of its format, then its content, compressed.
//!
//! The content is JSON, with every fraction taken out of the text and put behind it in binary. A
//! checkpoint is some thousand fractions of which every bit counts; as digits they would make it a
//! fifth larger, compressed or not. Bytes of one significance stand together: signs and exponents are
//! much alike, and the last bytes of numbers in single precision are zero. What follows the exponents
//! does not compress otherwise, and is in a frame of its own, since one frame has one code for all.

use std::cell::RefCell;

use fleetcal_domain::limits::CHECKPOINT_BYTES_MAX;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use thiserror::Error;
use zstd::bulk::Compressor;

/// Format that is written, as the first byte.
pub const FORMAT: u8 = 4;
/// Newest format that is read. A version that introduces a format reads it but writes the former
/// one, and the next version writes it: so robots continue from their states when instances are
/// downgraded by one version.
pub const FORMAT_READ_MAX: u8 = FORMAT;
/// Former format: each fraction by itself. Format 1 was JSON text without a number.
const FORMAT_BEFORE: u8 = 2;
/// First byte of checkpoints of format 1: no later format may have its number.
const TEXT: u8 = b'{';
/// Compression level. Each instance of a cluster stores each robot's state every 5 to 10 s; level 7
/// makes 1.5 % less for half as much CPU again.
const LEVEL: i32 = 3;
/// Bytes of a fraction that hold its sign and exponent.
const EXPONENT_BYTES: usize = 2;

/// Reason for which bytes are not a readable checkpoint.
#[derive(Debug, Error)]
pub enum Unreadable {
    /// There are no bytes.
    #[error("checkpoint: got no bytes, expected the number of its format")]
    Empty,
    /// The format belongs to another version.
    #[error("checkpoint: got format {0}, expected format {FORMAT}, {FORMAT_BEFORE} or JSON text")]
    Format(u8),
    /// The bytes are damaged.
    #[error(
        "checkpoint: got bytes that cannot be decompressed ({0}), expected zstd of {CHECKPOINT_BYTES_MAX} bytes at most"
    )]
    Compression(String),
    /// Text and fractions do not match.
    #[error("checkpoint: got {got} bytes of fractions, expected {expected}")]
    Fractions {
        /// Bytes behind the text.
        got: usize,
        /// Bytes of the fractions that are missing in the text.
        expected: usize,
    },
    /// The content has another structure.
    #[error("checkpoint: {0}, expected what this version writes")]
    Content(#[from] serde_json::Error),
}

/// Packs a state into bytes.
///
/// # Errors
/// The state cannot be written as JSON or compressed.
pub fn pack(state: &impl Serialize) -> Result<Vec<u8>, Unreadable> {
    let mut content = serde_json::to_value(state)?;
    let mut fractions = Vec::new();
    each_fraction(&mut content, &mut |value, fraction| {
        fractions.push(fraction.to_be_bytes());
        *value = Value::from(0.0);
    });
    let text = serde_json::to_vec(&content)?;
    let mut head = (text.len() as u64).to_le_bytes().to_vec();
    head.extend(text);
    let (exponents, rest): (Vec<u8>, Vec<u8>) = {
        let of = |byte: usize| fractions.iter().map(move |bytes| bytes[byte]);
        let all = size_of::<f64>();
        (
            (0..EXPONENT_BYTES).flat_map(of).collect(),
            (EXPONENT_BYTES..all).flat_map(of).collect(),
        )
    };
    head.extend(exponents);
    let mut bytes = vec![FORMAT];
    for frame in [head, rest] {
        let frame = compressed(&frame);
        bytes.extend(frame.map_err(|error| Unreadable::Compression(error.to_string()))?);
    }
    Ok(bytes)
}

/// Unpacks a state, equal to the bit.
///
/// # Errors
/// The bytes have an unknown format, are damaged, or hold another state.
pub fn unpack<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Unreadable> {
    match bytes.split_first() {
        None => Err(Unreadable::Empty),
        Some((&TEXT, _)) => Ok(serde_json::from_slice(bytes)?),
        Some((&FORMAT, compressed)) => unpack_content(compressed, by_significance),
        Some((&FORMAT_BEFORE, compressed)) => unpack_content(compressed, one_by_one),
        Some((&format, _)) => Err(Unreadable::Format(format)),
    }
}

thread_local! {
    /// Compressor of this thread, kept because its tables would be freed and allocated again for
    /// each frame.
    static COMPRESSOR: RefCell<Option<Compressor<'static>>> = const { RefCell::new(None) };
}

fn compressed(packed: &[u8]) -> std::io::Result<Vec<u8>> {
    COMPRESSOR.with_borrow_mut(|kept| match kept {
        Some(compressor) => compressor.compress(packed),
        None => kept.insert(compressor()?).compress(packed),
    })
}

fn compressor() -> std::io::Result<Compressor<'static>> {
    let mut compressor = Compressor::new(LEVEL)?;
    compressor.include_checksum(true)?;
    Ok(compressor)
}

fn unpack_content<T: DeserializeOwned>(
    compressed: &[u8],
    fractions_of: fn(&[u8]) -> Vec<f64>,
) -> Result<T, Unreadable> {
    let packed = zstd::bulk::decompress(compressed, CHECKPOINT_BYTES_MAX)
        .map_err(|error| Unreadable::Compression(error.to_string()))?;
    let short = || Unreadable::Compression("the text is cut".to_owned());
    let (length, rest) = packed.split_first_chunk::<8>().ok_or_else(short)?;
    let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
    let (text, fractions) = rest.split_at_checked(length).ok_or_else(short)?;
    let mut content: Value = serde_json::from_slice(text)?;
    let mut next = fractions_of(fractions).into_iter();
    let mut expected = 0;
    each_fraction(&mut content, &mut |value, _| {
        expected += size_of::<f64>();
        *value = next.next().map_or(Value::Null, Value::from);
    });
    if fractions.len() != expected {
        return Err(Unreadable::Fractions {
            got: fractions.len(),
            expected,
        });
    }
    Ok(serde_json::from_value(content)?)
}

/// Reads fractions whose bytes are grouped by significance, the greatest first.
fn by_significance(bytes: &[u8]) -> Vec<f64> {
    let count = bytes.len() / size_of::<f64>();
    let fraction = |i| f64::from_be_bytes(std::array::from_fn(|byte| bytes[byte * count + i]));
    (0..count).map(fraction).collect()
}

/// Reads fractions one after the other, as in format 2.
fn one_by_one(bytes: &[u8]) -> Vec<f64> {
    let (whole, _) = bytes.as_chunks::<8>();
    whole
        .iter()
        .map(|bytes| f64::from_le_bytes(*bytes))
        .collect()
}

/// Visits the fractions of a tree, the fields of an object by name.
fn each_fraction(tree: &mut Value, visit: &mut impl FnMut(&mut Value, f64)) {
    match tree {
        Value::Number(number) => {
            let fraction = number.as_f64().filter(|_| number.is_f64());
            if let Some(fraction) = fraction {
                visit(tree, fraction);
            }
        }
        Value::Array(items) => {
            for item in items {
                each_fraction(item, visit);
            }
        }
        Value::Object(fields) => {
            let mut fields: Vec<_> = fields.iter_mut().collect();
            fields.sort_unstable_by(|one, other| one.0.cmp(other.0));
            for (_, field) in fields {
                each_fraction(field, visit);
            }
        }
        Value::Null | Value::Bool(_) | Value::String(_) => {}
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// State with every kind of value that a state may hold.
    #[derive(Debug, PartialEq, serde::Deserialize, Serialize)]
    struct State {
        z: Vec<f64>,
        name: Option<String>,
        a: (i64, f64, u64),
        narrow: f32,
    }

    fn state(fractions: Vec<f64>, narrow: f32) -> State {
        State {
            z: fractions,
            name: Some("0.5 \u{e4}".to_owned()),
            a: (i64::MIN, 0.1, u64::MAX),
            narrow,
        }
    }

    fn refusal(bytes: &[u8]) -> String {
        unpack::<State>(bytes).unwrap_err().to_string()
    }

    proptest! {
        #[test]
        fn what_is_packed_comes_back_to_the_bit(
            bits in prop::collection::vec(any::<u64>(), 0..40),
            narrow in prop::num::f32::NORMAL,
        ) {
            let finite = bits.into_iter().map(f64::from_bits).filter(|one| one.is_finite());
            let mut fractions = vec![0.0, -0.0, 1.0, 1e300, f64::MIN_POSITIVE / 8.0];
            fractions.extend(finite);
            let packed = state(fractions, narrow);
            let unpacked: State = unpack(&pack(&packed).unwrap()).unwrap();
            let bits = |state: &State| state.z.iter().map(|one| one.to_bits()).collect::<Vec<_>>();
            prop_assert_eq!(bits(&unpacked), bits(&packed));
            prop_assert_eq!(unpacked, packed);
        }

        #[test]
        fn damaged_bytes_are_refused(
            at in any::<prop::sample::Index>(),
            bit in 0..8_u32,
            cut in any::<prop::sample::Index>(),
        ) {
            let bytes = pack(&state(vec![0.1; 20], 0.5)).unwrap();
            let mut turned = bytes.clone();
            turned[at.index(bytes.len())] ^= 1 << bit;
            // One bit of the header is there to be passed over.
            let read = unpack::<State>(&turned).ok();
            prop_assert!(read.is_none_or(|read| read == state(vec![0.1; 20], 0.5)));
            prop_assert!(unpack::<State>(&bytes[..cut.index(bytes.len())]).is_err());
        }

        #[test]
        fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            prop_assert!(unpack::<State>(&bytes).is_err());
        }
    }

    #[test]
    fn a_refusal_names_what_it_got() {
        assert_eq!(
            refusal(&[]),
            "checkpoint: got no bytes, expected the number of its format"
        );
        assert_eq!(
            refusal(&[5, 1, 2]),
            "checkpoint: got format 5, expected format 4, 2 or JSON text"
        );
        let garbage = refusal(&[FORMAT, 1, 2, 3]);
        assert!(
            garbage.starts_with("checkpoint: got bytes that cannot be decompressed ("),
            "{garbage}"
        );
        let text = refusal(b"{\"z\": 1}");
        assert!(text.contains("invalid type: integer `1`"), "{text}");
    }

    #[test]
    fn bytes_that_would_fill_the_memory_are_refused() {
        let mut bytes = vec![FORMAT];
        bytes.extend(compressed(&vec![0; 2 * CHECKPOINT_BYTES_MAX]).unwrap());
        assert!(bytes.len() < CHECKPOINT_BYTES_MAX);
        let refused = refusal(&bytes);
        assert!(refused.contains("cannot be decompressed"), "{refused}");
    }

    #[test]
    fn fractions_that_are_missing_or_left_are_refused() {
        let content = |fractions: usize| {
            let text = br#"{"z": [0.0, 0.0]}"#;
            let mut packed = (text.len() as u64).to_le_bytes().to_vec();
            packed.extend(text);
            packed.extend(vec![0; fractions]);
            let mut bytes = vec![FORMAT];
            bytes.extend(compressed(&packed).unwrap());
            refusal(&bytes)
        };
        for got in [0, 8, 15, 17, 24] {
            let expected = format!("checkpoint: got {got} bytes of fractions, expected 16");
            assert_eq!(content(got), expected);
        }
    }

    /// Packs a state as version 0.2.0 did.
    fn packed_before(state: &State) -> Vec<u8> {
        let mut content = serde_json::to_value(state).unwrap();
        let mut fractions = Vec::new();
        each_fraction(&mut content, &mut |value, fraction| {
            fractions.extend_from_slice(&fraction.to_le_bytes());
            *value = Value::from(0.0);
        });
        let text = serde_json::to_vec(&content).unwrap();
        let mut packed = (text.len() as u64).to_le_bytes().to_vec();
        packed.extend(text);
        packed.extend(fractions);
        let mut bytes = vec![FORMAT_BEFORE];
        bytes.extend(compressed(&packed).unwrap());
        bytes
    }

    #[test]
    fn the_format_before_is_read() {
        let fractions = [-0.0, 1.0, 0.1, f64::MIN_POSITIVE / 8.0, -1e300];
        let former = state(fractions.to_vec(), 0.25);
        let read: State = unpack(&packed_before(&former)).unwrap();
        assert_eq!(read, former);
        assert!(read.z[0].is_sign_negative());
    }

    #[test]
    fn text_of_former_versions_is_read() {
        let former = state(vec![0.1, 2.0], 0.25);
        let text = serde_json::to_vec(&former).unwrap();
        assert_eq!(unpack::<State>(&text).unwrap(), former);
    }
}
