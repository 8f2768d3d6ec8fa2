//! A robot's history, and where it is kept.

use std::fmt;
use std::sync::Arc;

use fleetcal_model::{Generation, RobotId, RobotTime};
use fleetcal_proto::estimate::{ChangeDocument, EstimateDocument};
use fleetcal_proto::event::RobotEvent;
use serde::{Deserialize, Serialize};

use super::cross_track::CrossTrack;

/// What the service itself has to say in a robot's history.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ServiceEventKind {
    /// The robot's clock jumped back by more than 5 s: a new session began.
    SessionStarted,
    /// The robot was configured, or configured again: its estimator begins from nothing.
    Configured,
    /// The estimator panicked and was restarted.
    EstimatorRestarted,
    /// The estimator panicked too often and was stopped.
    EstimatorStopped,
}

/// An entry of a robot's history that the service makes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ServiceEvent {
    /// What happened.
    pub kind: ServiceEventKind,
    /// When, ns since 1970: by the robot's clock where it has sent, else by the service's.
    pub stamp_ns: RobotTime,
    /// More about it, for people.
    #[serde(default)]
    pub note: String,
}

/// An entry of a robot's history. Each has a `kind` and a `stamp_ns`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum HistoryEvent {
    /// The estimator saw a change or a fault.
    Change(ChangeDocument),
    /// A person or a tool attached a note.
    Note(RobotEvent),
    /// The service did something.
    Service(ServiceEvent),
}

impl HistoryEvent {
    /// When it happened, ns since 1970, by the robot's clock.
    pub fn stamp_ns(&self) -> RobotTime {
        match self {
            Self::Change(change) => change.stamp_ns,
            Self::Note(note) => note.stamp_ns,
            Self::Service(event) => event.stamp_ns,
        }
    }
}

/// Where the fleet writes what must outlive it. None of it blocks; what cannot be queued is
/// counted by the journal.
pub trait Journal: fmt::Debug + Send + Sync + 'static {
    /// One row of a robot's history, at most one a second of message time.
    fn record_history(&self, robot: &RobotId, document: &Arc<EstimateDocument>);
    /// Something happened to a robot.
    fn record_event(&self, robot: &RobotId, event: &Arc<HistoryEvent>);
    /// How well a robot follows its path with one calibration. It replaces the earlier one.
    fn save_cross_track(&self, robot: &RobotId, generation: Generation, errors: &CrossTrack);
    /// What a robot's task goes on from after a restart. It replaces the robot's earlier one.
    fn save_checkpoint(&self, robot: &RobotId, stamp_ns: RobotTime, state: Vec<u8>);
}
