//! The records of one transaction, as a job gets them.

use fleetcal_model::{RobotId, WallTime};
use fleetcal_store::StoreError;

use super::connection::Connection;
use super::row::{Keys, key_of};

/// Records of one transaction; each kind has a file.
pub struct SqlRecords<'t> {
    /// Connection of the transaction.
    pub connection: &'t mut dyn Connection,
    /// Known keys of robots.
    pub keys: &'t mut Keys,
    /// Robots whose keys this job has learnt: they are forgotten if its writes are undone.
    pub learnt: &'t mut Vec<RobotId>,
}

impl SqlRecords<'_> {
    /// Returns the robot's key; makes a row without configuration for a new robot.
    pub(super) async fn key_of(
        &mut self,
        robot: &RobotId,
        now: WallTime,
    ) -> Result<i64, StoreError> {
        if !self.keys.contains_key(robot) {
            self.learnt.push(robot.clone());
        }
        key_of(self.connection, self.keys, robot, now).await
    }
}
