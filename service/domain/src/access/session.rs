//! Sessions of browsers: the cookie's value and the session's validity.

use fleetcal_model::WallTime;

use super::secret::{hex, is_hex};
use super::{Random, SecretHash};
use crate::limits;

/// The value of a session's cookie. Only its hash is kept.
#[derive(Clone)]
pub struct SessionValue(String);

impl SessionValue {
    /// Makes a new value.
    pub fn new(random: &Random) -> Self {
        Self(hex(random))
    }

    /// Parses a cookie's value; `None` if its form is wrong.
    pub fn parse(text: &str) -> Option<Self> {
        is_hex(text).then(|| Self(text.to_owned()))
    }

    /// The text, for the cookie.
    pub fn reveal(&self) -> &str {
        &self.0
    }

    /// Hash to be stored.
    pub fn hash(&self) -> SecretHash {
        SecretHash::of(&self.0)
    }
}

impl std::fmt::Debug for SessionValue {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("SessionValue(…)")
    }
}

/// Begin and last use of a session, wall time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SessionSpan {
    /// Time at which its user signed in.
    pub created_ns: WallTime,
    /// Time of its last use, up to [`limits::SESSION_USE_NOTED_EVERY`] late.
    pub used_ns: WallTime,
}

impl SessionSpan {
    /// End of the session unless it is used again: the end of its idle time or of its longest
    /// duration, whichever is earlier.
    pub fn ends(&self) -> WallTime {
        let idle = self.used_ns.plus(limits::SESSION_IDLE_MAX);
        idle.min(self.created_ns.plus(limits::SESSION_MAX))
    }

    /// True if it is valid at `now`.
    pub fn is_valid(&self, now: WallTime) -> bool {
        now < self.ends()
    }

    /// True if its use at `now` should be recorded.
    pub fn is_to_be_noted(&self, now: WallTime) -> bool {
        now >= self.used_ns.plus(limits::SESSION_USE_NOTED_EVERY)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOUR_NS: i64 = 3_600_000_000_000;

    #[test]
    fn a_session_ends_idle_or_old() {
        let span = |used_h: i64| SessionSpan {
            created_ns: WallTime(0),
            used_ns: WallTime(used_h * HOUR_NS),
        };
        assert!(
            span(0).is_valid(WallTime(12 * HOUR_NS - 1))
                && !span(0).is_valid(WallTime(12 * HOUR_NS))
        );
        let old = span(7 * 24 - 1);
        assert!(
            old.is_valid(WallTime(7 * 24 * HOUR_NS - 1))
                && !old.is_valid(WallTime(7 * 24 * HOUR_NS))
        );
    }

    #[test]
    fn a_session_is_parsed_from_its_own_text_alone() {
        let session = SessionValue::new(&[1; 32]);
        let again = SessionValue::parse(session.reveal()).unwrap();
        assert_eq!(again.hash(), session.hash());
        assert!(SessionValue::parse("x").is_none());
    }
}
