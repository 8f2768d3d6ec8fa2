//! Journal of the fleet: records handed over for storage.

use std::sync::Arc;

use fleetcal_domain::robot::{CrossTrack, HistoryEvent, Journal, ServiceEvent, ServiceEventKind};
use fleetcal_model::{ChangeKind, Generation, NoteKind, RobotTime, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::{ChangeDocument, EstimateDocument};
use fleetcal_proto::event::RobotEvent;

use super::Store;
use super::backend::Repetition;
use super::record::{CrossTrackRecord, EventKind, EventSource, NewEvent};
use super::telemetry::Telemetry;

impl Journal for Store {
    fn record_history(&self, _robot: &RobotId, document: &Arc<EstimateDocument>) {
        Self::record_history(self, document, self.shared.clock.now());
    }

    fn record_event(&self, robot: &RobotId, event: &Arc<HistoryEvent>) {
        let received_ns = self.shared.clock.now();
        let repetition = match **event {
            HistoryEvent::Note(_) => Repetition::Content,
            HistoryEvent::Change(_) => Repetition::Completes,
            HistoryEvent::Service(_) => Repetition::Never,
        };
        self.offer_event(NewEvent::of(robot, event, received_ns), repetition);
    }

    fn save_cross_track(&self, robot: &RobotId, generation: Generation, errors: &CrossTrack) {
        let record = CrossTrackRecord {
            robot: robot.clone(),
            generation,
            errors: errors.clone(),
        };
        self.offer(Telemetry::CrossTrack(Box::new(record)));
    }

    fn save_checkpoint(&self, robot: &RobotId, stamp_ns: RobotTime, state: Vec<u8>) {
        Self::save_checkpoint(self, robot, stamp_ns, state);
    }
}

impl NewEvent {
    /// Makes the stored form of an event that the service received at `received_ns` (wall time).
    pub fn of(robot: &RobotId, event: &HistoryEvent, received_ns: WallTime) -> Self {
        let empty = Self {
            robot: robot.clone(),
            kind: EventKind::Fault,
            stamp_ns: event.stamp_ns(),
            received_ns,
            source: EventSource::Service,
            author: None,
            note: None,
            details: None,
        };
        match event {
            HistoryEvent::Change(change) => Self {
                kind: kind_of_change(change.kind),
                source: EventSource::Estimator,
                details: Some(details_of_change(change)),
                ..empty
            },
            HistoryEvent::Note(RobotEvent { kind, note, .. }) => Self {
                kind: kind_of_note(*kind),
                source: EventSource::Robot,
                note: words(note),
                ..empty
            },
            HistoryEvent::Service(ServiceEvent { kind, note, .. }) => Self {
                kind: kind_of_service(*kind),
                note: words(note),
                ..empty
            },
        }
    }
}

impl NewEvent {
    /// Same event as a note by a person or a tool of the site.
    #[must_use]
    pub fn noted_by(self, author: String) -> Self {
        Self {
            source: EventSource::Person,
            author: Some(author),
            ..self
        }
    }
}

fn words(note: &str) -> Option<String> {
    (!note.is_empty()).then(|| note.to_owned())
}

/// Parts of a change without a column of their own.
fn details_of_change(change: &ChangeDocument) -> serde_json::Value {
    serde_json::json!({
        "cause": change.cause,
        "time_s": change.time_s,
        "onset_s": change.onset_s,
        "change": change.change,
    })
}

/// Kind that a person's or robot's note is stored under.
pub const fn kind_of_note(kind: NoteKind) -> EventKind {
    match kind {
        NoteKind::Reassembled => EventKind::Reassembled,
        NoteKind::Maintenance => EventKind::Maintenance,
        NoteKind::PowerOn => EventKind::PowerOn,
    }
}

const fn kind_of_change(kind: ChangeKind) -> EventKind {
    match kind {
        ChangeKind::CalibrationChanged => EventKind::CalibrationChanged,
        ChangeKind::CalibrationConfirmed => EventKind::CalibrationConfirmed,
        ChangeKind::CalibrationLearned => EventKind::CalibrationLearned,
        ChangeKind::Fault => EventKind::Fault,
    }
}

const fn kind_of_service(kind: ServiceEventKind) -> EventKind {
    match kind {
        ServiceEventKind::SessionStarted => EventKind::SessionStarted,
        ServiceEventKind::Configured => EventKind::Configured,
        ServiceEventKind::EstimatorRestarted => EventKind::EstimatorRestarted,
        ServiceEventKind::EstimatorStopped => EventKind::EstimatorStopped,
    }
}
