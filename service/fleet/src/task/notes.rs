//! Notes about a robot, on their way to its estimator.

use fleetcal_domain::limits::NOTES_PER_HOUR_MAX;
use fleetcal_domain::robot::HistoryEvent;
use fleetcal_estimator::{Calibrator, Event, Note};
use fleetcal_model::NoteKind;
use fleetcal_proto::event::RobotEvent;

use super::good::Good;
use super::{Engine, RobotTask};
use crate::decode;
use crate::mailbox::Outcome;
use crate::notes::Noted;
use crate::tapped::Tapped;

impl RobotTask {
    /// Passes a note of a person or a tool to the estimator, once. The note is stored, and is
    /// passed again until the estimator has it.
    pub(super) fn take_noted(&mut self, noted: &Noted) {
        if noted.number <= self.notes.until {
            return;
        }
        if !self.step_note(&decode::note(&noted.event)) {
            tracing::error!(robot.id = %self.robot.id, "a note waits: the robot's estimator is stopped");
            return;
        }
        self.robot.taps.offer(Tapped::of_note(&noted.event));
        self.notes.until = noted.number;
        self.keep_with_note(&decode::note(&noted.event));
        self.robot.set_notes_taken(noted.number);
    }

    /// Passes the robot's own note to the estimator. The note appears in the history once the state
    /// with it is on its way to the store, so that the estimator has every note that people see.
    pub(super) fn take_robots_note(&mut self, event: RobotEvent) -> Outcome {
        if !self.budgets.take_note(&self.fleet, &event) {
            return Outcome::Refused(format!(
                "event: the robot's notes of this hour are used up, the limit is {NOTES_PER_HOUR_MAX}"
            ));
        }
        let note = decode::note(&event);
        if !self.step_note(&note) {
            return Outcome::Refused("the robot's estimator is stopped after a fault".to_owned());
        }
        self.notes.remember(note.clone());
        self.keep_with_note(&note);
        self.robot.taps.offer(Tapped::of_note(&event));
        self.fleet.record(&self.robot.id, HistoryEvent::Note(event));
        // People's stamps say nothing of how far the robot's messages are taken.
        Outcome::Processed {
            stamp_ns: self.newest,
            drive_samples: 0,
        }
    }

    /// Repeats an open reassembly to an estimator that begins from nothing, because the values
    /// after it are still unknown.
    pub(super) fn reopen_reassembly(&mut self) {
        let note = Note {
            stamp: self.newest,
            kind: NoteKind::Reassembled,
        };
        self.step_note(&note);
        self.robot.set_reassembly_open(self.is_reassembly_open());
    }

    /// True if a reported reassembly waits for its verdict.
    pub(super) fn is_reassembly_open(&self) -> bool {
        match &self.engine {
            Engine::Running(calibrator) => calibrator.estimate().reassembly_open,
            Engine::Stopped => false,
        }
    }

    /// Feeds a note to the estimator; returns `false` if that is stopped. An estimator that fails
    /// on a note is restarted and receives it again.
    fn step_note(&mut self, note: &Note) -> bool {
        let event = Event::Note(note.clone());
        self.step(event.clone()) || self.step(event)
    }

    /// Stores the state with a note, and adds the note to the state before: from either, the task
    /// continues with the note.
    fn keep_with_note(&mut self, note: &Note) {
        self.robot.set_reassembly_open(self.is_reassembly_open());
        self.save_checkpoint();
        let earlier = self.earlier_good.take();
        self.earlier_good = earlier.and_then(|earlier| self.with_note(&earlier, note));
    }

    fn with_note(&self, good: &Good, note: &Note) -> Option<Good> {
        let config = self.basis.calibrator.clone();
        let mut calibrator = Calibrator::restore(config, &good.checkpoint).ok()?;
        calibrator.step(Event::Note(note.clone()));
        let checkpoint = calibrator.checkpoint();
        Some(Good {
            checkpoint,
            ..*good
        })
    }
}
