//! API tokens: their text and their validity.

use fleetcal_model::WallTime;

use super::secret::{hex, is_hex};
use super::{Random, SecretHash};

/// Prefix of every token, by which a leaked one is recognised.
const PREFIX: &str = "cal_";

/// Text of an API token. Shown once; only its hash is kept.
#[derive(Clone)]
pub struct TokenValue(String);

impl TokenValue {
    /// Makes a new token.
    pub fn new(random: &Random) -> Self {
        Self(format!("{PREFIX}{}", hex(random)))
    }

    /// Parses a token; `None` if its form is wrong.
    pub fn parse(text: &str) -> Option<Self> {
        is_hex(text.strip_prefix(PREFIX)?).then(|| Self(text.to_owned()))
    }

    /// Text of the token, to be shown once.
    pub fn reveal(&self) -> &str {
        &self.0
    }

    /// Hash to be stored.
    pub fn hash(&self) -> SecretHash {
        SecretHash::of(&self.0)
    }
}

impl std::fmt::Debug for TokenValue {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("TokenValue(…)")
    }
}

/// Validity of a token.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TokenState {
    /// Valid.
    Valid,
    /// Expired.
    Expired,
    /// Revoked.
    Revoked,
}

/// Validity period of a token, wall time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TokenSpan {
    /// Time of its creation.
    pub created_ns: WallTime,
    /// End of its validity; `None` for a token without one.
    pub expires_ns: Option<WallTime>,
    /// Time of its revocation.
    pub revoked_ns: Option<WallTime>,
}

impl TokenSpan {
    /// State of the token at `now`.
    pub fn state(&self, now: WallTime) -> TokenState {
        if self.revoked_ns.is_some() {
            TokenState::Revoked
        } else if self.expires_ns.is_some_and(|expires_ns| now >= expires_ns) {
            TokenState::Expired
        } else {
            TokenState::Valid
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_parsed_from_its_own_text_alone() {
        let token = TokenValue::new(&[7; 32]);
        let shown = token.reveal().to_owned();
        assert_eq!(TokenValue::parse(&shown).unwrap().hash(), token.hash());
        for garbage in [
            "",
            "cal_",
            "cal_07",
            &shown[4..],
            &shown.replace("cal_", "Cal_"),
        ] {
            assert!(TokenValue::parse(garbage).is_none(), "{garbage}");
        }
        assert!(!format!("{token:?}").contains("07"));
    }

    #[test]
    fn a_token_ends_at_its_time_or_by_will() {
        let span = |expires_ns, revoked_ns| TokenSpan {
            created_ns: WallTime(0),
            expires_ns,
            revoked_ns,
        };
        assert_eq!(
            span(None, None).state(WallTime(i64::MAX)),
            TokenState::Valid
        );
        assert_eq!(
            span(Some(WallTime(10)), None).state(WallTime(9)),
            TokenState::Valid
        );
        assert_eq!(
            span(Some(WallTime(10)), None).state(WallTime(10)),
            TokenState::Expired
        );
        assert_eq!(
            span(None, Some(WallTime(5))).state(WallTime(0)),
            TokenState::Revoked
        );
    }
}
