//! The code by which the first administrator is made.

use super::secret::hex;
use super::{Random, SecretHash};
use crate::limits;

/// What the service keeps of the code that it printed at a start without users.
#[derive(Debug, Clone, Copy)]
pub struct SetupCode {
    hash: SecretHash,
    ends_ns: i64,
}

impl SetupCode {
    /// A new code that counts from `now_ns` (wall time) on, and its text, to be printed once.
    pub fn new(random: &Random, now_ns: i64) -> (Self, String) {
        let text = hex(random);
        let valid_ns = i64::try_from(limits::SETUP_CODE_MAX.as_nanos()).unwrap_or(i64::MAX);
        let code = Self {
            hash: SecretHash::of(&text),
            ends_ns: now_ns.saturating_add(valid_ns),
        };
        (code, text)
    }

    /// Whether `text` is this code, and it still counts.
    pub fn accepts(&self, text: &str, now_ns: i64) -> bool {
        SecretHash::of(text) == self.hash && now_ns < self.ends_ns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_counts_for_a_day() {
        const DAY_NS: i64 = 24 * 3_600_000_000_000;
        let (code, text) = SetupCode::new(&[3; 32], 0);
        assert!(code.accepts(&text, DAY_NS - 1));
        assert!(!code.accepts(&text, DAY_NS));
        assert!(!code.accepts("", 0) && !code.accepts(&text[1..], 0));
    }
}
