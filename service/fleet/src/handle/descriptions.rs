//! Descriptions that robots publish of themselves, as the link and the API hold them.

use fleetcal_domain::limits::{DESCRIPTIONS_BYTES_MAX, DESCRIPTIONS_OF_UNREGISTERED_BYTES_MAX};
use fleetcal_proto::RobotId;

use super::FleetHandle;
use crate::descriptions::{ArrivedDescription, ReadDescription};

impl FleetHandle {
    /// Keeps a message of the description that a robot publishes of itself, or the reason for which
    /// it is refused. It never blocks: this runs on the link's receiving threads. An unknown robot
    /// becomes unregistered, if there is room.
    pub fn take_description<B: FnOnce() -> Vec<u8>>(
        &self,
        id: &RobotId,
        arrived: ArrivedDescription<B>,
    ) {
        let Some(robot) = self.fleet.find_or_admit(id) else {
            return;
        };
        let room = if robot.is_configured() {
            DESCRIPTIONS_BYTES_MAX
        } else {
            DESCRIPTIONS_OF_UNREGISTERED_BYTES_MAX
        };
        self.fleet.descriptions.keep(id, room, arrived);
    }

    /// Reads a robot's description of itself; `None` if it has published none.
    pub fn description(&self, id: &RobotId) -> Option<ReadDescription> {
        self.fleet.descriptions.read(id)
    }
}
