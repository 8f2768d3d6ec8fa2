//! Records of roll-outs.

use async_trait::async_trait;
use fleetcal_model::{RobotId, RolloutId};
use fleetcal_rollout::{Followed, Member, Rollout};

use crate::error::StoreError;

/// Records of roll-outs; errors as in [`super::Records`].
#[async_trait]
pub trait RolloutRecords {
    /// Number of the next roll-out.
    async fn next_rollout(&mut self) -> Result<RolloutId, StoreError>;

    /// Reads one roll-out.
    async fn rollout(&mut self, id: RolloutId) -> Result<Option<Rollout>, StoreError>;

    /// Stores a roll-out, a new one or in place of its former version.
    async fn save_rollout(&mut self, rollout: &Rollout) -> Result<(), StoreError>;

    /// Adds the robots of a new roll-out.
    async fn add_rollout_robots(
        &mut self,
        id: RolloutId,
        members: &[Member],
    ) -> Result<(), StoreError>;

    /// Number of the other roll-outs that run or are paused.
    async fn rollouts_beside(&mut self, id: RolloutId) -> Result<u32, StoreError>;

    /// Another roll-out, running or paused, that has a proposal of this one too, with its robot.
    async fn rollout_taken(
        &mut self,
        id: RolloutId,
    ) -> Result<Option<(RolloutId, RobotId)>, StoreError>;

    /// Robots of a roll-out with the present states of their proposals, by wave and id.
    async fn rollout_robots(&mut self, id: RolloutId) -> Result<Vec<Followed>, StoreError>;
}
