//! Retired robots, as the lifecycle sets them.

use fleetcal_proto::RobotId;

use super::FleetHandle;

impl FleetHandle {
    /// Sets the retirement of a robot: its messages are refused and counted until it is brought
    /// back.
    pub fn set_retired(&self, id: &RobotId, retired: bool) {
        if let Some(robot) = self.fleet.find(id.as_str()) {
            robot.set_retired(retired);
        }
    }
}
