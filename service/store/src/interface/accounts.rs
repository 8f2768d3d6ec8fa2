//! Requests for users, sessions and API tokens.

use fleetcal_domain::access::{SecretHash, SetupCode};
use fleetcal_model::UserId;

use crate::Store;
use crate::accounts::{Credential, CredentialUse, SessionRecord, TokenRecord, UserRecord};
use crate::error::StoreError;
use crate::telemetry::Telemetry;

impl Store {
    /// Records the use of a session or token. Never waits.
    pub fn note_use(&self, credential: Credential) {
        let now = self.shared.clock.now();
        self.offer(Telemetry::Use(CredentialUse { credential, now }));
    }

    /// Users after number `after`, at most `limit`.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn users(&self, after: i64, limit: u32) -> Result<Vec<UserRecord>, StoreError> {
        self.shared.reader.users(after, limit).await
    }

    /// True if there is any user.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn has_users(&self) -> Result<bool, StoreError> {
        Ok(!self.shared.reader.users(0, 1).await?.is_empty())
    }

    /// Reads one user.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn user(&self, id: UserId) -> Result<Option<UserRecord>, StoreError> {
        self.shared.reader.user(id).await
    }

    /// Finds the user of a name, upper or lower case.
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

    /// Finds the token of a value, valid or not.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn token_of(&self, hash: SecretHash) -> Result<Option<TokenRecord>, StoreError> {
        self.shared.reader.token_of(hash).await
    }

    /// Finds the session of a cookie, valid or not; disabled users have none.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn session_of(&self, hash: SecretHash) -> Result<Option<SessionRecord>, StoreError> {
        self.shared.reader.session_of(hash).await
    }

    /// Finds the set-up code of a text, valid or not, with which the first administrator is
    /// created.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn setup_code(&self, hash: SecretHash) -> Result<Option<SetupCode>, StoreError> {
        self.shared.reader.setup_code(hash).await
    }
}
