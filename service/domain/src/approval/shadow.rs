//! Shadow of a robot: desired and reported calibration.

use fleetcal_model::{Generation, RevisionId, RobotTime, Version, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::AppliedStatus;
use serde::{Deserialize, Serialize};

use super::generation::{GenerationRef, InUse};
use super::values::Change;

/// Latest answer of a robot.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Reported {
    /// Generation of the document.
    pub generation: Generation,
    /// SHA-256 of the document.
    pub sha256: String,
    /// Outcome at the robot.
    pub status: AppliedStatus,
    /// Reason that the robot gave.
    pub reason: Option<String>,
    /// Time of the outcome, ns since 1970, by the robot's clock.
    pub at_ns: RobotTime,
    /// Time at which the service received it, ns since 1970, wall time.
    pub received_ns: WallTime,
    /// True if the confirmation was sent to the robot.
    pub confirmed: bool,
}

/// Agreement between the calibration in use and the desired one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum SyncState {
    /// The robot uses the desired calibration; before any approval, its factory calibration.
    InSync,
    /// The robot uses another calibration than the desired one, or has not reported that it uses
    /// that.
    OutOfSync,
    /// The robot uses a calibration and should use none: the approval was withdrawn, or is missing
    /// in these records.
    Unwanted,
}

/// Maintenance: the robot is switched off on purpose.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Maintenance {
    /// End of the maintenance, ns since 1970, wall time.
    pub until_ns: WallTime,
    /// Person or tool that reported it.
    pub by: String,
    /// Begin of the maintenance, ns since 1970, wall time.
    pub at_ns: WallTime,
    /// Reason for the maintenance.
    pub reason: String,
}

impl Maintenance {
    /// Longest maintenance, ns: 90 days. A longer one has to be reported again.
    pub const LONGEST_NS: i64 = 90 * 86_400 * 1_000_000_000;

    /// True if it has not ended at `now`.
    pub fn holds_at(&self, now: WallTime) -> bool {
        now < self.until_ns
    }
}

/// Retirement: the robot has left the fleet. Its records stay, and its messages are refused.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Retirement {
    /// Person or tool that retired it.
    pub by: String,
    /// Time of the retirement, ns since 1970, wall time.
    pub at_ns: WallTime,
    /// Reason for the retirement.
    pub reason: String,
}

/// Desired and reported state of one robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Shadow {
    /// Robot of the shadow.
    pub robot: RobotId,
    /// Version, incremented with every change.
    pub version: Version,
    /// Highest generation ever assigned; none is used twice.
    pub generation_last: Generation,
    /// Desired calibration; `None` before the first approval.
    pub desired: Option<GenerationRef>,
    /// Latest answer of the robot.
    pub reported: Option<Reported>,
    /// Calibration in use, as the robot last reported it.
    pub in_use: Option<InUse>,
    /// Calibration in use before that one, to which the robot reverts by itself.
    pub before: Option<InUse>,
    /// Generations that were verified, oldest first.
    pub verified: Vec<GenerationRef>,
    /// Revision that was last rejected, withdrawn or rolled back; the service does not propose it
    /// again.
    pub declined: Option<RevisionId>,
    /// Last maintenance of the robot; it may have ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub maintenance: Option<Maintenance>,
    /// Retirement of the robot, until it is brought back.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub retired: Option<Retirement>,
    /// Sum of the magnitudes of the steps approved without a person since a person last decided on
    /// the desired calibration: rad, m, m, rad.
    #[serde(default, skip_serializing_if = "is_zero")]
    #[cfg_attr(feature = "openapi", schema(value_type = Vec<f64>))]
    pub automatic_sum: Change,
    /// Contradiction between two answers of the robot; a person's decision settles it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contradicted: Option<Contradicted>,
}

/// Contradiction of two answers in a robot's name, which cannot both be its own.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Contradicted {
    /// Generation of the first answer.
    pub generation: Generation,
    /// Outcome in the first answer: applied, refused or failed.
    #[serde(default = "applied")]
    pub status: AppliedStatus,
    /// Time at which the service received it, ns since 1970, wall time.
    pub received_ns: WallTime,
    /// Generation of the answer that contradicts it.
    pub by_generation: Generation,
    /// Outcome in that answer.
    pub by_status: AppliedStatus,
    /// Time at which the service received that answer, ns since 1970, wall time.
    pub at_ns: WallTime,
}

