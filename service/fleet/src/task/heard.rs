//! Messages that were heard before a robot's task began: those that the task before had taken are
//! left out.

use std::collections::VecDeque;

use fleetcal_estimator::{Calibrator, Event, JUMP_BACK_MIN_S, MergerPosition, Note, RobotTime};

/// Messages that the task's initial state covers already.
#[derive(Debug)]
pub struct Known {
    position: MergerPosition,
    /// The robot's own notes that it covers, each once.
    notes: VecDeque<Note>,
    until: RobotTime,
    /// Newest early message so far.
    newest: Option<RobotTime>,
    /// True if the robot's clock has gone back since, which makes stamps useless.
    clock_went_back: bool,
}

impl Known {
    /// Makes the record of messages that a restored estimator covers.
    pub fn by(restored: &Calibrator, notes: VecDeque<Note>) -> Self {
        Self {
            position: restored.position(),
            notes,
            until: restored.estimate().stamp,
            newest: None,
            clock_went_back: false,
        }
    }

    /// Notes the stamp of the next early message. A note's stamp does not show the robot's clock.
    pub fn hear(&mut self, stamp: RobotTime) {
        let back = |newest: RobotTime| newest.seconds_since(stamp) > JUMP_BACK_MIN_S;
        self.clock_went_back |= self.newest.is_some_and(back);
        self.newest = self.newest.max(Some(stamp));
    }

    /// True if an event of an early message is covered.
    pub fn has(&mut self, event: &Event) -> bool {
        if let Event::Note(note) = event {
            let at = self.notes.iter().position(|taken| taken == note);
            return at.and_then(|at| self.notes.remove(at)).is_some();
        }
        !self.clock_went_back && self.position.covers(event)
    }

    /// True if a message is covered that yields nothing by itself: half of a drive sample.
    pub fn has_half(&self, stamp: RobotTime) -> bool {
        !self.clock_went_back && stamp <= self.until
    }
}
