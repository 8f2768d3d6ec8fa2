//! Requests for roll-outs.

use fleetcal_model::RolloutId;
use fleetcal_rollout::{Followed, Rollout};

use crate::Store;
use crate::error::StoreError;
use crate::rollouts::RolloutFilter;

impl Store {
    /// Roll-outs, newest first.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn rollouts(&self, filter: &RolloutFilter) -> Result<Vec<Rollout>, StoreError> {
        self.shared.reader.rollouts(filter).await
    }

    /// Reads one roll-out.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn rollout(&self, id: RolloutId) -> Result<Option<Rollout>, StoreError> {
        self.shared.reader.rollout(id).await
    }

    /// Robots of a roll-out with the present states of their proposals, by wave and id.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn rollout_robots(&self, id: RolloutId) -> Result<Vec<Followed>, StoreError> {
        self.shared.reader.rollout_robots(id).await
    }
}
