//! Set-up codes, with which the first administrator is created.

use async_trait::async_trait;
use fleetcal_domain::access::SetupCode;
use fleetcal_domain::limits;
use fleetcal_store::{Job, Records, StoreError};

/// Stores a code beside those of earlier starts, unless there is a user: a link works for its day,
/// whichever process printed it, and whichever was printed last.
#[derive(Debug, Clone, Copy)]
pub struct KeepSetupCode(pub SetupCode);

#[async_trait]
impl Job for KeepSetupCode {
    /// True if there is no user, and the code is valid.
    type Done = bool;

    async fn run(&self, records: &mut dyn Records) -> Result<bool, StoreError> {
        if records.count_users().await? > 0 {
            return Ok(false);
        }
        records
            .keep_setup_codes(limits::SETUP_CODES_MAX - 1)
            .await?;
        records.add_setup_code(&self.0).await?;
        Ok(true)
    }
}
