//! Robots' configurations and histories.

use async_trait::async_trait;
use fleetcal_domain::robot::RobotConfig;
use fleetcal_model::{EventId, RobotId, Version, WallTime};

use crate::error::StoreError;
use crate::record::{EventRecord, NewEvent, RobotRecord};

/// Robots' configurations and histories; errors as in [`super::Records`].
#[async_trait]
pub trait RobotRecords {
    /// Reads one robot; `None` if the store has no record of it.
    async fn robot(&mut self, id: &RobotId) -> Result<Option<RobotRecord>, StoreError>;

    /// Number of robots with a configuration.
    async fn count_configured(&mut self) -> Result<u32, StoreError>;

    /// Stores a robot's configuration as `version`, changed at `now`, with the author of its
    /// drawing.
    async fn save_config(
        &mut self,
        id: &RobotId,
        config: &RobotConfig,
        drawn_by: Option<&str>,
        version: Version,
        now: WallTime,
    ) -> Result<(), StoreError>;

    /// Reads an event by its number.
    async fn event(&mut self, id: EventId) -> Result<Option<EventRecord>, StoreError>;

    /// Adds an event to its robot's history; returns its number.
    async fn add_event(&mut self, event: &NewEvent) -> Result<EventId, StoreError>;
}
