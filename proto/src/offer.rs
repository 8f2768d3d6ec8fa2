//! The service's word that a document is wanted now, beside the document itself.
//!
//! A signed document stays genuine for ever, also once people have taken it back. So the service
//! signs a second, short-lived text with each answer that it gives: an [`OfferDocument`]. It ends,
//! and it holds the [`Question`] that it answers, which nobody can foresee: whoever asks knows by it
//! that the answer was not recorded, whatever the clocks say.

use std::fmt::Write as _;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use fleetcal_model::{Generation, RobotId, WallTime};

use crate::calibration::Envelope;

/// Length of a question, bytes.
pub const QUESTION_BYTES: usize = 16;

/// Random number in a robot's query, as 32 lower-case hexadecimal digits.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Question(String);

/// Reason for which a text is not a question.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("question: got {got:?}, expected 32 lower-case hexadecimal digits")]
pub struct QuestionRefused {
    /// Its first characters.
    pub got: String,
}

impl Question {
    /// Makes a question from bytes of a cryptographic random source.
    pub fn from_bytes(bytes: [u8; QUESTION_BYTES]) -> Self {
        let mut digits = String::with_capacity(2 * QUESTION_BYTES);
        for byte in bytes {
            // Writing to a string does not fail.
            write!(digits, "{byte:02x}").ok();
        }
        Self(digits)
    }

    /// Parses a question.
    ///
    /// # Errors
    /// When it is anything but 32 lower-case hexadecimal digits.
    pub fn parse(text: &str) -> Result<Self, QuestionRefused> {
        let is_digit = |byte: u8| matches!(byte, b'0'..=b'9' | b'a'..=b'f');
        if text.len() != 2 * QUESTION_BYTES || !text.bytes().all(is_digit) {
            let got = text.chars().take(80).collect();
            return Err(QuestionRefused { got });
        }
        Ok(Self(text.to_owned()))
    }

    /// Returns its digits.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl TryFrom<String> for Question {
    type Error = QuestionRefused;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        Self::parse(&text)
    }
}

/// Schema of an offer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum OfferSchema {
    /// The first version.
    #[default]
    #[serde(rename = "fleetcal.offer/1")]
    V1,
}

/// Offer of a document to a robot: the content of [`Offered::offer`].
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct OfferDocument {
    /// Schema of the offer.
    pub schema: OfferSchema,
    /// Id of the robot that it is for.
    pub robot: RobotId,
    /// Generation of the document: the newest that the robot should hold.
    pub generation: Generation,
    /// SHA-256 of the document, lower-case hexadecimal.
    pub sha256: String,
    /// Time at which it was made, ns since 1970, by the service's clock.
    pub offered_at_ns: WallTime,
    /// End of its validity, by the same clock: a robot never begins to use the document later.
    pub valid_until_ns: WallTime,
    /// Question that it answers; absent in messages to everybody.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub question: Option<Question>,
}

/// A signed document with its offer, on `{root}/{robot}/calibration/approved`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Offered {
    /// The signed document.
    #[serde(flatten)]
    pub envelope: Envelope,
    /// A signed text of schema `fleetcal.offer/1`, with the document's generation and hash, its end
    /// and the robot's question. Absent where a document is only shown, and from older services.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offer: Option<Envelope>,
}

impl From<Envelope> for Offered {
    fn from(envelope: Envelope) -> Self {
        Self {
            envelope,
            offer: None,
        }
    }
}
