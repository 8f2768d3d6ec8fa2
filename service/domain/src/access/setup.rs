//! The code by which the first administrator is made.

use fleetcal_model::WallTime;

use super::secret::hex;
use super::{Random, SecretHash};
use crate::limits;

/// Stored part of the code that a service prints at a start without users.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SetupCode {
    /// Hash of its text.
    pub hash: SecretHash,
    /// End of its validity, wall time.
    pub ends_ns: WallTime,
}

impl SetupCode {
    /// Makes a code that is valid from `now` (wall time), and its text, to be printed once.
    pub fn new(random: &Random, now: WallTime) -> (Self, String) {
        let text = hex(random);
        let code = Self {
            hash: SecretHash::of(&text),
            ends_ns: now.plus(limits::SETUP_CODE_MAX),
        };
        (code, text)
    }

    /// True if it is still valid.
    pub fn counts(&self, now: WallTime) -> bool {
        now < self.ends_ns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_counts_for_a_day() {
        const DAY_NS: i64 = 24 * 3_600_000_000_000;
        let (code, text) = SetupCode::new(&[3; 32], WallTime(0));
        assert_eq!(code.hash, SecretHash::of(&text));
        assert!(code.counts(WallTime(DAY_NS - 1)) && !code.counts(WallTime(DAY_NS)));
    }
}
