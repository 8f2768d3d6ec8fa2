//! Robots' configurations and histories.

use async_trait::async_trait;
use fleetcal_domain::robot::RobotConfig;
use fleetcal_model::{EventId, RobotId, Version, WallTime};

use crate::error::StoreError;
use crate::record::{EventRecord, NewEvent, RobotRecord};

/// Robots' configurations and histories; errors as in [`super::Records`].
#[async_trait]
pub trait RobotRecords {
    /// One robot; `None` when the store has never heard of it.
    async fn robot(&mut self, id: &RobotId) -> Result<Option<RobotRecord>, StoreError>;

    /// Keeps a robot's configuration as `version`, changed at `now`, with who gave its drawing.
    async fn save_config(
        &mut self,
        id: &RobotId,
        config: &RobotConfig,
        drawn_by: Option<&str>,
        version: Version,
        now: WallTime,
    ) -> Result<(), StoreError>;

    /// An event by its number.
    async fn event(&mut self, id: EventId) -> Result<Option<EventRecord>, StoreError>;

    /// Adds an event to its robot's history; gives its number.
    async fn add_event(&mut self, event: &NewEvent) -> Result<EventId, StoreError>;
}
