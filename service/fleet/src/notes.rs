//! Notes about a robot, and which of them its estimator has taken. A note that somebody was told is stored
//! reaches the estimator whatever happens meanwhile: a task knows up to which one it has taken them, its
//! stored state says so too, and the service brings it those after that.

use std::collections::VecDeque;

use fleetcal_domain::limits::NOTES_PER_HOUR_MAX;
use fleetcal_estimator::Note;
use fleetcal_model::AuditId;
use fleetcal_proto::event::RobotEvent;
use serde::{Deserialize, Serialize};

/// A note of a person or a tool, as it is stored.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Noted {
    /// Number of its row in the audit; later notes have higher ones.
    pub number: AuditId,
    /// Content of the note.
    pub event: RobotEvent,
}

/// Notes about a robot that its estimator has processed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct NotesTaken {
    /// Number of the last processed note of people and tools.
    pub until: AuditId,
    /// The robot's own latest notes, the newest last: an instance that takes over the robot may
    /// have received them too.
    #[serde(default, skip_serializing_if = "VecDeque::is_empty")]
    pub of_robot: VecDeque<Note>,
}

impl NotesTaken {
    /// Marks all notes up to a number as processed.
    pub fn until(number: AuditId) -> Self {
        Self {
            until: number,
            of_robot: VecDeque::new(),
        }
    }

    /// Adds one of the robot's own notes.
    pub fn remember(&mut self, note: Note) {
        if self.of_robot.len() >= NOTES_PER_HOUR_MAX as usize {
            self.of_robot.pop_front();
        }
        self.of_robot.push_back(note);
    }
}
