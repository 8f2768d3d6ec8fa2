//! The codes by which the first administrator is made.

use async_trait::async_trait;
use fleetcal_domain::access::SetupCode;
use fleetcal_domain::limits;
use fleetcal_store::{Job, Records, StoreError};

/// Keeps a code beside those of earlier starts, unless there is a user: whichever was printed last,
/// and by whichever process, a link works for its day.
#[derive(Debug, Clone, Copy)]
pub struct KeepSetupCode(pub SetupCode);

#[async_trait]
impl Job for KeepSetupCode {
    /// Whether there is no user, and the code counts.
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
