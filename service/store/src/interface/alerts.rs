//! Alerts: what the store is asked.

use fleetcal_domain::alert::Alert;

use crate::Store;
use crate::alerts::{AlertChange, AlertFilter, AlertMoment, AlertWrite};
use crate::command::Command;
use crate::error::StoreError;

impl Store {
    /// Changes alerts and waits until all of it is committed, with what is told of it.
    ///
    /// # Errors
    /// [`StoreError::Alert`] when an acknowledgement is refused; otherwise the database's failure.
    pub async fn write_alerts(&self, write: AlertWrite) -> Result<Vec<AlertChange>, StoreError> {
        self.ask(|reply| Command::Alerts(Box::new(write), reply))
            .await
    }

    /// Every alert that is not over.
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
    pub async fn alerts(&self, filter: &AlertFilter) -> Result<Vec<Alert>, StoreError> {
        self.shared.reader.alerts(filter).await
    }

    /// One alert with how it went, oldest change first.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn alert(&self, id: u64) -> Result<Option<(Alert, Vec<AlertMoment>)>, StoreError> {
        self.shared.reader.alert(id).await
    }
}
