//! The records of one transaction, as a job gets them.

use fleetcal_model::{RobotId, WallTime};
use fleetcal_store::StoreError;
use sqlx::sqlite::SqliteConnection;

use super::row::{Keys, key_of};

/// The records of one transaction. What kinds there are stands in a file for each.
#[derive(Debug)]
pub(super) struct SqliteRecords<'t> {
    pub(super) connection: &'t mut SqliteConnection,
    pub(super) keys: &'t mut Keys,
    /// Robots whose keys this job has learnt: they go with what it wrote.
    pub(super) learnt: &'t mut Vec<RobotId>,
}

impl SqliteRecords<'_> {
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
