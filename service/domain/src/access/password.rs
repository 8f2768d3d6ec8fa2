//! Passwords: accepted lengths, and argon2id.

use argon2::password_hash::phc::{Output, ParamsString, PasswordHash as Phc, Salt};
use argon2::{Algorithm, Argon2, Block, Params, Version};
use subtle::ConstantTimeEq;
use thiserror::Error;

use crate::limits;

/// Hash that matches no password, with the parameters of [`PasswordHash::of`]: an unknown name is
/// verified against it, so that the answer takes as long as for a known one.
const OF_NOBODY: &str = "$argon2id$v=19$m=19456,t=2,p=1$bm9ib2R5IGlzIGhlcmU$\
                         AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA";

/// Reason for which a password was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error(
    "password: got {chars} characters, expected {} to {}",
    limits::PASSWORD_CHARS_MIN,
    limits::PASSWORD_CHARS_MAX
)]
pub struct PasswordRefused {
    chars: usize,
}

/// Failure to hash a password.
#[derive(Debug, Clone, Error)]
#[error("the password could not be hashed: {0}")]
pub struct HashFailed(argon2::password_hash::Error);

/// A password that may be set.
#[derive(Clone)]
pub struct Password(String);

impl Password {
    /// Parses a password. Its length alone is checked, as length is what counts (NIST SP 800-63B,
    /// 5.1.1.2).
    ///
    /// # Errors
    /// [`PasswordRefused`], which does not repeat it.
    pub fn parse(text: &str) -> Result<Self, PasswordRefused> {
        let chars = text.chars().count();
        if (limits::PASSWORD_CHARS_MIN..=limits::PASSWORD_CHARS_MAX).contains(&chars) {
            Ok(Self(text.to_owned()))
        } else {
            Err(PasswordRefused { chars })
        }
    }
}

impl std::fmt::Debug for Password {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Password(…)")
    }
}

/// Stored form of a password: argon2id with parameters and salt, as a PHC string.
#[derive(Clone, PartialEq, Eq)]
pub struct PasswordHash(String);

impl PasswordHash {
    /// Hashes a password: 19 MiB and some tens of milliseconds (OWASP's parameters for argon2id).
    ///
    /// # Errors
    /// [`HashFailed`].
    pub fn of(password: &Password, salt: &[u8; 16]) -> Result<Self, HashFailed> {
        let failed = argon2::password_hash::Error::from;
        let argon2 = Argon2::default();
        let mut digest = [0; Params::DEFAULT_OUTPUT_LEN];
        fill(&argon2, password.0.as_bytes(), salt, &mut digest)
            .map_err(|error| HashFailed(failed(error)))?;
        phc_of(&argon2, salt, &digest)
            .map(|phc| Self(phc.to_string()))
            .map_err(HashFailed)
    }

    /// A stored hash.
    pub fn stored(phc: String) -> Self {
        Self(phc)
    }

    /// Hash that matches no password.
    pub fn of_nobody() -> Self {
        Self(OF_NOBODY.to_owned())
    }

    /// The PHC string to be stored.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// True if `candidate` is the password. Takes as long as [`PasswordHash::of`].
    pub fn verify(&self, candidate: &str) -> bool {
        let matches = Phc::new(&self.0).ok().and_then(|phc| {
            let algorithm = Algorithm::try_from(phc.algorithm.as_str()).ok()?;
            let version = Version::try_from(phc.version?).ok()?;
            let argon2 = Argon2::new(algorithm, version, Params::try_from(&phc).ok()?);
            let (salt, expected) = (phc.salt?, phc.hash?);
            let mut digest = vec![0; expected.len()];
            fill(&argon2, candidate.as_bytes(), salt.as_ref(), &mut digest).ok()?;
            Some(bool::from(expected.as_bytes().ct_eq(&digest)))
        });
        matches.unwrap_or(false)
    }
}

/// Hashes `password` into `digest`, and returns the memory to the system afterwards.
///
/// An allocator keeps freed memory for the next allocation, and glibc does so once for each thread:
/// 19 MiB for each thread that ever hashed. Blocks larger than
/// [`limits::ALLOCATOR_MAPS_BEYOND_BYTES`] are mapped separately and unmapped when freed. So more
/// is reserved than is used; untouched pages take no memory.
fn fill(
    argon2: &Argon2<'_>,
    password: &[u8],
    salt: &[u8],
    digest: &mut [u8],
) -> Result<(), argon2::Error> {
    let used = argon2.params().block_count();
    let mapped = limits::ALLOCATOR_MAPS_BEYOND_BYTES / Block::SIZE + 1;
    let mut blocks = Vec::with_capacity(used.max(mapped));
    blocks.resize(used, Block::new());
    argon2.hash_password_into_with_memory(password, salt, digest, &mut blocks)
}

fn phc_of(
    argon2: &Argon2<'_>,
    salt: &[u8],
    digest: &[u8],
) -> Result<Phc, argon2::password_hash::Error> {
    Ok(Phc {
        algorithm: Algorithm::default().ident(),
        version: Some(Version::default().into()),
        params: ParamsString::try_from(argon2.params())?,
        salt: Some(Salt::new(salt)?),
        hash: Some(Output::new(digest)?),
    })
}

impl std::fmt::Debug for PasswordHash {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("PasswordHash(…)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_password_is_known_again() {
        let password = Password::parse("correct horse battery").unwrap();
        let hash = PasswordHash::of(&password, &[1; 16]).unwrap();
        assert!(hash.as_str().starts_with("$argon2id$v=19$m=19456,t=2,p=1$"));
        let stored = PasswordHash::stored(hash.as_str().to_owned());
        assert!(stored.verify("correct horse battery"));
        for wrong in ["", "correct horse batter", "Correct horse battery"] {
            assert!(!stored.verify(wrong), "{wrong}");
        }
        assert_ne!(PasswordHash::of(&password, &[2; 16]).unwrap(), hash);
    }

    #[test]
    fn the_hash_of_nobody_costs_what_others_cost() {
        let of = |hash: &PasswordHash| {
            let phc = Phc::new(hash.as_str()).unwrap();
            (phc.algorithm, phc.version, phc.params.to_string())
        };
        let password = Password::parse("correct horse battery").unwrap();
        let fresh = PasswordHash::of(&password, &[1; 16]).unwrap();
        assert_eq!(of(&PasswordHash::of_nobody()), of(&fresh));
        assert!(!PasswordHash::of_nobody().verify(""));
        assert!(!PasswordHash::stored("garbage".to_owned()).verify("garbage"));
    }

    #[test]
    fn length_is_what_counts() {
        for (chars, accepted) in [(11, false), (12, true), (128, true), (129, false)] {
            assert_eq!(Password::parse(&"ü".repeat(chars)).is_ok(), accepted);
        }
        let refused = Password::parse("secret").unwrap_err().to_string();
        assert_eq!(refused, "password: got 6 characters, expected 12 to 128");
    }
}
