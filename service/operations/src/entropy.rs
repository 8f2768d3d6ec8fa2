//! Randomness of the service, from the system.

use fleetcal_domain::access::Random;

/// Failure of the system's random generator.
pub type NoEntropy = getrandom::Error;

/// Random bytes of a secret.
///
/// # Errors
/// If the system has none.
pub fn secret() -> Result<Random, NoEntropy> {
    let mut bytes = Random::default();
    getrandom::fill(&mut bytes)?;
    Ok(bytes)
}

/// Random bytes of a password's salt.
///
/// # Errors
/// If the system has none.
pub fn salt() -> Result<[u8; 16], NoEntropy> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes)?;
    Ok(bytes)
}

/// Random number from 0 to 1, which spreads the retries in time.
///
/// # Errors
/// If the system has none.
pub fn jitter() -> Result<f64, NoEntropy> {
    let mut bytes = [0; 4];
    getrandom::fill(&mut bytes)?;
    Ok(f64::from(u32::from_le_bytes(bytes)) / f64::from(u32::MAX))
}

/// Random number of 64 bits, which identifies its bearer.
///
/// # Errors
/// If the system has none.
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
