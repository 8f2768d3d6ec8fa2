//! Calibration that a robot compensates with.

use fleetcal_estimator::RobotTime;
use fleetcal_model::Generation;

use crate::cross_track::UsedValues;

/// Values that a robot compensates with, and from which of its messages on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct InForce {
    /// The values.
    pub used: UsedValues,
    /// From this stamp on, ns since 1970 by the clock of its messages.
    pub from_stamp: RobotTime,
}

impl InForce {
    /// As the agent says it, until its answer has come up among the messages.
    pub const fn as_told(used: UsedValues) -> Self {
        Self {
            used,
            from_stamp: used.since,
        }
    }
}

/// What a robot compensates with, as far as it has said.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Used {
    /// Values, oldest first.
    pub values: Vec<InForce>,
    /// The generation to be verified, and since when it is in use by the agent's clock.
    pub in_verification: Option<(Generation, RobotTime)>,
    /// Answers that have not come up among the messages yet.
    pub unheard: u32,
}

impl Used {
    /// What the robot says now; of what it said before, the stamps are known. `true` when that is
    /// something new.
    pub fn follow(
        &mut self,
        values: &[UsedValues],
        in_verification: Option<(Generation, RobotTime)>,
    ) -> bool {
        let known = |used: &UsedValues| {
            let mut known = self.values.iter();
            let known = known.find(|known| known.used == *used).copied();
            known.unwrap_or(InForce::as_told(*used))
        };
        let values: Vec<InForce> = values.iter().map(known).collect();
        let latest = |values: &[InForce]| values.last().map(|latest| latest.used);
        let is_new =
            latest(&values) != latest(&self.values) || in_verification != self.in_verification;
        self.values = values;
        self.in_verification = in_verification;
        is_new
    }
}
