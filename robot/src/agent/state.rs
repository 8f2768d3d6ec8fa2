//! Memory of an agent, kept through restarts.

use fleetcal_model::{Generation, Pose2, RobotTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::{Applied, AppliedStatus, CalibrationValues};
use serde::{Deserialize, Serialize};

/// What the robot compensates with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Held {
    /// Generation of the document; 0 for its factory calibration.
    pub generation: Generation,
    /// SHA-256 of the document; empty for its factory calibration.
    pub sha256: String,
    /// Since when, ns since 1970 by the robot's clock.
    pub applied_at_ns: RobotTime,
    /// The values; `None` when the robot brought none along that could be read.
    pub values: Option<CalibrationValues>,
    /// Where the document has the rear axle in `base_link`, if it says so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rear_axle_in_base_link: Option<Pose2>,
}

impl Held {
    /// What a robot has that never heard of a service.
    pub fn factory(values: Option<CalibrationValues>, now: RobotTime) -> Self {
        Self {
            generation: Generation::FACTORY,
            sha256: String::new(),
            applied_at_ns: now,
            values,
            rear_axle_in_base_link: None,
        }
    }

    /// Whether it is this document.
    pub fn is(&self, generation: Generation, sha256: &str) -> bool {
        self.generation == generation && self.sha256 == sha256
    }

    /// Its acknowledgement; `None` when there is nothing to say.
    pub fn acknowledgement(&self) -> Option<Applied> {
        if self.generation.is_factory() && self.values.is_none() {
            return None;
        }
        Some(Applied {
            generation: self.generation,
            sha256: self.sha256.clone(),
            status: AppliedStatus::Applied,
            reason: None,
            applied_at_ns: self.applied_at_ns,
            values: self.values,
        })
    }
}

/// Where a robot goes back to when nobody confirms.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fallback {
    /// What it held then.
    pub held: Held,
    /// What its file said then, byte for byte; `None` when there was none.
    pub file: Option<String>,
}

/// A document that passed every check.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Offer {
    /// Its generation.
    pub generation: Generation,
    /// Its SHA-256.
    pub sha256: String,
    /// When it may no longer come into use, ns since 1970 by the robot's clock. It came later: what an
    /// agent of before remembers is asked for again.
    #[serde(default)]
    pub ends_ns: RobotTime,
    /// How long the robot waits for its confirmation, s.
    pub confirm_within_s: u32,
    /// What to compensate with.
    pub values: CalibrationValues,
    /// Where the document has the rear axle in `base_link`, if it says so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rear_axle_in_base_link: Option<Pose2>,
    /// Its exact text, for the hook.
    pub document: String,
}

/// Values that are in use and may yet have to go.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// When the robot goes back by itself, ns since 1970.
    pub until_ns: RobotTime,
    /// What the deadline was made from, s.
    pub confirm_within_s: u32,
    /// Whether a restart has put the deadline off already.
    pub put_off: bool,
    /// The document's text, for the hook.
    pub document: String,
    /// Where to go back to: what was confirmed last.
    pub fallback: Fallback,
}

/// How firmly the robot holds what it holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(
    clippy::large_enum_variant,
    reason = "an agent has one, which is seldom moved"
)]
pub enum Rest {
    /// For good.
    Settled,
    /// Until the deadline, unless it is confirmed.
    Unconfirmed(Trial),
}

/// How a way back ends.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ending {
    /// Generation of the document that goes.
    pub generation: Generation,
    /// Its SHA-256.
    pub sha256: String,
    /// What the service is told.
    pub outcome: Outcome,
    /// The document's text, for the hook.
    pub document: String,
}

/// What becomes of a document whose values go.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// It was decided upon.
    Answered {
        /// `Reverted`, or `Failed` when it never came into use.
        status: AppliedStatus,
        /// Why, for people.
        reason: String,
    },
    /// The robot is busy: it is asked again later, and the service is told nothing.
    Later,
}

/// What the agent is about.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// Nothing.
    Resting(Rest),
    /// The hook was asked whether a document may be applied.
    Asking {
        /// The document.
        offer: Offer,
        /// What stands meanwhile.
        rest: Rest,
    },
    /// The values are being written.
    Writing {
        /// The document.
        offer: Offer,
        /// What stood before.
        rest: Rest,
        /// What the file said before.
        before: Option<String>,
    },
    /// The values are written, and the hook is told.
    Activating {
        /// The document.
        offer: Offer,
        /// What stood before.
        rest: Rest,
        /// What the file said before.
        before: Option<String>,
    },
    /// The former values are being written back, and the hook is told.
    Restoring {
        /// Which.
        fallback: Fallback,
        /// How firmly they stand then.
        rest: Rest,
        /// What is said when they stand.
        ending: Ending,
    },
}

impl Phase {
    /// How firmly stands what the robot holds, now or when this is over.
    pub(super) fn rest_mut(&mut self) -> &mut Rest {
        match self {
            Self::Resting(rest)
            | Self::Asking { rest, .. }
            | Self::Writing { rest, .. }
            | Self::Activating { rest, .. }
            | Self::Restoring { rest, .. } => rest,
        }
    }

    /// Its name, for people.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Resting(Rest::Settled) => "settled",
            Self::Resting(Rest::Unconfirmed(_)) => "unconfirmed",
            Self::Asking { .. } => "asking",
            Self::Writing { .. } => "writing",
            Self::Activating { .. } => "activating",
            Self::Restoring { .. } => "restoring",
        }
    }
}

/// The form of a written memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum MemorySchema {
    /// The first.
    #[default]
    #[serde(rename = "fleetcal.agent/1")]
    V1,
}

/// All that an agent remembers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Memory {
    /// Its form.
    pub schema: MemorySchema,
    /// Whose it is.
    pub robot: RobotId,
    /// What the robot holds.
    pub held: Held,
    /// What it is about.
    pub phase: Phase,
    /// Highest generation that was decided upon, whatever became of it: what comes later must be
    /// higher, or a withdrawn document could be played again.
    pub highest: Generation,
    /// What was answered last on a signed document.
    pub latest: Option<Applied>,
    /// Answers that nobody has confirmed yet, oldest first.
    pub unstored: Vec<Applied>,
}

impl Memory {
    /// Where the rear axle is in `base_link`, by the document whose values are in use or about to
    /// be.
    pub(super) fn rear_axle_in_base_link(&self) -> Option<Pose2> {
        match &self.phase {
            Phase::Writing { offer, .. } | Phase::Activating { offer, .. } => {
                offer.rear_axle_in_base_link
            }
            Phase::Restoring { fallback, .. } => fallback.held.rear_axle_in_base_link,
            Phase::Resting(_) | Phase::Asking { .. } => self.held.rear_axle_in_base_link,
        }
    }

    /// That of an agent which starts for the first time.
    pub fn new(robot: RobotId, held: Held) -> Self {
        Self {
            schema: MemorySchema::V1,
            robot,
            held,
            phase: Phase::Resting(Rest::Settled),
            highest: Generation::FACTORY,
            latest: None,
            unstored: Vec::new(),
        }
    }
}
