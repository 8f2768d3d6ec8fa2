//! Messages that were heard before a robot's task began: those that the task before had taken are
//! left out.

use std::collections::VecDeque;

use fleetcal_estimator::{Calibrator, Event, JUMP_BACK_MIN_S, MergerPosition, Note, RobotTime};

/// What the state that a task began with has taken already.
#[derive(Debug)]
pub struct Known {
    position: MergerPosition,
    /// The robot's own notes that it has taken, each once.
    notes: VecDeque<Note>,
    until: RobotTime,
    /// The newest message that was heard so far.
    newest: Option<RobotTime>,
    /// Whether the robot's clock has gone back since: stamps say nothing any more.
    clock_went_back: bool,
}

impl Known {
    /// What an estimator that was restored has taken.
    pub fn by(restored: &Calibrator, notes: VecDeque<Note>) -> Self {
        Self {
            position: restored.position(),
            notes,
            until: restored.estimate().stamp,
            newest: None,
            clock_went_back: false,
        }
    }

    /// Takes the next message that was heard, by its stamp. A note's stamp says nothing of the robot's clock.
    pub fn hear(&mut self, stamp: RobotTime) {
        let back = |newest: RobotTime| newest.seconds_since(stamp) > JUMP_BACK_MIN_S;
        self.clock_went_back |= self.newest.is_some_and(back);
        self.newest = self.newest.max(Some(stamp));
    }

    /// Whether an event of it is known.
    pub fn has(&mut self, event: &Event) -> bool {
        if let Event::Note(note) = event {
            let at = self.notes.iter().position(|taken| taken == note);
            return at.and_then(|at| self.notes.remove(at)).is_some();
        }
        !self.clock_went_back && self.position.covers(event)
    }

    /// Whether a message is known of which nothing follows by itself: half of a drive sample.
    pub fn has_half(&self, stamp: RobotTime) -> bool {
        !self.clock_went_back && stamp <= self.until
    }
}
