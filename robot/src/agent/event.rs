//! Events of an agent, and the effects it asks for.

use fleetcal_proto::calibration::{Applied, CalibrationValues, Confirmed, Envelope};
use fleetcal_proto::offer::{Offered, Question};
use thiserror::Error;

use super::state::{Ending, Fallback, Offer, Phase};

/// Event of an agent.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// The process started.
    Restarted {
        /// True if the file holds the values that were to be written when the process ended.
        written: bool,
    },
    /// A document arrived.
    Offered {
        /// The document with its offer.
        offered: Offered,
        /// The agent's question that it answers; `None` for a pushed one, which is a hint to query.
        answers: Option<Question>,
    },
    /// The service has confirmed a stored acknowledgement.
    Confirmed(Confirmed),
    /// The service announces the changes of its signing key, oldest first.
    KeyChanged(Vec<Envelope>),
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
            Self::KeyChanged(_) => "a change of key",
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

/// Answer of the robot to a document.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum HookAnswer {
    /// Apply it now.
    Go {
        /// Present content of the file; `None` without a file.
        before: Option<String>,
    },
    /// Busy: the robot is on a mission.
    Busy,
    /// The hook cannot be called, or cannot prepare.
    Failed(String),
}

/// Outcome of written values.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Activation {
    /// The robot's software uses them.
    Done,
    /// A mission began in between: not now.
    Busy,
    /// The robot's software cannot use them.
    Failed(String),
}

/// Effect of an agent's step, performed in order.
#[derive(Debug, Clone, PartialEq)]
pub enum Effect {
    /// Query the hook whether this document may be applied now; its answer comes as
    /// [`Event::HookAnswered`].
    AskHook(Offer),
    /// Write these values where the robot's software reads them; the result comes as
    /// [`Event::Written`].
    Write(CalibrationValues),
    /// Notify the hook that this document's values are written; the result comes as
    /// [`Event::Activated`]. It may be repeated once after a restart.
    Activate(Offer),
    /// Write the former values back; the result comes as [`Event::Restored`].
    Restore(Fallback),
    /// Notify the hook that this document's values are withdrawn; the result comes as
    /// [`Event::RevertTold`]. It may be repeated once after a restart.
    TellReverted(Ending),
    /// Send an acknowledgement to the service.
    Acknowledge(Applied),
    /// Query the service for the acknowledgement that it has stored.
    AskConfirmed,
    /// Query the service for the approved document and the acknowledgement that it has stored.
    Pull,
    /// Write a line to the log.
    Note(String),
}

/// Error of an event that cannot happen in this phase: the performer of the effects is at fault.
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
