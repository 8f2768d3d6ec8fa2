//! Users, sessions and API tokens, as the store keeps them.

use async_trait::async_trait;
use thiserror::Error;

use super::Store;
use super::error::StoreError;
use super::record::{Expected, IdempotencyKey};
use super::writer::Command;
use crate::access::{
    AccountName, Actor, Grant, PasswordHash, SecretHash, SessionSpan, TokenSpan, TokenState,
};
use crate::limits;

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

/// Why a user, session or token was not changed.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum AccountRefused {
    /// No such user.
    #[error("no user {0} is known")]
    UserUnknown(i64),
    /// No such token.
    #[error("no token {0} is known")]
    TokenUnknown(i64),
    /// The session has ended.
    #[error("the session has ended")]
    SessionUnknown,
    /// Another user, or token that counts, has the name.
    #[error("the name {0} is taken")]
    NameTaken(AccountName),
    /// The user is no longer the one that the caller saw.
    #[error("user {id} is at version {found}")]
    VersionConflict {
        /// Who.
        id: i64,
        /// The version now.
        found: u64,
    },
    /// Nobody could administrate any more.
    #[error("this is the last administrator that can sign in; make another one first")]
    LastAdmin,
    /// The first administrator is there already.
    #[error("there are users already; sign in as one of them")]
    AlreadySetUp,
    /// Too many of them.
    #[error("there are {max} {what} already, which is the limit")]
    Full {
        /// Users or tokens.
        what: &'static str,
        /// How many.
        max: u32,
    },
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

/// The part of [`super::backend::Reader`] that is about access.
#[async_trait]
pub trait AccountReader {
    /// Users after number `after`, at most `limit`.
    async fn users(&self, after: i64, limit: u32) -> Result<Vec<UserRecord>, StoreError>;

    /// A user.
    async fn user(&self, id: i64) -> Result<Option<UserRecord>, StoreError>;

    /// The user of a name, upper or lower case.
    async fn user_named(&self, name: &str) -> Result<Option<UserRecord>, StoreError>;

    /// Tokens after number `after`, at most `limit`.
    async fn tokens(&self, after: i64, limit: u32) -> Result<Vec<TokenRecord>, StoreError>;

    /// The token of a value.
    async fn token_of(&self, hash: SecretHash) -> Result<Option<TokenRecord>, StoreError>;

    /// The session of a cookie.
    async fn session_of(&self, hash: SecretHash) -> Result<Option<SessionRecord>, StoreError>;
}

impl Store {
    /// Changes a user.
    ///
    /// # Errors
    /// [`StoreError::Account`] when it is refused, [`StoreError::KeyReused`]; otherwise the
    /// database's failure.
    pub async fn write_user(
        &self,
        actor: Actor,
        change: UserChange,
    ) -> Result<Written<UserRecord>, StoreError> {
        let now_ns = self.shared.clock.now_ns();
        let write = UserWrite {
            actor,
            now_ns,
            change,
        };
        self.ask(|reply| Command::User(Box::new(write), reply))
            .await
    }

    /// Changes a token.
    ///
    /// # Errors
    /// [`StoreError::Account`] when it is refused, [`StoreError::KeyReused`]; otherwise the
    /// database's failure.
    pub async fn write_token(
        &self,
        actor: Actor,
        change: TokenChange,
    ) -> Result<Written<TokenRecord>, StoreError> {
        let now_ns = self.shared.clock.now_ns();
        let write = TokenWrite {
            actor,
            now_ns,
            change,
        };
        self.ask(|reply| Command::Token(Box::new(write), reply))
            .await
    }

    /// Notes that a session or token was used. Never waits.
    pub fn note_use(&self, credential: Credential) {
        let now_ns = self.shared.clock.now_ns();
        self.offer(Command::Use(CredentialUse { credential, now_ns }));
    }

    /// Users after number `after`, at most `limit`.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn users(&self, after: i64, limit: u32) -> Result<Vec<UserRecord>, StoreError> {
        self.shared.reader.users(after, limit).await
    }

    /// Whether there is any user.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn has_users(&self) -> Result<bool, StoreError> {
        Ok(!self.shared.reader.users(0, 1).await?.is_empty())
    }

    /// A user.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn user(&self, id: i64) -> Result<Option<UserRecord>, StoreError> {
        self.shared.reader.user(id).await
    }

    /// The user of a name, upper or lower case.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn user_named(&self, name: &str) -> Result<Option<UserRecord>, StoreError> {
        self.shared.reader.user_named(name).await
    }

    /// Tokens after number `after`, at most `limit`.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn tokens(&self, after: i64, limit: u32) -> Result<Vec<TokenRecord>, StoreError> {
        self.shared.reader.tokens(after, limit).await
    }

    /// The token of a value, whether it counts or not.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn token_of(&self, hash: SecretHash) -> Result<Option<TokenRecord>, StoreError> {
        self.shared.reader.token_of(hash).await
    }

    /// The session of a cookie, whether it counts or not; none of a user that is disabled.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn session_of(&self, hash: SecretHash) -> Result<Option<SessionRecord>, StoreError> {
        self.shared.reader.session_of(hash).await
    }
}

/// Whether an administrator is needed who can sign in.
pub(super) fn counts_as_admin(grant: &Grant, disabled: bool) -> bool {
    grant.role() == crate::access::Role::Admin && !disabled
}

/// Sessions that began before this have ended, and those last used before the other.
pub(super) fn ended_before(now_ns: i64) -> (i64, i64) {
    let before = |length: std::time::Duration| {
        now_ns.saturating_sub(i64::try_from(length.as_nanos()).unwrap_or(i64::MAX))
    };
    (
        before(limits::SESSION_MAX),
        before(limits::SESSION_IDLE_MAX),
    )
}
