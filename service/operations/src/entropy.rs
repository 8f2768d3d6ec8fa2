//! The one place where randomness enters the service.

use fleetcal_domain::access::Random;

/// The system gave no random bytes.
pub type NoEntropy = getrandom::Error;

/// Random bytes of a secret.
///
/// # Errors
/// When the system gives none.
pub fn secret() -> Result<Random, NoEntropy> {
    let mut bytes = Random::default();
    getrandom::fill(&mut bytes)?;
    Ok(bytes)
}

/// Random bytes of a password's salt.
///
/// # Errors
/// When the system gives none.
pub fn salt() -> Result<[u8; 16], NoEntropy> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes)?;
    Ok(bytes)
}

/// A number from 0 to 1, by which what waits does not come back all at once.
///
/// # Errors
/// When the system gives none.
pub fn jitter() -> Result<f64, NoEntropy> {
    let mut bytes = [0; 4];
    getrandom::fill(&mut bytes)?;
    Ok(f64::from(u32::from_le_bytes(bytes)) / f64::from(u32::MAX))
}

/// A number of all that there are: what bears it is told from everything else.
///
/// # Errors
/// When the system gives none.
pub fn number() -> Result<i64, NoEntropy> {
    let mut bytes = [0; 8];
    getrandom::fill(&mut bytes)?;
    Ok(i64::from_le_bytes(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn secrets_differ() {
        assert_ne!(secret().unwrap(), secret().unwrap());
        assert_ne!(salt().unwrap(), salt().unwrap());
        assert!((0.0..=1.0).contains(&jitter().unwrap()));
    }
}
