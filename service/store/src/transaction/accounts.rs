//! Users, their sessions, and API tokens.

use async_trait::async_trait;
use fleetcal_domain::access::{AccountName, SecretHash, SetupCode};
use fleetcal_model::{TokenId, UserId, WallTime};

use crate::accounts::{TokenRecord, UserRecord};
use crate::error::StoreError;

/// Users; errors as in [`super::Records`].
#[async_trait]
pub trait AccountRecords {
    /// Number of users.
    async fn count_users(&mut self) -> Result<u32, StoreError>;

    /// Number of administrators who can sign in.
    async fn count_admins(&mut self) -> Result<u32, StoreError>;

    /// Reads one user.
    async fn user(&mut self, id: UserId) -> Result<Option<UserRecord>, StoreError>;

    /// Finds the user of a name, upper or lower case.
    async fn user_named(&mut self, name: &AccountName) -> Result<Option<UserRecord>, StoreError>;

    /// Adds a user, whose number in the record is ignored; returns the assigned one.
    async fn add_user(&mut self, user: &UserRecord) -> Result<UserId, StoreError>;

    /// Updates an existing user.
    async fn save_user(&mut self, user: &UserRecord) -> Result<(), StoreError>;

    /// Deletes a user with the sessions.
    async fn delete_user(&mut self, id: UserId) -> Result<(), StoreError>;

    /// Adds a set-up code, with which the first administrator is created.
    async fn add_setup_code(&mut self, code: &SetupCode) -> Result<(), StoreError>;

    /// Deletes all set-up codes but the `kept` that end last.
    async fn keep_setup_codes(&mut self, kept: u32) -> Result<(), StoreError>;
}

/// Sessions of users; errors as in [`super::Records`].
#[async_trait]
pub trait SessionRecords {
    /// Adds a user's session, which begins at `now`.
    async fn add_session(
        &mut self,
        user: UserId,
        session: &SecretHash,
        now: WallTime,
    ) -> Result<(), StoreError>;

    /// Deletes a session; returns its user.
    async fn delete_session(&mut self, session: &SecretHash) -> Result<Option<UserId>, StoreError>;

    /// Deletes a user's sessions but `keep`.
    async fn delete_sessions(
        &mut self,
        user: UserId,
        keep: Option<&SecretHash>,
    ) -> Result<(), StoreError>;

    /// Deletes every session that began at `created_ns` or before, or was last used at `used_ns` or
    /// before.
    async fn delete_old_sessions(
        &mut self,
        created_ns: WallTime,
        used_ns: WallTime,
    ) -> Result<(), StoreError>;

    /// Deletes all but the latest `kept` sessions of a user.
    async fn keep_sessions(&mut self, user: UserId, kept: u32) -> Result<(), StoreError>;
}

/// API tokens; errors as in [`super::Records`].
#[async_trait]
pub trait TokenRecords {
    /// Number of tokens, revoked ones included.
    async fn count_tokens(&mut self) -> Result<u32, StoreError>;

    /// Reads one token.
    async fn token(&mut self, id: TokenId) -> Result<Option<TokenRecord>, StoreError>;

    /// Finds the token of a name, upper or lower case, that is valid at `now`.
    async fn token_named(
        &mut self,
        name: &AccountName,
        now: WallTime,
    ) -> Result<Option<TokenRecord>, StoreError>;

    /// Adds a token, whose number in the record is ignored; returns the assigned one.
    async fn add_token(&mut self, token: &TokenRecord) -> Result<TokenId, StoreError>;

    /// Stores the time of a token's revocation.
    async fn save_token_revoked(
        &mut self,
        id: TokenId,
        revoked_ns: WallTime,
    ) -> Result<(), StoreError>;
}
