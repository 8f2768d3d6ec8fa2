//! Seals a calibration document, and opens what was sealed.
//!
//! Hash and Ed25519 signature ([RFC 8032](https://www.rfc-editor.org/rfc/rfc8032)) are over the
//! exact bytes of an envelope's `document` string, so nobody has to agree on a canonical JSON.
//! Keys travel as base64 of their 32 bytes; a key's id is the beginning of its SHA-256.

use std::fmt;
use std::str::FromStr;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use ed25519_dalek::{Signature, Signer as _};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use thiserror::Error;

use crate::audit_head::AuditHeadDocument;
use crate::calibration::{CalibrationDocument, ConfirmationDocument, Confirmed, Envelope};
use crate::certificate::CertificateDocument;
use crate::offer::{OfferDocument, Offered};

/// Largest envelope that is read, bytes.
pub const ENVELOPE_BYTES_MAX: usize = 64 * 1024;
/// Largest envelope with an offer that is read, bytes.
pub const OFFERED_BYTES_MAX: usize = ENVELOPE_BYTES_MAX + 4096;
/// Most keys that are trusted at once: one in use, its predecessors and its successor.
pub const TRUSTED_KEYS_MAX: usize = 8;
/// Bytes of a secret and of a public key.
pub const KEY_BYTES: usize = 32;

/// Number of hexadecimal digits of the public key's SHA-256 that make its id.
const KEY_ID_CHARACTERS: usize = 16;

/// The secret half of a key. Its bytes are erased when it is dropped and never shown by `Debug`.
#[derive(Clone)]
pub struct SigningKey(ed25519_dalek::SigningKey);

impl SigningKey {
    /// Makes a key from 32 bytes of a cryptographic random source.
    pub fn from_bytes(secret: &[u8; KEY_BYTES]) -> Self {
        Self(ed25519_dalek::SigningKey::from_bytes(secret))
    }

    /// Returns the secret bytes, to be kept where nobody else can read them.
    pub fn to_bytes(&self) -> [u8; KEY_BYTES] {
        self.0.to_bytes()
    }

    /// Returns the public half.
    pub fn public_key(&self) -> PublicKey {
        PublicKey(self.0.verifying_key())
    }
}

impl fmt::Debug for SigningKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "SigningKey({})", self.public_key().id())
    }
}

/// Public half of a key, which robots are provisioned with once. Written as base64.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct PublicKey(ed25519_dalek::VerifyingKey);

/// Reason for which a text is not a public key.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("public key {text:?}: {fault}, expected base64 of the 32 bytes of an Ed25519 public key")]
pub struct PublicKeyRefused {
    /// The text.
    pub text: String,
    /// Fault of the text.
    pub fault: &'static str,
}

impl PublicKey {
    /// Returns its short name, lower-case hexadecimal: the beginning of the SHA-256 of its 32
    /// bytes.
    pub fn id(&self) -> String {
        let mut id = sha256_hex(self.0.as_bytes());
        id.truncate(KEY_ID_CHARACTERS);
        id
    }
}

impl fmt::Display for PublicKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&BASE64.encode(self.0.as_bytes()))
    }
}

impl FromStr for PublicKey {
    type Err = PublicKeyRefused;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let refused = |fault| PublicKeyRefused {
            text: text.chars().take(80).collect(),
            fault,
        };
        let bytes = BASE64
            .decode(text.trim())
            .map_err(|_| refused("not base64"))?;
        let bytes = <[u8; KEY_BYTES]>::try_from(bytes).map_err(|_| refused("not 32 bytes long"))?;
        let key = ed25519_dalek::VerifyingKey::from_bytes(&bytes)
            .map_err(|_| refused("no point of the curve"))?;
        // A key of small order "verifies" one signature for many documents.
        if key.is_weak() {
            return Err(refused("weak"));
        }
        Ok(Self(key))
    }
}

