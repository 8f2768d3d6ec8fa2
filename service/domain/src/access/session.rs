//! Sessions of browsers: the cookie's value, and how long one counts.

use std::time::Duration;

use super::secret::{hex, is_hex};
use super::{Random, SecretHash};
use crate::limits;

/// The value of a session's cookie. Only its hash is kept.
#[derive(Clone)]
pub struct SessionValue(String);

impl SessionValue {
    /// A new session.
    pub fn new(random: &Random) -> Self {
        Self(hex(random))
    }

    /// A session that a browser shows; `None` when it has not the form of one.
    pub fn parse(text: &str) -> Option<Self> {
        is_hex(text).then(|| Self(text.to_owned()))
    }

    /// The text, for the cookie.
    pub fn reveal(&self) -> &str {
        &self.0
    }

    /// What is stored.
    pub fn hash(&self) -> SecretHash {
        SecretHash::of(&self.0)
    }
}

impl std::fmt::Debug for SessionValue {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("SessionValue(…)")
    }
}

/// When a session began and when it was last used, wall time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SessionSpan {
    /// When its user signed in.
    pub created_ns: i64,
    /// When it was last used, up to [`limits::SESSION_USE_NOTED_EVERY`] late.
    pub used_ns: i64,
}

impl SessionSpan {
    /// When it ends unless it is used again: after its idle time, or its whole time if that is
    /// earlier.
    pub fn ends_ns(&self) -> i64 {
        let idle = after(self.used_ns, limits::SESSION_IDLE_MAX);
        idle.min(after(self.created_ns, limits::SESSION_MAX))
    }

    /// Whether it counts at `now_ns`.
    pub fn is_valid(&self, now_ns: i64) -> bool {
        now_ns < self.ends_ns()
    }

    /// Whether its use at `now_ns` should be noted.
    pub fn is_to_be_noted(&self, now_ns: i64) -> bool {
        now_ns >= after(self.used_ns, limits::SESSION_USE_NOTED_EVERY)
    }
}

/// The time this long after another.
fn after(from_ns: i64, by: Duration) -> i64 {
    from_ns.saturating_add(i64::try_from(by.as_nanos()).unwrap_or(i64::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOUR_NS: i64 = 3_600_000_000_000;

    #[test]
    fn a_session_ends_idle_or_old() {
        let span = |used_h: i64| SessionSpan {
            created_ns: 0,
            used_ns: used_h * HOUR_NS,
        };
        assert!(span(0).is_valid(12 * HOUR_NS - 1) && !span(0).is_valid(12 * HOUR_NS));
        let old = span(7 * 24 - 1);
        assert!(old.is_valid(7 * 24 * HOUR_NS - 1) && !old.is_valid(7 * 24 * HOUR_NS));
    }

    #[test]
    fn a_session_is_parsed_from_its_own_text_alone() {
        let session = SessionValue::new(&[1; 32]);
        let again = SessionValue::parse(session.reveal()).unwrap();
        assert_eq!(again.hash(), session.hash());
        assert!(SessionValue::parse("x").is_none());
    }
}
