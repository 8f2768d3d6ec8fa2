//! What can be asked of a robot's records, and why it may be refused.

use fleetcal_proto::calibration::{Applied, CalibrationValues};
use fleetcal_proto::estimate::PoseDocument;
use fleetcal_proto::signing::SigningKey;
use thiserror::Error;

use super::deployment::{DeploymentEvent, DeploymentState, Verification};
use super::policy::Policy;
use super::proposal::ProposalState;
use super::revision::{Evidence, Origin};
use crate::access::Actor;

/// What is asked of one robot's records.
#[derive(Debug, Clone, PartialEq)]
#[expect(
    clippy::large_enum_variant,
    reason = "one command at a time is made, and moved twice"
)]
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
        /// What the robot uses if it has never said so.
        nominal: Option<CalibrationValues>,
        /// Why.
        reason: Option<String>,
    },
    /// Agree to a proposal.
    Approve {
        /// Which.
        proposal: u64,
        /// The version that was looked at; whatever is there unless given.
        version: Option<u64>,
        /// SHA-256 of the revision that was looked at.
        sha256: String,
        /// Why.
        reason: Option<String>,
    },
    /// Say no to a proposal.
    Reject {
        /// Which.
        proposal: u64,
        /// The version that was looked at.
        version: Option<u64>,
        /// Why; never empty.
        reason: String,
    },
    /// Take a proposal back.
    Withdraw {
        /// Which.
        proposal: u64,
        /// The version that was looked at.
        version: Option<u64>,
        /// Why.
        reason: Option<String>,
    },
    /// End a proposal whose time is over.
    Expire {
        /// Which.
        proposal: u64,
    },
    /// End a proposal that a newer estimate disagrees with.
    Supersede {
        /// Which.
        proposal: u64,
        /// In words.
        reason: String,
    },
    /// The document of this generation is about to be shown to the robot.
    Offer {
        /// Its generation.
        generation: u64,
    },
    /// The document of this generation was shown to the robot.
    Offered {
        /// Its generation.
        generation: u64,
    },
    /// The robot's answer.
    Acknowledge(Applied),
    /// The robot was told that its answer about this generation is stored.
    Confirmed {
        /// The generation.
        generation: u64,
    },
    /// What a fresh estimate says of the values in use.
    Judge {
        /// The deployment that brought them.
        deployment: u64,
        /// What it says.
        verification: Verification,
    },
    /// End a deployment whose time is over, or that could not be judged.
    GiveUp {
        /// Which.
        deployment: u64,
        /// In words.
        reason: String,
    },
    /// End a deployment that a newer estimate disagrees with before the robot uses it.
    Void {
        /// Which.
        deployment: u64,
        /// In words.
        reason: String,
    },
    /// Bring the former values back.
    RollBack {
        /// The version of the shadow that was looked at.
        version: Option<u64>,
        /// Why; never empty.
        reason: String,
    },
}

impl Command {
    /// The version of the record that was looked at, where the command names one.
    pub fn version(&self) -> Option<u64> {
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
    pub now_ns: i64,
    /// Whether the site-wide stop is on.
    pub held: bool,
    /// Where the robot's rear axle is in its `base_link`, where that is configured.
    pub rear_axle_in_base_link: Option<PoseDocument>,
}

/// Why a command was refused; nothing has changed then.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Refused {
    /// The proposal is decided.
    #[error("the proposal is {}, accepted are open ones", state.as_str())]
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
    NotOpen(u64),
    /// The record has changed since it was looked at.
    #[error("it is at version {found} now: somebody changed it since you opened it")]
    Stale {
        /// The version it is at.
        found: u64,
    },
    /// The approval is about another revision.
    #[error("sha256 is {given}, accepted is the proposed revision's, {found}")]
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
    /// Another deployment is under way.
    #[error("deployment {deployment} of this robot is {}, accepted is one at a time", state.as_str())]
    Underway {
        /// Which.
        deployment: u64,
        /// Where it stands.
        state: DeploymentState,
    },
    /// A value that no robot of this site can have.
    #[error("{field} is {value}, accepted is {accepted}")]
    OutOfLimits {
        /// Which.
        field: &'static str,
        /// What it is.
        value: f64,
        /// What is accepted.
        accepted: String,
    },
    /// A decision without its reason.
    #[error("reason is empty, accepted is why, in words")]
    ReasonMissing,
    /// Nobody knows what the robot used before.
    #[error("nothing is known that the robot could go back to; propose values instead")]
    NothingToReturnTo,
    /// The robot uses already what it would go back to.
    #[error("the robot has no earlier verified calibration than the one it uses")]
    NothingEarlier,
    /// No robot is shown what it has not seen yet while the site-wide stop is on.
    #[error("the site-wide stop is on, and deployment {0} waits for its end")]
    Held(u64),
    /// No such deployment is under way.
    #[error("deployment {0} is not under way")]
    NotUnderway(u64),
    /// An answer about a document that was never given out.
    #[error("generation is {generation}, accepted is {most} at most")]
    NeverOffered {
        /// What the answer is about.
        generation: u64,
        /// The highest one that is believed.
        most: u64,
    },
    /// An answer about another document of this generation.
    #[error("sha256 of generation {generation} is {given:?}, accepted is {found}")]
    OtherDocument {
        /// The generation.
        generation: u64,
        /// What the answer is about.
        given: String,
        /// The document's.
        found: String,
    },
    /// The document cannot be signed.
    #[error("the document cannot be signed: {0}")]
    Seal(String),
}
