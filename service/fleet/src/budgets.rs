//! Budgets of one robot's history, so that no flood fills the disk.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use crate::budget::Budget;
use fleetcal_domain::limits::{EVENTS_PER_HOUR_MAX, NOTE_BYTES_PER_HOUR_MAX, NOTES_PER_HOUR_MAX};
use fleetcal_domain::robot::HistoryEvent;
use fleetcal_proto::RobotId;
use fleetcal_proto::event::RobotEvent;

use crate::live::LiveUpdate;
use crate::registry::Fleet;

/// Hourly history budgets of one robot.
#[derive(Debug)]
pub struct HistoryBudgets {
    notes: Budget,
    note_bytes: Budget,
    events: Budget,
}

impl Default for HistoryBudgets {
    fn default() -> Self {
        Self {
            notes: Budget::per_hour(NOTES_PER_HOUR_MAX),
            note_bytes: Budget::per_hour(NOTE_BYTES_PER_HOUR_MAX),
            events: Budget::per_hour(EVENTS_PER_HOUR_MAX),
        }
    }
}

impl HistoryBudgets {
    /// Spends the budget for a note of the robot; returns `false`, and counts the note, if the
    /// budget of the hour is used up.
    pub fn take_note(&mut self, fleet: &Fleet, note: &RobotEvent) -> bool {
        let now = fleet.clock.elapsed();
        let bytes = u32::try_from(note.note.len()).unwrap_or(u32::MAX);
        let fits = self.notes.take(now, 1) && self.note_bytes.take(now, bytes);
        if !fits {
            let counts = &fleet.counts;
            counts.notes_beyond_budget.fetch_add(1, Ordering::Relaxed);
        }
        fits
    }

    /// Records an event of the estimator in the robot's history while the hourly budget lasts;
    /// listeners receive it in any case.
    pub fn record(&mut self, fleet: &Fleet, robot: &RobotId, event: HistoryEvent) {
        if self.events.take(fleet.clock.elapsed(), 1) {
            fleet.record(robot, event);
            return;
        }
        let counts = &fleet.counts;
        counts.events_beyond_budget.fetch_add(1, Ordering::Relaxed);
        let (robot, event) = (robot.clone(), Arc::new(event));
        fleet.announce(LiveUpdate::Event {
            robot,
            event,
            author: None,
        });
    }
}
