//! The approval policy: what the store is asked.

use crate::Store;
use crate::error::StoreError;
use crate::policy::StoredPolicy;

impl Store {
    /// The policy that was set.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn stored_policy(&self) -> Result<StoredPolicy, StoreError> {
        self.shared.reader.policy().await
    }
}
