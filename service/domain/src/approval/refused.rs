//! Refusals of a command.

use fleetcal_model::{DeploymentId, Generation, ProposalId, Version};
use thiserror::Error;

use super::deployment::{DeploymentEvent, DeploymentState};
use super::present::Outdated;
use super::proposal::{Proposal, ProposalState};

/// Reason for which a command was refused; nothing has changed then.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Refused {
    /// Proposal that is decided.
    #[error("the proposal is {}", state.as_str())]
    ProposalClosed {
        /// State of the proposal.
        state: ProposalState,
    },
    /// Event that does not fit the deployment's state.
    #[error("the deployment is {}, to which {event:?} does not happen", state.as_str())]
    Deployment {
        /// State of the deployment.
        state: DeploymentState,
        /// Event that was refused.
        event: DeploymentEvent,
    },
    /// Number of no open proposal of the robot.
    #[error("proposal {0} is not open any more")]
    NotOpen(ProposalId),
    /// Record changed since it was read.
    #[error("it is at version {found} now: somebody changed it since you opened it")]
    Stale {
        /// Present version.
        found: Version,
    },
    /// Approval of another revision.
    #[error("sha256: got {given}, expected that of the proposed revision, {found}")]
    OtherRevision {
        /// Given hash.
        given: String,
        /// Hash of the proposed revision.
        found: String,
    },
    /// Approval by the proposer.
    #[error("{0} has proposed this, and somebody else has to approve it")]
    OwnProposal(String),
    /// Second approval by the same person.
    #[error("{0} has approved this already, and a second person has to")]
    ApprovedAlready(String),
    /// Approval of a proposal that the present estimate contradicts.
    #[error("{0}; it cannot be approved, and is refreshed or closed")]
    Outdated(Outdated),
    /// Proposal while a reported reassembly leaves the calibration unknown.
    #[error(
        "the robot was reassembled, and its calibration is not known again yet: drive it until the \
         comparison with the calibration of before has a verdict, and propose what it finds then"
    )]
    ReassemblyOpen,
    /// Proposal of an estimate while two senders use the robot's id.
    #[error(
        "two senders use the robot's id, so that nothing is known of it: stop the second one, and \
         propose what is estimated then"
    )]
    TwoSenders,
    /// Second deployment while another is under way.
    #[error("deployment {deployment} of this robot is {} already; one at a time is possible", state.as_str())]
    Underway {
        /// Deployment under way.
        deployment: DeploymentId,
        /// State of that deployment.
        state: DeploymentState,
    },
    /// Value beyond the limits of this site.
    #[error("{field}: got {value}, expected {accepted}")]
    OutOfLimits {
        /// Name of the value.
        field: &'static str,
        /// Refused value.
        value: f64,
        /// Accepted values, in words.
        accepted: String,
    },
    /// Decision without a reason.
    #[error("reason: got nothing, expected why, in words")]
    ReasonMissing,
    /// Roll-back without known former values.
    #[error("no earlier values of the robot are known; propose values instead")]
    NothingToReturnTo,
    /// Roll-back without an earlier verified calibration.
    #[error("the robot has no earlier verified calibration than the one it uses")]
    NothingEarlier,
    /// Offer of a new document while the deployment freeze is on.
    #[error("the deployment freeze is on, and deployment {0} waits for its end")]
    Held(DeploymentId),
    /// Replacement by the service of values that a person rolled the robot back to.
    #[error("generation {generation} was chosen by {by}: only a person can replace it")]
    ChosenByPerson {
        /// Generation chosen by the person.
        generation: Generation,
        /// Person who rolled the robot back to it.
        by: String,
    },
    /// Approval by the service while a robot's answer contradicts another.
    #[error(
        "an answer about generation {generation} contradicts that the robot uses generation {said}: \
         only a person can approve"
    )]
    AnswersContradict {
        /// Generation in use by the earlier answer.
        said: Generation,
        /// Generation of the answer that contradicts it.
        generation: Generation,
    },
    /// End of a maintenance of a robot that is in none.
    #[error("the robot is not in maintenance")]
    NoMaintenance,
    /// Command on the records of a retired robot.
    #[error("{by} has retired the robot: bring it back first")]
    Retired {
        /// Person or tool that retired it.
        by: String,
    },
    /// Return of a robot that is not retired.
    #[error("the robot is not retired")]
    NotRetired,
    /// Retirement of a robot that sends.
    #[error("the robot sends, so it is at work: switch it off, and retire it then")]
    StillSends,
    /// Retirement of a robot with a deployment under way.
    #[error("deployment {deployment} of this robot is {}: retire the robot when it has ended", state.as_str())]
    UnderwayAtRetirement {
        /// Deployment under way.
        deployment: DeploymentId,
        /// State of that deployment.
        state: DeploymentState,
    },
    /// Number of no deployment under way.
    #[error("deployment {0} is not under way")]
    NotUnderway(DeploymentId),
    /// Answer about a document that was never offered.
    #[error("generation: got {generation}, expected {most} at most")]
    NeverOffered {
        /// Generation of the answer.
        generation: Generation,
        /// Highest generation that is believed.
        most: Generation,
    },
    /// Answer about another document of this generation.
    #[error("sha256 of generation {generation}: got {given:?}, expected {found}")]
    OtherDocument {
        /// Generation of the answer.
        generation: Generation,
        /// Hash in the answer.
        given: String,
        /// Hash of the document.
        found: String,
    },
    /// Failure to sign the document.
    #[error("the document cannot be signed: {0}")]
    Seal(String),
}

impl Refused {
    /// Refusal of a command on proposal `id` that is `closed` now. It distinguishes a decision made
    /// since the caller read the proposal from an older one: a closed proposal has another version
    /// than the one that was read while it was open.
    pub fn not_open(id: ProposalId, closed: Option<&Proposal>, looked_at: Option<Version>) -> Self {
        match (closed, looked_at) {
            (Some(closed), Some(looked_at)) if closed.version != looked_at => Self::Stale {
                found: closed.version,
            },
            (Some(closed), Some(_)) => Self::ProposalClosed {
                state: closed.state,
            },
            _ => Self::NotOpen(id),
        }
    }
}

/// Allows a change of a record at version `found`, if the caller read that version and gives a
/// reason.
///
/// # Errors
/// [`Refused::Stale`] or [`Refused::ReasonMissing`].
pub fn may_change(found: Version, looked_at: Version, reason: &str) -> Result<(), Refused> {
    if found != looked_at {
        return Err(Refused::Stale { found });
    }
    if reason.trim().is_empty() {
        return Err(Refused::ReasonMissing);
    }
    Ok(())
}
