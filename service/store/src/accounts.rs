//! Users, sessions and API tokens, as the store keeps them.

use fleetcal_domain::access::{
    AccountName, Grant, PasswordHash, SecretHash, SessionSpan, TokenSpan, TokenState,
};
use fleetcal_model::{TokenId, UserId, Version, WallTime};

/// Somebody who signs in.
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
    /// Whether signing in is refused.
    pub disabled: bool,
    /// Goes up by one with every change of the above.
    pub version: Version,
    /// When the user was made, wall time.
    pub created_ns: WallTime,
    /// When the user last changed, wall time.
    pub updated_ns: WallTime,
    /// When the user last signed in, wall time.
    pub signed_in_ns: Option<WallTime>,
}

/// A browser that is signed in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SessionRecord {
    /// Whose.
    pub user: UserRecord,
    /// From when on.
    pub span: SessionSpan,
}

/// An API token.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TokenRecord {
    /// Number.
    pub id: TokenId,
    /// Name, which no other token that counts has.
    pub name: AccountName,
    /// Role, and the robot that it is bound to.
    pub grant: Grant,
    /// Hash of its value.
    pub hash: SecretHash,
    /// Who made it.
    pub created_by: String,
    /// From when to when it counts.
    pub span: TokenSpan,
    /// When it was last used, wall time.
    pub used_ns: Option<WallTime>,
}

impl TokenRecord {
    /// Whether it counts at `now`.
    pub fn state(&self, now: WallTime) -> TokenState {
        self.span.state(now)
    }
}

/// A record that was written, or that the same request wrote before.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Written<T> {
    /// The record as it is now; as it was before, when it was removed.
    pub record: T,
    /// Whether an earlier request with the same `Idempotency-Key` wrote it.
    pub repeated: bool,
}

/// That a session or token was used.
#[derive(Debug, Clone, Copy)]
pub struct CredentialUse {
    /// Which.
    pub credential: Credential,
    /// When, wall time.
    pub now: WallTime,
}

/// What somebody proves with who it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Credential {
    /// A session's cookie.
    Session(SecretHash),
    /// An API token.
    Token(SecretHash),
}
