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

/// Command on the records of one robot.
#[derive(Debug, Clone, PartialEq)]
pub enum Command {
    /// Propose these values to people. An open proposal of the robot is superseded.
    Propose {
        /// Origin of the values.
        origin: Origin,
        /// Proposed values.
        values: CalibrationValues,
        /// Sigmas of the values.
        sigmas: CalibrationValues,
        /// Evidence for the values.
        evidence: Evidence,
        /// Reason for the proposal.
        reason: Option<String>,
    },
    /// Approve a proposal.
    Approve {
        /// Proposal's number.
        proposal: ProposalId,
        /// Version that the person read; any unless given.
        version: Option<Version>,
        /// SHA-256 of the revision that the person read.
        sha256: String,
        /// Reason for the approval.
        reason: Option<String>,
    },
    /// Reject a proposal.
    Reject {
        /// Proposal's number.
        proposal: ProposalId,
        /// Version that the person read.
        version: Option<Version>,
        /// Reason; never empty.
        reason: String,
    },
    /// Withdraw a proposal.
    Withdraw {
        /// Proposal's number.
        proposal: ProposalId,
        /// Version that the person read.
        version: Option<Version>,
        /// Reason for the withdrawal.
        reason: Option<String>,
    },
    /// Close a proposal after its time.
    Expire {
        /// Proposal's number.
        proposal: ProposalId,
    },
    /// Close a proposal that a newer estimate contradicts.
    Supersede {
        /// Proposal's number.
        proposal: ProposalId,
        /// Reason, in words.
        reason: String,
    },
    /// Replace the proposed values by the present estimate; approvals already given become void.
    Refresh {
        /// Proposal's number.
        proposal: ProposalId,
        /// Present values.
        values: CalibrationValues,
        /// Sigmas of the values.
        sigmas: CalibrationValues,
        /// Evidence for the values.
        evidence: Evidence,
        /// Reason, in words.
        reason: String,
    },
    /// Offer the document of this generation to the robot: it is about to be sent.
    Offer {
        /// Generation of the document.
        generation: Generation,
    },
    /// Record that the document of this generation was sent to the robot.
    Offered {
        /// Generation of the document.
        generation: Generation,
    },
    /// Record the robot's answer.
    Acknowledge(Applied),
    /// Record that the confirmation of the answer about this generation was sent.
    Confirmed {
        /// Generation of the answer.
        generation: Generation,
    },
    /// Record the verdict of a verification estimate on the values in use.
    Judge {
        /// Deployment that brought the values.
        deployment: DeploymentId,
        /// Verdict with its residual.
        verification: Verification,
    },
    /// End a deployment whose time is over, or that could not be judged.
    GiveUp {
        /// Deployment's number.
        deployment: DeploymentId,
        /// Reason, in words.
        reason: String,
    },
    /// Void a deployment that a newer estimate contradicts before the robot uses it.
    Void {
        /// Deployment's number.
        deployment: DeploymentId,
        /// Reason, in words.
        reason: String,
    },
    /// Begin maintenance of a robot that is switched off on purpose, or end it with `None`.
    Maintain {
        /// End of the maintenance, ns since 1970, wall time.
        until_ns: Option<WallTime>,
        /// Reason; never empty.
        reason: String,
    },
    /// Retire the robot, which has left the fleet.
    Retire {
        /// Reason; never empty.
        reason: String,
    },
    /// Bring a retired robot back.
    BringBack {
        /// Reason; never empty.
        reason: String,
    },
    /// Roll back to the former values.
    RollBack {
        /// Version of the shadow that the person read.
        version: Option<Version>,
        /// Reason; never empty.
        reason: String,
    },
}

impl Command {
    /// Version of the record that the caller read, if the command has one.
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

/// Context in which a command is taken.
#[derive(Debug, Clone)]
pub struct Standing<'a> {
    /// Policy of approvals.
    pub policy: &'a Policy,
    /// Key that signs documents.
    pub key: &'a SigningKey,
    /// Originator of the command.
    pub actor: &'a Actor,
    /// Wall time.
    pub now: WallTime,
    /// True if the deployment freeze is on.
    pub frozen: bool,
    /// Pose of the rear axle in the robot's `base_link`, if configured.
    pub rear_axle_in_base_link: Option<Pose2>,
    /// Drawing of the robot, if configured.
    pub drawing: Option<Drawing>,
    /// Present estimate, against which an approval is checked.
    pub present: Present,
    /// True if the robot sends.
    pub is_sending: bool,
}
