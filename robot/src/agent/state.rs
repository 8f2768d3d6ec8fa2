//! Memory of an agent, kept through restarts.

use fleetcal_model::{Generation, Pose2, RobotTime, SteeringTable};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::{Applied, AppliedStatus, CalibrationValues};
use serde::{Deserialize, Serialize};

use super::keys::KeyRing;

/// Parts of a document beside its values.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct BesideValues<'a> {
    /// Its generation.
    pub generation: Generation,
    /// Pose of the rear axle in `base_link`, if present.
    pub rear_axle_in_base_link: Option<Pose2>,
    /// Curve of the steering, if present.
    pub steering_table: Option<&'a SteeringTable>,
}

/// Calibration that the robot compensates with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Held {
    /// Generation of the document; 0 for the factory calibration.
    pub generation: Generation,
    /// SHA-256 of the document; empty for the factory calibration.
    pub sha256: String,
    /// Start of its use, ns since 1970 by the robot's clock.
    pub applied_at_ns: RobotTime,
    /// The values; `None` if the robot's own file could not be read.
    pub values: Option<CalibrationValues>,
    /// Pose of the rear axle in `base_link` in the document, if present.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rear_axle_in_base_link: Option<Pose2>,
    /// Curve of the steering in the document, if present.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steering_table: Option<SteeringTable>,
}

impl Held {
    /// Makes the state of a robot that never had a service.
    pub fn factory(values: Option<CalibrationValues>, now: RobotTime) -> Self {
        Self {
            generation: Generation::FACTORY,
            sha256: String::new(),
            applied_at_ns: now,
            values,
            rear_axle_in_base_link: None,
            steering_table: None,
        }
    }

    fn beside_values(&self) -> BesideValues<'_> {
        BesideValues {
            generation: self.generation,
            rear_axle_in_base_link: self.rear_axle_in_base_link,
            steering_table: self.steering_table.as_ref(),
        }
    }

    /// True if it is this document.
    pub fn is(&self, generation: Generation, sha256: &str) -> bool {
        self.generation == generation && self.sha256 == sha256
    }

    /// Returns its acknowledgement; `None` if there is nothing to acknowledge.
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

/// State that a robot returns to without a confirmation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fallback {
    /// Calibration that it held then.
    pub held: Held,
    /// Content of its file then, byte for byte; `None` without a file.
    pub file: Option<String>,
}

/// A document that passed every check.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Offer {
    /// Its generation.
    pub generation: Generation,
    /// Its SHA-256.
    pub sha256: String,
    /// End of the offer, ns since 1970 by the robot's clock. It was added later: a document in an
    /// older agent's memory is queried again.
    #[serde(default)]
    pub ends_ns: RobotTime,
    /// Time within which the robot needs a confirmation, s.
    pub confirm_within_s: u32,
    /// Values to compensate with.
    pub values: CalibrationValues,
    /// Pose of the rear axle in `base_link` in the document, if present.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rear_axle_in_base_link: Option<Pose2>,
    /// Curve of the steering in the document, if present.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steering_table: Option<SteeringTable>,
    /// Its exact text, for the hook.
    pub document: String,
}

/// Values that are in use and unconfirmed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// Deadline at which the robot reverts by itself, ns since 1970.
    pub until_ns: RobotTime,
    /// Time that the deadline was made from, s.
    pub confirm_within_s: u32,
    /// True if a restart has extended the deadline already.
    pub put_off: bool,
    /// The document's text, for the hook.
    pub document: String,
    /// State to return to, which was confirmed last.
    pub fallback: Fallback,
}

/// Commitment of the robot to its present calibration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(
    clippy::large_enum_variant,
    reason = "an agent has one, which is seldom moved"
)]
pub enum Rest {
    /// Settled.
    Settled,
    /// Unconfirmed: it lasts until the deadline, unless it is confirmed.
    Unconfirmed(Trial),
}

/// Conclusion of a reversion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ending {
    /// Generation of the withdrawn document.
    pub generation: Generation,
    /// Its SHA-256.
    pub sha256: String,
    /// Report to the service.
    pub outcome: Outcome,
    /// The document's text, for the hook.
    pub document: String,
}

/// Outcome of a document whose values are withdrawn.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Decided.
    Answered {
        /// `Reverted`, or `Failed` when it never came into use.
        status: AppliedStatus,
        /// Reason, for people.
        reason: String,
    },
    /// The robot is busy: it is queried again later, and the service receives no report.
    Later,
}

/// Activity of the agent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// Idle.
    Resting(Rest),
    /// The hook is being queried whether a document may be applied.
    Asking {
        /// The document.
        offer: Offer,
        /// Present commitment.
        rest: Rest,
    },
    /// The values are being written.
    Writing {
        /// The document.
        offer: Offer,
        /// Former commitment.
        rest: Rest,
        /// Former content of the file.
        before: Option<String>,
    },
    /// The values are written, and the hook is being notified.
    Activating {
        /// The document.
        offer: Offer,
        /// Former commitment.
        rest: Rest,
        /// Former content of the file.
        before: Option<String>,
    },
    /// The former values are being written back, and the hook is being notified.
    Restoring {
        /// State to restore.
        fallback: Fallback,
        /// Commitment to them afterwards.
        rest: Rest,
        /// Conclusion once they are restored.
        ending: Ending,
    },
}

impl Phase {
    /// Returns the commitment to the held calibration, now or when this phase is over.
    pub(super) fn rest_mut(&mut self) -> &mut Rest {
        match self {
            Self::Resting(rest)
            | Self::Asking { rest, .. }
            | Self::Writing { rest, .. }
            | Self::Activating { rest, .. }
            | Self::Restoring { rest, .. } => rest,
        }
    }

    /// Returns its name, for people.
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

/// Schema of a stored memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum MemorySchema {
    /// The first version.
    #[default]
    #[serde(rename = "fleetcal.agent/1")]
    V1,
}

/// Memory of an agent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Memory {
    /// Schema of the memory.
    pub schema: MemorySchema,
    /// Id of the robot.
    pub robot: RobotId,
    /// Calibration that the robot holds.
    pub held: Held,
    /// Activity of the agent.
    pub phase: Phase,
    /// Highest generation that was decided, whatever its outcome: later ones must be higher, or a
    /// withdrawn document could be replayed.
    pub highest: Generation,
    /// Last acknowledgement of a signed document.
    pub latest: Option<Applied>,
    /// Unconfirmed acknowledgements, oldest first.
    pub unstored: Vec<Applied>,
    /// Keys that it trusts, once it has taken a change of the service's key over.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub keys: Option<KeyRing>,
}

impl Memory {
    /// Returns the parts beside the values of the document whose values are in use or about to be.
    pub(super) fn beside_values(&self) -> BesideValues<'_> {
        match &self.phase {
            Phase::Writing { offer, .. } | Phase::Activating { offer, .. } => BesideValues {
                generation: offer.generation,
                rear_axle_in_base_link: offer.rear_axle_in_base_link,
                steering_table: offer.steering_table.as_ref(),
            },
            Phase::Restoring { fallback, .. } => fallback.held.beside_values(),
            Phase::Resting(_) | Phase::Asking { .. } => self.held.beside_values(),
        }
    }

    /// Makes the memory of an agent's first start.
    pub fn new(robot: RobotId, held: Held) -> Self {
        Self {
            schema: MemorySchema::V1,
            robot,
            held,
            phase: Phase::Resting(Rest::Settled),
            highest: Generation::FACTORY,
            latest: None,
            unstored: Vec::new(),
            keys: None,
        }
    }
}
