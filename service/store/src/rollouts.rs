//! Roll-outs in the store.

use fleetcal_rollout::RolloutState;

/// Filter of roll-outs.
#[derive(Debug, Clone, Default)]
pub struct RolloutFilter {
    /// State of the roll-outs.
    pub state: Option<RolloutState>,
    /// Number that the roll-outs come before.
    pub before: Option<i64>,
    /// Largest number of roll-outs.
    pub limit: u32,
}
