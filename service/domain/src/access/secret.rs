//! Secrets of random bytes: their text, and the stored hash.

use sha2::{Digest, Sha256};
use subtle::ConstantTimeEq;

/// The random bytes of a secret.
pub type Random = [u8; 32];

/// SHA-256 of a random secret, its stored form. A fast hash will do, because 256 random bits cannot
/// be guessed; passwords are hashed by [`super::PasswordHash`].
#[derive(Debug, Clone, Copy, Eq)]
pub struct SecretHash([u8; 32]);

impl SecretHash {
    /// Hashes a secret's text.
    pub fn of(text: &str) -> Self {
        Self(Sha256::digest(text.as_bytes()).into())
    }

    /// Reads a stored hash; `None` if its length is wrong.
    pub fn stored(bytes: &[u8]) -> Option<Self> {
        bytes.try_into().ok().map(Self)
    }

    /// The bytes to be stored.
    pub const fn as_bytes(&self) -> &[u8] {
        &self.0
    }
}

impl PartialEq for SecretHash {
    /// Compares in constant time.
    fn eq(&self, other: &Self) -> bool {
        self.0.ct_eq(&other.0).into()
    }
}

/// Random bytes in hexadecimal digits.
pub(super) fn hex(random: &Random) -> String {
    hex::encode(random)
}

/// True if a text has the form that [`hex`] writes.
pub(super) fn is_hex(text: &str) -> bool {
    text.len() == 64 && text.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hash_equals_itself_alone() {
        let hash = SecretHash::of("a");
        assert_eq!(SecretHash::stored(hash.as_bytes()), Some(hash));
        assert_ne!(hash, SecretHash::of("b"));
        assert_eq!(SecretHash::stored(&[0; 31]), None);
    }

    #[test]
    fn random_bytes_are_written_as_hex() {
        let text = hex(&[0xa5; 32]);
        assert_eq!(text, "a5".repeat(32));
        assert!(is_hex(&text) && !is_hex(&text.to_uppercase()) && !is_hex("a5"));
    }
}
