//! Requests for the approval policy.

use crate::Store;
use crate::error::StoreError;
use crate::policy::StoredPolicy;

impl Store {
    /// Reads the stored policy.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn stored_policy(&self) -> Result<StoredPolicy, StoreError> {
        self.shared.reader.policy().await
    }
}
