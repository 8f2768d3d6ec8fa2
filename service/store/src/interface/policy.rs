//! The approval policy: what the store is asked.

use crate::Store;
use crate::command::Command;
use crate::error::StoreError;
use crate::policy::{PolicyWrite, StoredPolicy};

impl Store {
    /// Sets the policy.
    ///
    /// # Errors
    /// [`StoreError::Refused`] when it changed since it was looked at; otherwise the database's
    /// failure.
    pub async fn write_policy(&self, write: PolicyWrite) -> Result<StoredPolicy, StoreError> {
        self.ask(|reply| Command::Policy(Box::new(write), reply))
            .await
    }

    /// The policy that was set.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn stored_policy(&self) -> Result<StoredPolicy, StoreError> {
        self.shared.reader.policy().await
    }
}
