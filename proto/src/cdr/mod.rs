//! CDR, the binary form of ROS 2 messages (OMG DDSI-RTPS 10.5, XCDR1 `PLAIN_CDR`).
//!
//! Four bytes of encapsulation header, then the fields in order, each aligned to its own size as
//! counted from behind that header. Strings are a `u32` length that includes the closing NUL.

mod reader;
mod writer;

pub use reader::CdrReader;
pub use writer::CdrWriter;

use thiserror::Error;

/// Most bytes that may follow a message's last field: senders pad to their word size.
pub const PADDING_BYTES_MAX: usize = 7;
/// Most strings in one sequence. A robot has some dozen joints.
pub const STRINGS_MAX: usize = 1024;

/// Byte order of a payload.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Endianness {
    /// Most significant byte first.
    Big,
    /// Least significant byte first.
    Little,
}

/// Reason for which a payload is not such a message in CDR. It names the field, its value and the
/// accepted values.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum CdrError {
    /// The payload does not begin like `PLAIN_CDR`.
    #[error(
        "encapsulation header: got {header:02x?}, expected 4 bytes that begin with 00 00 \
         (big endian) or 00 01 (little endian)"
    )]
    Encapsulation {
        /// The first bytes, at most four.
        header: Vec<u8>,
    },
    /// The payload ends before the field does.
    #[error("{field} needs {needed} bytes, the payload has {left} left")]
    Truncated {
        /// Name of the field.
        field: &'static str,
        /// Number of bytes that it takes, with its alignment.
        needed: usize,
        /// Number of bytes left.
        left: usize,
    },
    /// The field claims more elements than the payload can hold.
    #[error("{field} claims {claimed} elements, expected at most {accepted} in this payload")]
    Length {
        /// Name of the field.
        field: &'static str,
        /// The length that was read.
        claimed: u32,
        /// Largest number that could fit into the rest.
        accepted: usize,
    },
    /// A string without its closing NUL.
    #[error("{field}: got a string without a closing NUL, expected one with it")]
    StringNotTerminated {
        /// Name of the field.
        field: &'static str,
    },
    /// A string that is not UTF-8.
    #[error("{field} is not UTF-8, expected a string in UTF-8")]
    StringNotUtf8 {
        /// Name of the field.
        field: &'static str,
    },
    /// A value that the field cannot have.
    #[error("{field}: got {value}, expected {accepted}")]
    Value {
        /// Name of the field.
        field: &'static str,
        /// The value.
        value: String,
        /// Accepted values, in words.
        accepted: &'static str,
    },
    /// The fields contradict each other, in the words of their message type.
    #[error("{0}")]
    Contents(String),
    /// The payload continues behind the last field: it is of another type.
    #[error("{extra} bytes follow {field}, the last field; expected at most 7 of padding")]
    Trailing {
        /// Name of the last field.
        field: &'static str,
        /// Number of bytes that follow.
        extra: usize,
    },
}
