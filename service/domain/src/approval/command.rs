//! Commands on a robot's records, and the reasons to refuse them.

use fleetcal_model::{DeploymentId, Generation, Pose2, ProposalId, Version, WallTime};
use fleetcal_proto::calibration::{Applied, CalibrationValues};
use fleetcal_proto::signing::SigningKey;

use super::deployment::Verification;
use super::policy::Policy;
use super::present::Present;
use super::revision::{Evidence, Origin};
use super::second_approver::Drawing;
use crate::access::Actor;

/// What is asked of one robot's records.
#[derive(Debug, Clone, PartialEq)]
pub enum Command {
    /// Ask people for these values. An open proposal of the robot is superseded.
    Propose {
        /// Where the values come from.
        origin: Origin,
        /// The values.
        values: CalibrationValues,
        /// Their sigmas.
        sigmas: CalibrationValues,
        /// What they rest on.
        evidence: Evidence,
        /// Why.
        reason: Option<String>,
    },
    /// Approve a proposal.
    Approve {
        /// Which.
        proposal: ProposalId,
        /// The version that was looked at; whatever is there unless given.
        version: Option<Version>,
        /// SHA-256 of the revision that was looked at.
        sha256: String,
        /// Why.
        reason: Option<String>,
    },
    /// Say no to a proposal.
    Reject {
        /// Which.
        proposal: ProposalId,
        /// The version that was looked at.
        version: Option<Version>,
        /// Why; never empty.
        reason: String,
    },
    /// Take a proposal back.
    Withdraw {
        /// Which.
        proposal: ProposalId,
        /// The version that was looked at.
        version: Option<Version>,
        /// Why.
        reason: Option<String>,
    },
    /// End a proposal whose time is over.
    Expire {
        /// Which.
        proposal: ProposalId,
    },
    /// End a proposal that a newer estimate disagrees with.
    Supersede {
        /// Which.
        proposal: ProposalId,
        /// In words.
        reason: String,
    },
    /// Put the present estimate in the place of what is proposed: approvals already given are void.
    Refresh {
        /// Which.
        proposal: ProposalId,
        /// The present values.
        values: CalibrationValues,
        /// Their sigmas.
        sigmas: CalibrationValues,
        /// What they rest on.
        evidence: Evidence,
        /// In words.
        reason: String,
    },
    /// The document of this generation is about to be shown to the robot.
    Offer {
        /// Its generation.
        generation: Generation,
    },
    /// The document of this generation was shown to the robot.
    Offered {
        /// Its generation.
        generation: Generation,
    },
    /// The robot's answer.
    Acknowledge(Applied),
    /// The robot was told that its answer about this generation is stored.
    Confirmed {
        /// The generation.
        generation: Generation,
    },
    /// What a verification estimate says of the values in use.
    Judge {
        /// The deployment that brought them.
        deployment: DeploymentId,
        /// What it says.
        verification: Verification,
    },
    /// End a deployment whose time is over, or that could not be judged.
    GiveUp {
        /// Which.
        deployment: DeploymentId,
        /// In words.
        reason: String,
    },
    /// End a deployment that a newer estimate disagrees with before the robot uses it.
    Void {
        /// Which.
        deployment: DeploymentId,
        /// In words.
        reason: String,
    },
    /// Say that the robot is switched off on purpose until then, or with `None` that it is not.
    Maintain {
        /// Until when, ns since 1970, wall time.
        until_ns: Option<WallTime>,
        /// Why; never empty.
        reason: String,
    },
    /// Bring the former values back.
    RollBack {
        /// The version of the shadow that was looked at.
        version: Option<Version>,
        /// Why; never empty.
        reason: String,
    },
}

impl Command {
    /// The version of the record that was looked at, where the command names one.
    pub fn version(&self) -> Option<Version> {
        match self {
            Self::Approve { version, .. }
            | Self::Reject { version, .. }
            | Self::Withdraw { version, .. }
            | Self::RollBack { version, .. } => *version,
            _ => None,
        }
    }
}

/// What a step is taken with.
#[derive(Debug, Clone)]
pub struct Standing<'a> {
    /// The rules.
    pub policy: &'a Policy,
    /// What documents are signed with.
    pub key: &'a SigningKey,
    /// Who asks.
    pub actor: &'a Actor,
    /// Wall time.
    pub now: WallTime,
    /// Whether the deployment freeze is on.
    pub frozen: bool,
    /// Where the robot's rear axle is in its `base_link`, where that is configured.
    pub rear_axle_in_base_link: Option<Pose2>,
    /// The robot's drawing, where one is configured.
    pub drawing: Option<Drawing>,
    /// What the estimator says at this moment: nobody approves what it speaks against.
    pub present: Present,
}
