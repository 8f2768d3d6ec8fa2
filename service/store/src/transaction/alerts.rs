//! Alerts and how they went.

use async_trait::async_trait;
use fleetcal_domain::alert::{Alert, AlertKind, Subject};
use fleetcal_model::AlertId;

use crate::alerts::AlertMoment;
use crate::error::StoreError;

/// Alerts; errors as in [`super::Records`].
#[async_trait]
pub trait AlertRecords {
    /// The alert of this kind that is not over.
    async fn active_alert(
        &mut self,
        subject: &Subject,
        kind: AlertKind,
    ) -> Result<Option<Alert>, StoreError>;

    /// One alert.
    async fn alert(&mut self, id: AlertId) -> Result<Option<Alert>, StoreError>;

    /// Adds an alert; gives its number, which was never used before.
    async fn add_alert(&mut self, alert: &Alert) -> Result<AlertId, StoreError>;

    /// Keeps an alert that is there.
    async fn save_alert(&mut self, alert: &Alert) -> Result<(), StoreError>;

    /// Deletes an alert with its history.
    async fn delete_alert(&mut self, id: AlertId) -> Result<(), StoreError>;

    /// Adds a change to an alert's history, of which the latest `kept` stay.
    async fn add_alert_moment(
        &mut self,
        id: AlertId,
        moment: &AlertMoment,
        kept: u32,
    ) -> Result<(), StoreError>;
}