impl TryFrom<String> for PublicKey {
    type Error = PublicKeyRefused;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        text.parse()
    }
}

impl From<PublicKey> for String {
    fn from(key: PublicKey) -> Self {
        key.to_string()
    }
}

/// Keys whose signatures are trusted, at least one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TrustedKeys(Vec<PublicKey>);

/// Reason for which keys cannot be trusted together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("{count} trusted keys were given, expected 1 to 8")]
pub struct TrustedKeysRefused {
    /// Number of given keys.
    pub count: usize,
}

impl TrustedKeys {
    /// Trusts several keys: the service's present one, and those before and after a change of key.
    ///
    /// # Errors
    /// When there are none, or more than [`TRUSTED_KEYS_MAX`].
    pub fn new(keys: Vec<PublicKey>) -> Result<Self, TrustedKeysRefused> {
        let count = keys.len();
        if count == 0 || count > TRUSTED_KEYS_MAX {
            return Err(TrustedKeysRefused { count });
        }
        Ok(Self(keys))
    }

    /// Returns the ids of the keys, separated by commas.
    pub fn ids(&self) -> String {
        let ids: Vec<String> = self.0.iter().map(PublicKey::id).collect();
        ids.join(", ")
    }

    /// Returns the keys.
    pub fn keys(&self) -> impl Iterator<Item = &PublicKey> {
        self.0.iter()
    }

    /// Trusts one key more.
    #[must_use]
    pub(crate) fn and(mut self, key: PublicKey) -> Self {
        self.0.push(key);
        self
    }

    fn find(&self, id: &str) -> Option<&PublicKey> {
        self.0.iter().find(|key| key.id() == id)
    }
}

impl From<PublicKey> for TrustedKeys {
    fn from(key: PublicKey) -> Self {
        Self(vec![key])
    }
}

