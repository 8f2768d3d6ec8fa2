//! The code by which the first administrator is made.

use fleetcal_model::WallTime;

use super::secret::hex;
use super::{Random, SecretHash};
use crate::limits;

/// What the service keeps of the code that it printed at a start without users.
#[derive(Debug, Clone, Copy)]
pub struct SetupCode {
    hash: SecretHash,
    ends_ns: WallTime,
}

impl SetupCode {
    /// A new code that counts from `now` (wall time) on, and its text, to be printed once.
    pub fn new(random: &Random, now: WallTime) -> (Self, String) {
        let text = hex(random);
        let code = Self {
            hash: SecretHash::of(&text),
            ends_ns: now.plus(limits::SETUP_CODE_MAX),
        };
        (code, text)
    }

    /// Whether `text` is this code, and it still counts.
    pub fn accepts(&self, text: &str, now: WallTime) -> bool {
        SecretHash::of(text) == self.hash && now < self.ends_ns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_counts_for_a_day() {
        const DAY_NS: i64 = 24 * 3_600_000_000_000;
        let (code, text) = SetupCode::new(&[3; 32], WallTime(0));
        assert!(code.accepts(&text, WallTime(DAY_NS - 1)));
        assert!(!code.accepts(&text, WallTime(DAY_NS)));
        assert!(!code.accepts("", WallTime(0)) && !code.accepts(&text[1..], WallTime(0)));
    }
}
