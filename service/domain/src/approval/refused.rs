//! Refusals of a command.

use fleetcal_model::{DeploymentId, Generation, ProposalId, Version};
use thiserror::Error;

use super::deployment::{DeploymentEvent, DeploymentState};
use super::present::Outdated;
use super::proposal::{Proposal, ProposalState};

/// Why a command was refused; nothing has changed then.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Refused {
    /// The proposal is decided.
    #[error("proposal: got a {} one, expected an open one", state.as_str())]
    ProposalClosed {
        /// Where it stands.
        state: ProposalState,
    },
    /// The event does not fit the deployment's state.
    #[error("the deployment is {}, to which {event:?} does not happen", state.as_str())]
    Deployment {
        /// Where it stands.
        state: DeploymentState,
        /// What was to happen.
        event: DeploymentEvent,
    },
    /// No open proposal of the robot has this number.
    #[error("proposal {0} is not open any more")]
    NotOpen(ProposalId),
    /// The record has changed since it was looked at.
    #[error("it is at version {found} now: somebody changed it since you opened it")]
    Stale {
        /// The version it is at.
        found: Version,
    },
    /// The approval is about another revision.
    #[error("sha256: got {given}, expected that of the proposed revision, {found}")]
    OtherRevision {
        /// What was given.
        given: String,
        /// The revision's.
        found: String,
    },
    /// People do not approve what they have proposed.
    #[error("{0} has proposed this, and somebody else has to approve it")]
    OwnProposal(String),
    /// One person counts once.
    #[error("{0} has approved this already, and a second person has to")]
    ApprovedAlready(String),
    /// Nobody approves what the present estimate speaks against.
    #[error("{0}; it cannot be approved, and is refreshed or closed")]
    Outdated(Outdated),
    /// Nothing is proposed while nobody knows what the robot is like.
    #[error(
        "the robot was reassembled, and its calibration is not known again yet: drive it until the \
         comparison with the calibration of before has a verdict, and propose what it finds then"
    )]
    ReassemblyOpen,
    /// Another deployment is under way.
    #[error("deployment: got a second one, expected one at a time: {deployment} of this robot is {}", state.as_str())]
    Underway {
        /// Which.
        deployment: DeploymentId,
        /// Where it stands.
        state: DeploymentState,
    },
    /// A value that no robot of this site can have.
    #[error("{field}: got {value}, expected {accepted}")]
    OutOfLimits {
        /// Which.
        field: &'static str,
        /// What it is.
        value: f64,
        /// What is accepted.
        accepted: String,
    },
    /// A decision without its reason.
    #[error("reason: got nothing, expected why, in words")]
    ReasonMissing,
    /// Nobody knows what the robot used before.
    #[error("nothing is known that the robot could go back to; propose values instead")]
    NothingToReturnTo,
    /// The robot uses already what it would go back to.
    #[error("the robot has no earlier verified calibration than the one it uses")]
    NothingEarlier,
    /// No robot is shown what it has not seen yet while the deployment freeze is on.
    #[error("the deployment freeze is on, and deployment {0} waits for its end")]
    Held(DeploymentId),
    /// The service never replaces values that a person rolled the robot back to.
    #[error("generation {generation} was chosen by {by}: only a person can replace it")]
    ChosenByPerson {
        /// The generation.
        generation: Generation,
        /// Who rolled the robot back to it.
        by: String,
    },
    /// The service approves nothing while a robot's answer contradicts another.
    #[error(
        "an answer about generation {generation} contradicts that the robot uses generation {said}: \
         only a person can approve"
    )]
    AnswersContradict {
        /// The generation that the robot was said to use.
        said: Generation,
        /// The generation of the answer that contradicts it.
        generation: Generation,
    },
    /// The robot is in no maintenance that could end.
    #[error("the robot is not in maintenance")]
    NoMaintenance,
    /// No such deployment is under way.
    #[error("deployment {0} is not under way")]
    NotUnderway(DeploymentId),
    /// An answer about a document that was never given out.
    #[error("generation: got {generation}, expected {most} at most")]
    NeverOffered {
        /// What the answer is about.
        generation: Generation,
        /// The highest one that is believed.
        most: Generation,
    },
    /// An answer about another document of this generation.
    #[error("sha256 of generation {generation}: got {given:?}, expected {found}")]
    OtherDocument {
        /// The generation.
        generation: Generation,
        /// What the answer is about.
        given: String,
        /// The document's.
        found: String,
    },
    /// The document cannot be signed.
    #[error("the document cannot be signed: {0}")]
    Seal(String),
}

impl Refused {
    /// Why a command on proposal `id` was refused that is `closed` now. This tells "somebody was
    /// faster" from "that was decided long ago": a proposal that is not open any more has another
    /// version than the one that was looked at while it was.
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

/// Allows a change of what is at version `found`, when it was looked at so and a reason is given.
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
