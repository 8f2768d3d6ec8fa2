//! Item of a robot's session, for those who record it.

use std::sync::Arc;

use fleetcal_domain::robot::ServiceEvent;
use fleetcal_estimator::{Pose2, RobotTime};
use fleetcal_proto::RecordingTopic;
use fleetcal_proto::estimate::{ChangeDocument, EstimateDocument};
use fleetcal_proto::event::RobotEvent;

use crate::words::word;

/// Item of a session that is being recorded.
#[derive(Debug, Clone, PartialEq)]
pub enum Tapped {
    /// A message of the robot that was processed.
    Message {
        /// Its header stamp.
        stamp: RobotTime,
        /// Its topic and type.
        topic: RecordingTopic,
        /// Payload.
        payload: Arc<[u8]>,
    },
    /// Pose of the rear axle in the filter's odometry frame.
    Pose(RobotTime, Pose2),
    /// The new estimate.
    Estimate(Arc<EstimateDocument>),
    /// A change or fault.
    Change(ChangeDocument),
    /// Another event, in words.
    Event {
        /// Its time, ns since 1970 by the robot's clock.
        stamp_ns: RobotTime,
        /// The words.
        words: String,
    },
}

impl Tapped {
    /// Makes the item of a note of a person or tool.
    pub fn of_note(note: &RobotEvent) -> Self {
        Self::in_words(note.stamp_ns, &word(&note.kind), &note.note)
    }

    /// Makes the item of an event of the service about the robot.
    pub fn of_service_event(event: &ServiceEvent) -> Self {
        Self::in_words(event.stamp_ns, &word(&event.kind), &event.note)
    }

    fn in_words(stamp_ns: RobotTime, kind: &str, note: &str) -> Self {
        let words = match note {
            "" => kind.to_owned(),
            note => format!("{kind}: {note}"),
        };
        Self::Event { stamp_ns, words }
    }

    /// Returns the size that it takes of the room for payloads.
    pub(crate) fn bytes(&self) -> usize {
        match self {
            Self::Message { payload, .. } => payload.len(),
            _ => 0,
        }
    }
}
