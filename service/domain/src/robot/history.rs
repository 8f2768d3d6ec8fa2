//! History of a robot, and the journal that stores it.

use std::fmt;
use std::sync::Arc;

use fleetcal_model::{Generation, RobotId, RobotTime};
use fleetcal_proto::estimate::{ChangeDocument, EstimateDocument};
use fleetcal_proto::event::RobotEvent;
use serde::{Deserialize, Serialize};

use super::cross_track::CrossTrack;

/// Kind of entry that the service makes in a robot's history.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ServiceEventKind {
    /// New session, as the robot's clock jumped back by more than 5 s.
    SessionStarted,
    /// First or new configuration of the robot: its estimator starts from scratch.
    Configured,
    /// Restart of the estimator after a panic.
    EstimatorRestarted,
    /// Stop of the estimator after too many panics.
    EstimatorStopped,
}

/// Entry of a robot's history that the service makes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ServiceEvent {
    /// Kind of the entry.
    pub kind: ServiceEventKind,
    /// Time of the entry, ns since 1970: by the robot's clock if it has sent, else by the
    /// service's.
    pub stamp_ns: RobotTime,
    /// Details, for people.
    #[serde(default)]
    pub note: String,
}

/// Entry of a robot's history. Each has a `kind` and a `stamp_ns`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum HistoryEvent {
    /// Change or fault that the estimator detected.
    Change(ChangeDocument),
    /// Note of a person or a tool.
    Note(RobotEvent),
    /// Entry of the service.
    Service(ServiceEvent),
}

impl HistoryEvent {
    /// Time of the entry, ns since 1970, by the robot's clock.
    pub fn stamp_ns(&self) -> RobotTime {
        match self {
            Self::Change(change) => change.stamp_ns,
            Self::Note(note) => note.stamp_ns,
            Self::Service(event) => event.stamp_ns,
        }
    }
}

/// Journal of the fleet, which stores records beyond its lifetime. No method blocks; the journal
/// counts records that it cannot queue.
pub trait Journal: fmt::Debug + Send + Sync + 'static {
    /// Records one row of a robot's history, at most one a second of message time.
    fn record_history(&self, robot: &RobotId, document: &Arc<EstimateDocument>);
    /// Records an event of a robot.
    fn record_event(&self, robot: &RobotId, event: &Arc<HistoryEvent>);
    /// Replaces a robot's stored cross-track errors with one calibration.
    fn save_cross_track(&self, robot: &RobotId, generation: Generation, errors: &CrossTrack);
    /// Replaces a robot's stored checkpoint, from which its task continues after a restart.
    fn save_checkpoint(&self, robot: &RobotId, stamp_ns: RobotTime, state: Vec<u8>);
}
