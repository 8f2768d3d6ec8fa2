//! Users, sessions and API tokens, as the store keeps them.

use fleetcal_domain::access::{
    AccountName, Actor, Grant, PasswordHash, SecretHash, SessionSpan, TokenSpan, TokenState,
};

use super::record::{Expected, IdempotencyKey};

/// Somebody who signs in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UserRecord {
    /// Number.
    pub id: i64,
    /// Name, which no other user has.
    pub name: AccountName,
    /// Role.
    pub grant: Grant,
    /// Password.
    pub password: PasswordHash,
    /// Whether signing in is refused.
    pub disabled: bool,
    /// Goes up by one with every change of the above.
    pub version: u64,
    /// When the user was made, wall time.
    pub created_ns: i64,
    /// When the user last changed, wall time.
    pub updated_ns: i64,
    /// When the user last signed in, wall time.
    pub signed_in_ns: Option<i64>,
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
    pub id: i64,
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
    pub used_ns: Option<i64>,
}

impl TokenRecord {
    /// Whether it counts at `now_ns`.
    pub fn state(&self, now_ns: i64) -> TokenState {
        self.span.state(now_ns)
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

/// A change of a user, or of a user's sessions.
#[derive(Debug, Clone)]
pub struct UserWrite {
    /// Who changes.
    pub actor: Actor,
    /// When, wall time.
    pub now_ns: i64,
    /// What.
    pub change: UserChange,
}

/// What is changed of a user.
#[derive(Debug, Clone)]
pub enum UserChange {
    /// A new one.
    Create {
        /// Name.
        name: AccountName,
        /// Role.
        grant: Grant,
        /// Password.
        password: PasswordHash,
        /// The request's key.
        key: Option<IdempotencyKey>,
    },
    /// The first administrator, signed in; refused when there is any user.
    SetUp {
        /// Name.
        name: AccountName,
        /// Password.
        password: PasswordHash,
        /// The browser's session.
        session: SecretHash,
    },
    /// Some of role, password and `disabled`. Sessions end, unless the role alone changes.
    Edit {
        /// Who.
        id: i64,
        /// The version that the caller saw.
        expected: Expected,
        /// The new values.
        edit: UserEdit,
        /// The one session that goes on.
        keep: Option<SecretHash>,
    },
    /// Away with it.
    Remove {
        /// Who.
        id: i64,
        /// The version that the caller saw.
        expected: Expected,
    },
    /// A new session of a user whose password was right at `version`.
    SignIn {
        /// Who.
        id: i64,
        /// The version whose password was right.
        version: u64,
        /// The browser's session.
        session: SecretHash,
    },
    /// The end of a session.
    SignOut {
        /// Which.
        session: SecretHash,
    },
}

/// New values of a user; `None` leaves the old one.
#[derive(Debug, Clone, Default)]
pub struct UserEdit {
    /// Role.
    pub grant: Option<Grant>,
    /// Password.
    pub password: Option<PasswordHash>,
    /// Whether signing in is refused.
    pub disabled: Option<bool>,
}

/// A change of a token.
#[derive(Debug, Clone)]
pub struct TokenWrite {
    /// Who changes.
    pub actor: Actor,
    /// When, wall time.
    pub now_ns: i64,
    /// What.
    pub change: TokenChange,
}

/// What is changed of a token.
#[derive(Debug, Clone)]
pub enum TokenChange {
    /// A new one.
    Create {
        /// Name.
        name: AccountName,
        /// Role and robot.
        grant: Grant,
        /// Hash of its value.
        hash: SecretHash,
        /// When it ends by itself, wall time.
        expires_ns: Option<i64>,
        /// The request's key.
        key: Option<IdempotencyKey>,
    },
    /// It counts no more. A token that was revoked before stays as it is.
    Revoke {
        /// Which.
        id: i64,
    },
}

/// That a session or token was used.
#[derive(Debug, Clone, Copy)]
pub struct CredentialUse {
    /// Which.
    pub credential: Credential,
    /// When, wall time.
    pub now_ns: i64,
}

/// What somebody proves with who it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Credential {
    /// A session's cookie.
    Session(SecretHash),
    /// An API token.
    Token(SecretHash),
}
