//! Data of a robot for those who record it: from now on, and the latest of before.

use std::sync::atomic::Ordering;

use fleetcal_domain::limits;
use fleetcal_model::Innovation;
use fleetcal_proto::RobotId;

use super::{FleetHandle, FleetRefused};
use crate::ring::Held;
use crate::tap::TapReader;

impl FleetHandle {
    /// Opens a reader of the robot's session from now on.
    ///
    /// # Errors
    /// The robot is unknown, unregistered and so without an estimator, or estimated by another
    /// instance.
    pub fn tap(&self, id: &RobotId) -> Result<TapReader, FleetRefused> {
        let unknown = || FleetRefused::UnknownRobot(id.clone());
        let robot = self.fleet.find(id.as_str()).ok_or_else(unknown)?;
        if !robot.is_configured() {
            return Err(FleetRefused::Unregistered(id.clone()));
        }
        if !robot.is_here() {
            return Err(FleetRefused::Elsewhere(id.clone()));
        }
        Ok(robot.taps.open())
    }

    /// Returns the robot's latest data from memory; empty where another instance estimates it.
    ///
    /// # Errors
    /// The robot is unknown.
    pub fn latest_data(&self, id: &RobotId) -> Result<Held, FleetRefused> {
        let unknown = || FleetRefused::UnknownRobot(id.clone());
        let robot = self.fleet.find(id.as_str()).ok_or_else(unknown)?;
        Ok(robot.taps.ring.held())
    }

    /// Returns the robot's latest innovations, oldest first; none where another instance estimates it.
    ///
    /// # Errors
    /// The robot is unknown.
    pub fn innovations(&self, id: &RobotId) -> Result<Vec<Innovation>, FleetRefused> {
        let unknown = || FleetRefused::UnknownRobot(id.clone());
        let robot = self.fleet.find(id.as_str()).ok_or_else(unknown)?;
        Ok(robot.innovations())
    }

    /// Limits the memory for the latest data of all robots to a part of what the process may use,
    /// bytes.
    pub fn limit_latest_data(&self, process_bytes: u64) {
        let part = process_bytes / limits::MOMENT_MEMORY_PARTS;
        let part = usize::try_from(part).unwrap_or(usize::MAX);
        let most = part.min(limits::MOMENT_BYTES_MAX);
        self.fleet
            .latest_data_bytes_max
            .store(most, Ordering::Relaxed);
    }

    /// Returns the memory that the latest data of all robots take, bytes.
    pub fn latest_data_bytes(&self) -> usize {
        let robots = self.fleet.all();
        robots.iter().map(|robot| robot.taps.ring.size()).sum()
    }
}