/// Reason for which a document was not sealed.
#[derive(Debug, Error)]
pub enum SealRefused {
    /// A value or sigma is not a finite number, which JSON cannot represent.
    #[error("{field}: got {value}, expected finite numbers")]
    NotFinite {
        /// Its path in the document.
        field: String,
        /// Its value.
        value: f64,
    },
    /// The document cannot be written as JSON.
    #[error("the document cannot be written: {0}")]
    Json(#[from] serde_json::Error),
    /// The envelope is longer than any reader accepts.
    #[error("envelope: got {length} bytes, expected at most 65536")]
    TooLarge {
        /// Its length in bytes.
        length: usize,
    },
}

/// A text that the service signs. Its schema keeps one kind from being taken for another.
pub trait Statement: Serialize + DeserializeOwned {
    /// Name of its schema.
    const SCHEMA: &'static str;
}

impl Statement for CalibrationDocument {
    const SCHEMA: &'static str = "fleetcal.calibration/1";
}

impl Statement for OfferDocument {
    const SCHEMA: &'static str = "fleetcal.offer/1";
}

impl Statement for ConfirmationDocument {
    const SCHEMA: &'static str = "fleetcal.confirmation/1";
}

impl Statement for CertificateDocument {
    const SCHEMA: &'static str = "fleetcal.certificate/1";
}

impl Statement for AuditHeadDocument {
    const SCHEMA: &'static str = "fleetcal.audit_head/1";
}

/// Writes a calibration document once, and hashes and signs exactly the written bytes.
///
/// # Errors
/// When a number is not finite, or the whole is longer than [`ENVELOPE_BYTES_MAX`].
pub fn seal(document: &CalibrationDocument, key: &SigningKey) -> Result<Envelope, SealRefused> {
    for (name, group) in [("values", &document.values), ("sigmas", &document.sigmas)] {
        if let Some((field, value)) = group.fields().find(|(_, value)| !value.is_finite()) {
            let field = format!("{name}.{field}");
            return Err(SealRefused::NotFinite { field, value });
        }
    }
    sign(document, key)
}

/// Writes a text once, and hashes and signs exactly the written bytes.
///
/// # Errors
/// When it cannot be written, or the whole is longer than [`ENVELOPE_BYTES_MAX`].
pub fn sign<T: Statement>(statement: &T, key: &SigningKey) -> Result<Envelope, SealRefused> {
    let document = serde_json::to_string(statement)?;
    let envelope = Envelope {
        sha256: sha256_hex(document.as_bytes()),
        key_id: key.public_key().id(),
        signature: BASE64.encode(key.0.sign(document.as_bytes()).to_bytes()),
        document,
    };
    let length = serde_json::to_vec(&envelope)?.len();
    if length > ENVELOPE_BYTES_MAX {
        return Err(SealRefused::TooLarge { length });
    }
    Ok(envelope)
}

/// Returns the SHA-256 of some bytes in lower-case hexadecimal, as in envelopes and
/// acknowledgements.
pub fn sha256_hex(bytes: &[u8]) -> String {
    format!("{:x}", Sha256::digest(bytes))
}

/// Reason for which an envelope was not opened: the check that failed.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum EnvelopeRefused {
    /// The payload is longer than [`OFFERED_BYTES_MAX`], and was not read.
    #[error("envelope: got {length} bytes, expected at most 69632")]
    TooLarge {
        /// Its length in bytes.
        length: usize,
    },
    /// The envelope is absent.
    #[error(
        "got none, expected one that the service has signed (services of before do not: upgrade \
         the service before its agents)"
    )]
    Absent,
    /// The envelope itself is not JSON of its form.
    #[error("envelope: {0}")]
    Form(String),
    /// The document was altered, or the hash was.
    #[error("sha256 is {said}, the document's is {found}")]
    Hash {
        /// Hash in the envelope.
        said: String,
        /// Hash of the document's bytes.
        found: String,
    },
    /// The key is not trusted.
    #[error("key_id: got {key_id:?}, expected {trusted}")]
    KeyUnknown {
        /// Id of the key in the envelope.
        key_id: String,
        /// The ids of the trusted keys.
        trusted: String,
    },
    /// The signature is not that of the trusted key over these bytes.
    #[error("signature: {fault}, expected that of key {key_id} over the document's bytes")]
    Signature {
        /// Id of the key that it should be of.
        key_id: String,
        /// Fault of the signature.
        fault: &'static str,
    },
    /// The document is signed and whole, but its schema is unknown here.
    #[error("schema: got {found}, expected {expected:?}")]
    Schema {
        /// Schema in the document, as JSON.
        found: String,
        /// Expected schema.
        expected: &'static str,
    },
    /// The document is signed and whole, but does not follow its schema.
    #[error("document: {0}")]
    Document(String),
}

impl Envelope {
    /// Signs the same bytes with another key.
    #[must_use]
    pub fn signed_again(&self, key: &SigningKey) -> Self {
        Self {
            document: self.document.clone(),
            sha256: self.sha256.clone(),
            key_id: key.public_key().id(),
            signature: BASE64.encode(key.0.sign(self.document.as_bytes()).to_bytes()),
        }
    }

    /// Reads an envelope without opening it.
    ///
    /// # Errors
    /// When it is longer than [`OFFERED_BYTES_MAX`] or not an envelope in JSON.
    pub fn from_json(text: &[u8]) -> Result<Self, EnvelopeRefused> {
        let length = text.len();
        if length > OFFERED_BYTES_MAX {
            return Err(EnvelopeRefused::TooLarge { length });
        }
        read(text).map_err(EnvelopeRefused::Form)
    }

    /// Opens the envelope of a calibration document.
    ///
    /// # Errors
    /// As [`Self::open_as`] does.
    pub fn open(&self, trusted: &TrustedKeys) -> Result<CalibrationDocument, EnvelopeRefused> {
        self.open_as(trusted)
    }

