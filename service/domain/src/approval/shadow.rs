//! Shadow of a robot: desired and reported calibration.

use fleetcal_model::{Generation, RevisionId, RobotTime, Version, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::AppliedStatus;
use serde::{Deserialize, Serialize};

use super::generation::{GenerationRef, InUse};
use super::values::Change;

/// The latest answer of a robot.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Reported {
    /// The generation it is about.
    pub generation: Generation,
    /// SHA-256 of the document.
    pub sha256: String,
    /// What became of it.
    pub status: AppliedStatus,
    /// Why, in the robot's words.
    pub reason: Option<String>,
    /// When, ns since 1970, by the robot's clock.
    pub at_ns: RobotTime,
    /// When the service learnt of it, ns since 1970, wall time.
    pub received_ns: WallTime,
    /// Whether the robot is told that its answer is stored.
    pub confirmed: bool,
}

/// Agreement between what a robot uses and what it should.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum SyncState {
    /// It uses what it should; where nothing is approved, its factory calibration.
    InSync,
    /// It uses another calibration than it should, or has not said that it uses that.
    OutOfSync,
    /// It uses a calibration, and should use none: the approval was taken back, or is not in these
    /// records.
    Unwanted,
}

/// That a robot is switched off on purpose.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Maintenance {
    /// Until when, ns since 1970, wall time.
    pub until_ns: WallTime,
    /// Who says so.
    pub by: String,
    /// Since when, ns since 1970, wall time.
    pub at_ns: WallTime,
    /// Why.
    pub reason: String,
}

impl Maintenance {
    /// Longest maintenance, ns: 90 days. A robot that is away for longer is asked for again.
    pub const LONGEST_NS: i64 = 90 * 86_400 * 1_000_000_000;

    /// Whether it has not ended by then.
    pub fn holds_at(&self, now: WallTime) -> bool {
        now < self.until_ns
    }
}

/// Desired and reported state of one robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Shadow {
    /// Whose.
    pub robot: RobotId,
    /// Goes up with every change of it.
    pub version: Version,
    /// The highest generation ever given out; none is used twice.
    pub generation_last: Generation,
    /// What the robot should hold; `None` before the first approval.
    pub desired: Option<GenerationRef>,
    /// What the robot last answered.
    pub reported: Option<Reported>,
    /// What the robot uses, as far as it has said.
    pub in_use: Option<InUse>,
    /// What it used before, to which it goes back by itself.
    pub before: Option<InUse>,
    /// Generations that were verified, oldest first.
    pub verified: Vec<GenerationRef>,
    /// The revision that was last rejected, withdrawn or rolled back: not proposed again.
    pub declined: Option<RevisionId>,
    /// That it is switched off on purpose; it may be over.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub maintenance: Option<Maintenance>,
    /// Sum of the steps, whichever way each went, that were approved without a person since a person
    /// last decided what the robot should use: rad, m, m, rad.
    #[serde(default, skip_serializing_if = "is_zero")]
    #[cfg_attr(feature = "openapi", schema(value_type = Vec<f64>))]
    pub automatic_sum: Change,
    /// The robot's answer that a later one of it contradicted; a person's decision ends it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contradicted: Option<Contradicted>,
}

/// Two answers in a robot's name that cannot both be its own.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Contradicted {
    /// The generation of the first.
    pub generation: Generation,
    /// What the first says: that it is in use, or that the robot did not take it.
    #[serde(default = "applied")]
    pub status: AppliedStatus,
    /// When the service learnt of that, ns since 1970, wall time.
    pub received_ns: WallTime,
    /// The generation of the answer that contradicts it.
    pub by_generation: Generation,
    /// What that answer says.
    pub by_status: AppliedStatus,
    /// When the service learnt of that, ns since 1970, wall time.
    pub at_ns: WallTime,
}

/// Records of before know of no other.
const fn applied() -> AppliedStatus {
    AppliedStatus::Applied
}

fn is_zero(sum: &Change) -> bool {
    sum.iter().all(|part| *part == 0.0)
}

impl Shadow {
    /// Verified generations that are remembered.
    pub const VERIFIED_MAX: usize = 8;

    /// A robot of which nothing is known.
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
            automatic_sum: [0.0; 4],
            contradicted: None,
        }
    }

    /// Whether the robot has said that it uses this generation.
    pub fn uses(&self, generation: Generation) -> bool {
        let in_use = self.in_use.as_ref();
        in_use.is_some_and(|in_use| in_use.generation == generation)
    }

    /// The approved generation that the robot uses although it should use none. Of one that these
    /// records do not know, the robot may not have said the values.
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

    /// Agreement between what the robot uses and what it should.
    pub fn sync(&self) -> SyncState {
        match &self.desired {
            Some(desired) if self.uses(desired.generation) => SyncState::InSync,
            Some(_) => SyncState::OutOfSync,
            None if self.unwanted().is_some() => SyncState::Unwanted,
            None => SyncState::InSync,
        }
    }

    /// Whether the robot holds what it should.
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
