//! Users, sessions and API tokens in the store.

use fleetcal_domain::access::{
    AccountName, Grant, PasswordHash, SecretHash, SessionSpan, TokenSpan, TokenState,
};
use fleetcal_model::{TokenId, UserId, Version, WallTime};

/// User who can sign in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UserRecord {
    /// Number.
    pub id: UserId,
    /// Name, which no other user has.
    pub name: AccountName,
    /// Role.
    pub grant: Grant,
    /// Password.
    pub password: PasswordHash,
    /// True if signing in is refused.
    pub disabled: bool,
    /// Version, incremented with every change of the fields above.
    pub version: Version,
    /// Time of the user's creation, wall time.
    pub created_ns: WallTime,
    /// Time of the last change, wall time.
    pub updated_ns: WallTime,
    /// Time of the last sign-in, wall time.
    pub signed_in_ns: Option<WallTime>,
}

/// Session of a signed-in browser.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SessionRecord {
    /// User of the session.
    pub user: UserRecord,
    /// Begin and last use of the session.
    pub span: SessionSpan,
}

/// API token.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TokenRecord {
    /// Number.
    pub id: TokenId,
    /// Name, which no other valid token has.
    pub name: AccountName,
    /// Role, and the robot of a robot's token.
    pub grant: Grant,
    /// Hash of its value.
    pub hash: SecretHash,
    /// Person or tool that created it.
    pub created_by: String,
    /// Validity period of the token.
    pub span: TokenSpan,
    /// Time of its last use, wall time.
    pub used_ns: Option<WallTime>,
}

impl TokenRecord {
    /// State of the token at `now`.
    pub fn state(&self, now: WallTime) -> TokenState {
        self.span.state(now)
    }
}

/// Record that was written, by this request or an earlier one with its key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Written<T> {
    /// Present record; for a removed one, its last state.
    pub record: T,
    /// True if an earlier request with the same `Idempotency-Key` wrote it.
    pub repeated: bool,
}

/// Use of a session or token.
#[derive(Debug, Clone, Copy)]
pub struct CredentialUse {
    /// Session or token that was used.
    pub credential: Credential,
    /// Time of the use, wall time.
    pub now: WallTime,
}

/// Credential that proves an identity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Credential {
    /// Cookie of a session.
    Session(SecretHash),
    /// An API token.
    Token(SecretHash),
}
