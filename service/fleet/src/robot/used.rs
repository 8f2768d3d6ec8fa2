//! Calibration that a robot compensates with.

use fleetcal_estimator::RobotTime;
use fleetcal_model::Generation;

use crate::cross_track::UsedValues;

/// Values that a robot compensates with, and the first of its messages that they apply to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct InForce {
    /// The values.
    pub used: UsedValues,
    /// Stamp of that message, ns since 1970 by the clock of its messages.
    pub from_stamp: RobotTime,
}

impl InForce {
    /// Dates the values by the agent's clock, until its report has come up among the messages.
    pub const fn as_told(used: UsedValues) -> Self {
        Self {
            used,
            from_stamp: used.since,
        }
    }
}

/// Values that a robot compensates with, as far as it has reported them.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Used {
    /// Values, oldest first.
    pub values: Vec<InForce>,
    /// Generation in verification, and the start of its use by the agent's clock.
    pub in_verification: Option<(Generation, RobotTime)>,
    /// Reports that have not come up among the messages yet.
    pub unheard: u32,
}

impl Used {
    /// Applies the robot's new report and keeps the known stamps of earlier values. Returns `true`
    /// if the report changes anything.
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
