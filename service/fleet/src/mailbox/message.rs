//! Message in a mailbox, and its receiver.

use fleetcal_model::{RobotTime, Stream, WallTime};
use fleetcal_proto::message_type::{Form, MessageType};
use fleetcal_proto::ros::{DriveSamples, RosMessage};

use crate::notes::Noted;
use crate::reading;
use crate::senders::Origin;

/// Message as it was received, not decoded yet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// Stream of the message.
    pub stream: Stream,
    /// Encoding and type of the message.
    pub form: Form,
    /// Origin, where that is known.
    pub origin: Option<Origin>,
    /// Time of its receipt, wall time.
    pub arrived_ns: WallTime,
    /// Payload.
    pub payload: Vec<u8>,
}

impl Message {
    /// Returns what a reading needs of it.
    pub fn as_read(&self) -> reading::Message<'_> {
        reading::Message {
            stream: self.stream,
            form: self.form,
            payload: &self.payload,
            arrived: RobotTime(self.arrived_ns.0),
        }
    }

    /// Returns the number of drive samples in a message of wheel odometry that nobody has decoded;
    /// half of one counts as one.
    pub(super) fn drive_samples(&self) -> u64 {
        match self.form.message_type {
            Some(MessageType::DriveSamples) => {
                let decoded = DriveSamples::decode(self.form.encoding, &self.payload);
                decoded.map_or(0, |message| message.samples().len() as u64)
            }
            _ => 1,
        }
    }
}

/// Item that waits for a robot's task.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Item {
    /// A message of the robot.
    Message(Message),
    /// A message that came before the task began; the former task may have processed it already.
    Heard(Message),
    /// A note of a person or a tool, which is in the history already.
    Note(Noted),
    /// The robot's session has ended.
    EndOfSession,
    /// The robot has reported the values in use: items behind this were sent later, or are in
    /// flight.
    ValuesHeard,
}

impl Item {
    /// True for wheel odometry that came while there is a task.
    pub fn is_wheel_odometry(&self) -> bool {
        matches!(self, Self::Message(Message { stream, .. }) if stream.is_wheel_odometry())
    }
}

/// Outcome of a message that the task processed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// The estimator has processed it.
    Processed {
        /// Its header stamp, ns since 1970.
        stamp_ns: RobotTime,
        /// Drive samples in it.
        drive_samples: u64,
    },
    /// Refused, for this reason.
    Refused(String),
    /// The estimator had it already: the state that the task began with covers it.
    Known,
}

/// Recipient of a mailbox's messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Recipient {
    /// The robot's task, which processes them.
    #[default]
    Task,
    /// A task that is to begin, while another instance still estimates the robot.
    Heir,
    /// Nobody, because another instance estimates the robot.
    Nobody,
}
