//! What a robot should use, and what it reported.

use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::{AppliedStatus, CalibrationValues};
use serde::{Deserialize, Serialize};

use super::deployment::GenerationRef;

/// Values that a robot compensates with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct InUse {
    /// Generation of the document; 0 for what the robot brought along.
    pub generation: u64,
    /// The revision; `None` for what the robot brought along.
    pub revision: Option<u64>,
    /// The values.
    pub values: CalibrationValues,
    /// Since when, ns since 1970, by the robot's clock.
    pub since_ns: i64,
}

/// The latest answer of a robot.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Reported {
    /// The generation it is about.
    pub generation: u64,
    /// SHA-256 of the document.
    pub sha256: String,
    /// What became of it.
    pub status: AppliedStatus,
    /// Why, in the robot's words.
    pub reason: Option<String>,
    /// When, ns since 1970, by the robot's clock.
    pub at_ns: i64,
    /// When the service learnt of it, ns since 1970, wall time.
    pub received_ns: i64,
    /// Whether the robot is told that its answer is stored.
    pub confirmed: bool,
}

/// Desired and reported state of one robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Shadow {
    /// Whose.
    pub robot: RobotId,
    /// Goes up with every change of it.
    pub version: u64,
    /// The highest generation ever given out; none is used twice.
    pub generation_last: u64,
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
    pub declined: Option<u64>,
}

impl Shadow {
    /// Verified generations that are remembered.
    pub const VERIFIED_MAX: usize = 8;

    /// A robot of which nothing is known.
    pub fn new(robot: RobotId) -> Self {
        Self {
            robot,
            version: 0,
            generation_last: 0,
            desired: None,
            reported: None,
            in_use: None,
            before: None,
            verified: Vec::new(),
            declined: None,
        }
    }

    /// Whether the robot has said that it uses this generation.
    pub fn uses(&self, generation: u64) -> bool {
        let in_use = self.in_use.as_ref();
        in_use.is_some_and(|in_use| in_use.generation == generation)
    }

    /// Whether the robot holds what it should.
    pub fn in_sync(&self) -> bool {
        match (&self.desired, &self.in_use) {
            (None, _) => true,
            (Some(desired), Some(in_use)) => desired.generation == in_use.generation,
            (Some(_), None) => false,
        }
    }
}
