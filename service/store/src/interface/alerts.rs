//! Requests for alerts.

use fleetcal_domain::alert::{Alert, StoredAlert};
use fleetcal_model::AlertId;

use crate::Store;
use crate::alerts::{AlertFilter, AlertMoment};
use crate::error::StoreError;

impl Store {
    /// Every alert that has not ended, except those that only a newer version knows.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn active_alerts(&self) -> Result<Vec<Alert>, StoreError> {
        self.shared.reader.active_alerts().await
    }

    /// Alerts, the most urgent first, the newest first among equals.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn alerts(&self, filter: &AlertFilter) -> Result<Vec<StoredAlert>, StoreError> {
        self.shared.reader.alerts(filter).await
    }

    /// Reads an alert with its changes, oldest first.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn alert(
        &self,
        id: AlertId,
    ) -> Result<Option<(StoredAlert, Vec<AlertMoment>)>, StoreError> {
        self.shared.reader.alert(id).await
    }
}
