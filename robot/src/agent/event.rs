//! Events of an agent, and the effects it asks for.

use fleetcal_proto::calibration::{Applied, CalibrationValues, Confirmed};
use fleetcal_proto::offer::{Offered, Question};
use thiserror::Error;

use super::state::{Ending, Fallback, Offer, Phase};

/// What happens to an agent.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// The process started.
    Restarted {
        /// Whether the file says what was to be written when the process ended.
        written: bool,
    },
    /// A document came.
    Offered {
        /// The document, and the service's word that it is wanted.
        offered: Offered,
        /// The agent's question that it came for; `None` of one that was pushed, which is a hint to
        /// ask.
        answers: Option<Question>,
    },
    /// The service says that it has stored an answer.
    Confirmed(Confirmed),
    /// A service came up.
    ServiceUp,
    /// Time passed.
    Tick,
    /// The hook answered [`Effect::AskHook`].
    HookAnswered(HookAnswer),
    /// [`Effect::Write`] ended.
    Written(Result<(), String>),
    /// [`Effect::Activate`] ended.
    Activated(Activation),
    /// [`Effect::Restore`] ended.
    Restored(Result<(), String>),
    /// [`Effect::TellReverted`] ended.
    RevertTold(Result<(), String>),
}

impl Event {
    fn name(&self) -> &'static str {
        match self {
            Self::Restarted { .. } => "a restart",
            Self::Offered { .. } => "an offer",
            Self::Confirmed(_) => "a confirmation",
            Self::ServiceUp => "a service",
            Self::Tick => "a tick",
            Self::HookAnswered(_) => "an answer of the hook",
            Self::Written(_) => "the end of a write",
            Self::Activated(_) => "the end of an activation",
            Self::Restored(_) => "the end of a way back",
            Self::RevertTold(_) => "the end of the word about a way back",
        }
    }
}

/// What the robot says to a document.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum HookAnswer {
    /// Apply it now.
    Go {
        /// What the file says now; `None` when there is none.
        before: Option<String>,
    },
    /// Not now: the robot is on a mission.
    Busy,
    /// It cannot be asked, or cannot prepare.
    Failed(String),
}

/// What became of values that were written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Activation {
    /// The robot's software works with them.
    Done,
    /// A mission began in between: not now.
    Busy,
    /// It cannot work with them.
    Failed(String),
}

/// What is to be done, in this order.
#[derive(Debug, Clone, PartialEq)]
pub enum Effect {
    /// Ask whether this document may be applied now; comes back as [`Event::HookAnswered`].
    AskHook(Offer),
    /// Write these values where the robot's software reads them; comes back as [`Event::Written`].
    Write(CalibrationValues),
    /// Tell the hook that this document's values are written; comes back as [`Event::Activated`].
    /// After a restart it may be told once more.
    Activate(Offer),
    /// Write the former values back; comes back as [`Event::Restored`].
    Restore(Fallback),
    /// Tell the hook that this document's values are gone; comes back as [`Event::RevertTold`].
    /// After a restart it may be told once more.
    TellReverted(Ending),
    /// Answer the service.
    Acknowledge(Applied),
    /// Ask the service what it has stored.
    AskConfirmed,
    /// Ask the service for the approved document and what it has stored.
    Pull,
    /// Tell who reads the log.
    Note(String),
}

/// An event that cannot happen in this phase: whoever performs the effects is at fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("{event} does not fit: the agent is {phase}")]
pub struct TransitionRefused {
    event: &'static str,
    phase: &'static str,
}

impl TransitionRefused {
    pub(super) fn new(event: &Event, phase: &Phase) -> Self {
        Self {
            event: event.name(),
            phase: phase.name(),
        }
    }
}
