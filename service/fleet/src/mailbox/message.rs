//! Message in a mailbox, and its receiver.

use fleetcal_model::{RobotTime, Stream};
use fleetcal_proto::message_type::Form;

use crate::notes::Noted;
use crate::senders::Origin;

/// A message as it came in, not decoded yet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// The stream it came on.
    pub stream: Stream,
    /// How it is written.
    pub form: Form,
    /// Origin, where that is known.
    pub origin: Option<Origin>,
    /// Its bytes.
    pub payload: Vec<u8>,
}

/// What waits for a robot's task.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Item {
    /// A message of the robot.
    Message(Message),
    /// One that came before the task began: it may be taken already by the task before.
    Heard(Message),
    /// A note of a person or a tool: it is in the history already.
    Note(Noted),
    /// The robot's session has ended.
    EndOfSession,
    /// The robot has said what it uses: what stands behind this was sent later, or is in flight.
    ValuesHeard,
}

/// What became of a message that the task took.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// The estimator has it.
    Processed {
        /// Its header stamp, ns since 1970.
        stamp_ns: RobotTime,
    },
    /// It was refused, for this reason.
    Refused(String),
    /// The estimator had it already: it is in the state that the task began with.
    Known,
}

/// For whom a mailbox takes messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Recipient {
    /// The robot's task, which works them off.
    #[default]
    Task,
    /// A task that is to begin. Another instance has the robot.
    Heir,
    /// Nobody: another instance has the robot.
    Nobody,
}
