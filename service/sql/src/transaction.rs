//! The records of one transaction, as a job gets them.

use fleetcal_model::{RobotId, WallTime};
use fleetcal_store::StoreError;

use super::connection::Connection;
use super::row::{Keys, key_of};

/// The records of one transaction. What kinds there are stands in a file for each.
pub struct SqlRecords<'t> {
    /// Of the transaction.
    pub connection: &'t mut dyn Connection,
    /// Keys of robots that are known already.
    pub keys: &'t mut Keys,
    /// Robots whose keys this job has learnt: they go with what it wrote.
    pub learnt: &'t mut Vec<RobotId>,
}

impl SqlRecords<'_> {
    /// The robot's key; makes a row without configuration for one that is new.
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
