//! Alerts and their changes.

use async_trait::async_trait;
use fleetcal_domain::alert::{Alert, AlertKind, StoredAlert, Subject};
use fleetcal_model::AlertId;

use crate::alerts::AlertMoment;
use crate::error::StoreError;

/// Alerts; errors as in [`super::Records`].
#[async_trait]
pub trait AlertRecords {
    /// Active alert of this kind: one that has not ended.
    async fn active_alert(
        &mut self,
        subject: &Subject,
        kind: AlertKind,
    ) -> Result<Option<StoredAlert>, StoreError>;

    /// Reads one alert.
    async fn alert(&mut self, id: AlertId) -> Result<Option<StoredAlert>, StoreError>;

    /// Adds an alert; returns its number, which was never used before.
    async fn add_alert(&mut self, alert: &Alert) -> Result<AlertId, StoreError>;

    /// Updates an existing alert.
    async fn save_alert(&mut self, alert: &Alert) -> Result<(), StoreError>;

    /// Deletes an alert with its history.
    async fn delete_alert(&mut self, id: AlertId) -> Result<(), StoreError>;

    /// Adds a change to an alert's history, of which the latest `kept` remain.
    async fn add_alert_moment(
        &mut self,
        id: AlertId,
        moment: &AlertMoment,
        kept: u32,
    ) -> Result<(), StoreError>;
}