/// Default for records of older versions, which have no other status.
const fn applied() -> AppliedStatus {
    AppliedStatus::Applied
}

fn is_zero(sum: &Change) -> bool {
    sum.iter().all(|part| *part == 0.0)
}

impl Shadow {
    /// Most verified generations that are remembered.
    pub const VERIFIED_MAX: usize = 8;

    /// Shadow of a robot of which nothing is known.
    pub fn new(robot: RobotId) -> Self {
        Self {
            robot,
            version: Version(0),
            generation_last: Generation::FACTORY,
            desired: None,
            reported: None,
            in_use: None,
            before: None,
            verified: Vec::new(),
            declined: None,
            maintenance: None,
            retired: None,
            automatic_sum: [0.0; 4],
            contradicted: None,
        }
    }

    /// True if the robot has reported this generation as in use.
    pub fn uses(&self, generation: Generation) -> bool {
        let in_use = self.in_use.as_ref();
        in_use.is_some_and(|in_use| in_use.generation == generation)
    }

    /// Approved generation that the robot uses although it should use none. If these records do not
    /// know it, the robot may not have reported the values.
    pub fn unwanted(&self) -> Option<Generation> {
        if self.desired.is_some() {
            return None;
        }
        let reported = self.reported.as_ref();
        let reported = reported.filter(|last| last.status == AppliedStatus::Applied);
        let said = self.in_use.as_ref().map(|in_use| in_use.generation);
        let said = said.or(reported.map(|last| last.generation));
        said.filter(|generation| !generation.is_factory())
    }

    /// Agreement between the calibration in use and the desired one.
    pub fn sync(&self) -> SyncState {
        match &self.desired {
            Some(desired) if self.uses(desired.generation) => SyncState::InSync,
            Some(_) => SyncState::OutOfSync,
            None if self.unwanted().is_some() => SyncState::Unwanted,
            None => SyncState::InSync,
        }
    }

    /// True if the robot uses the desired calibration.
    pub fn in_sync(&self) -> bool {
        self.sync() == SyncState::InSync
    }
}

#[cfg(test)]
mod tests {
    use fleetcal_proto::calibration::CalibrationValues;

    use super::*;

    #[test]
    fn what_is_applied_and_not_wanted_is_a_state_of_its_own() {
        let shadow = |desired: Option<u64>, in_use: Option<u64>| Shadow {
            desired: desired.map(|generation| GenerationRef {
                generation: Generation(generation),
                sha256: String::new(),
                revision: RevisionId(1),
                chosen_by: None,
            }),
            in_use: in_use.map(|generation| InUse {
                generation: Generation(generation),
                revision: None,
                values: CalibrationValues::default(),
                since_ns: RobotTime(0),
            }),
            ..Shadow::new(RobotId::parse("tugger_01").unwrap())
        };
        for (desired, in_use, expected) in [
            (None, None, SyncState::InSync),
            (None, Some(0), SyncState::InSync),
            (None, Some(1), SyncState::Unwanted),
            (Some(2), Some(2), SyncState::InSync),
            (Some(2), Some(1), SyncState::OutOfSync),
            (Some(2), Some(0), SyncState::OutOfSync),
            (Some(2), None, SyncState::OutOfSync),
        ] {
            let shadow = shadow(desired, in_use);
            assert_eq!(shadow.sync(), expected, "{desired:?}, {in_use:?}");
            assert_eq!(shadow.in_sync(), expected == SyncState::InSync);
        }
        // It has said that it uses one, and not with which values.
        let mut unknown = shadow(None, None);
        for (generation, status, expected) in [
            (7, AppliedStatus::Applied, SyncState::Unwanted),
            (7, AppliedStatus::Reverted, SyncState::InSync),
            (0, AppliedStatus::Applied, SyncState::InSync),
        ] {
            unknown.reported = Some(Reported {
                generation: Generation(generation),
                sha256: String::new(),
                status,
                reason: None,
                at_ns: RobotTime(0),
                received_ns: WallTime(0),
                confirmed: false,
            });
            assert_eq!(unknown.sync(), expected, "{generation} {status:?}");
        }
    }
}