    /// Opens it: hash, key id, signature, schema and document are checked in this order, so that an
    /// unsigned document is never parsed.
    ///
    /// # Errors
    /// The check that failed, with the found and the accepted value.
    pub fn open_as<T: Statement>(&self, trusted: &TrustedKeys) -> Result<T, EnvelopeRefused> {
        let bytes = self.document.as_bytes();
        let found = sha256_hex(bytes);
        if found != self.sha256 {
            let said = self.sha256.chars().take(80).collect();
            return Err(EnvelopeRefused::Hash { said, found });
        }
        let Some(key) = trusted.find(&self.key_id) else {
            return Err(EnvelopeRefused::KeyUnknown {
                key_id: self.key_id.chars().take(80).collect(),
                trusted: trusted.ids(),
            });
        };
        let refused = |fault| EnvelopeRefused::Signature {
            key_id: self.key_id.clone(),
            fault,
        };
        let signature = BASE64
            .decode(&self.signature)
            .map_err(|_| refused("not base64"))?;
        let signature =
            Signature::from_slice(&signature).map_err(|_| refused("not 64 bytes long"))?;
        key.0
            .verify_strict(bytes, &signature)
            .map_err(|_| refused("another one"))?;
        read_document(bytes)
    }
}

impl Offered {
    /// Reads a received envelope, without opening it.
    ///
    /// # Errors
    /// When it is longer than [`OFFERED_BYTES_MAX`] or not an envelope in JSON.
    pub fn from_json(payload: &[u8]) -> Result<Self, EnvelopeRefused> {
        let length = payload.len();
        if length > OFFERED_BYTES_MAX {
            return Err(EnvelopeRefused::TooLarge { length });
        }
        read(payload).map_err(EnvelopeRefused::Form)
    }

    /// Opens the service's offer of the document.
    ///
    /// # Errors
    /// [`EnvelopeRefused::Absent`] without one; otherwise as [`Envelope::open_as`] does.
    pub fn open_offer(&self, trusted: &TrustedKeys) -> Result<OfferDocument, EnvelopeRefused> {
        let offer = self.offer.as_ref().ok_or(EnvelopeRefused::Absent)?;
        offer.open_as(trusted)
    }
}

impl Confirmed {
    /// Opens the service's confirmation.
    ///
    /// # Errors
    /// [`EnvelopeRefused::Absent`] if it is unsigned; otherwise as [`Envelope::open_as`] does.
    pub fn open(&self, trusted: &TrustedKeys) -> Result<ConfirmationDocument, EnvelopeRefused> {
        let signed = self.signed.as_ref().ok_or(EnvelopeRefused::Absent)?;
        signed.open_as(trusted)
    }
}

/// Schema alone, so that a document of a later one is refused for that reason only.
#[derive(Deserialize)]
struct SchemaAlone {
    schema: serde_json::Value,
}

/// Reads a document before it is opened, for the name of the key that it should be opened with.
pub(crate) fn read_text<T: Statement>(document: &str) -> Result<T, EnvelopeRefused> {
    read_document(document.as_bytes())
}

fn read_document<T: Statement>(bytes: &[u8]) -> Result<T, EnvelopeRefused> {
    let SchemaAlone { schema } = read(bytes).map_err(EnvelopeRefused::Document)?;
    if schema != T::SCHEMA {
        return Err(EnvelopeRefused::Schema {
            found: schema.to_string(),
            expected: T::SCHEMA,
        });
    }
    read(bytes).map_err(EnvelopeRefused::Document)
}

/// Reads JSON; an error names the field.
fn read<T: for<'a> Deserialize<'a>>(bytes: &[u8]) -> Result<T, String> {
    let mut json = serde_json::Deserializer::from_slice(bytes);
    let value = serde_path_to_error::deserialize(&mut json).map_err(|error| error.to_string())?;
    json.end().map_err(|error| error.to_string())?;
    Ok(value)
}

#[cfg(test)]
mod tests;
