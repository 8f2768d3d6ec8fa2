//! Path of telemetry: the fleet's reports, gathered for a second and written in batches. No caller
//! waits for it; rows without room in the queue, or that cannot be written, are lost and counted.

mod part;
mod pending;
mod retention;
mod task;

use std::collections::{BTreeMap, BTreeSet};

use async_trait::async_trait;
use fleetcal_cluster::ClaimId;
use fleetcal_model::WallTime;
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::EstimateDocument;

use crate::accounts::CredentialUse;
use crate::error::StoreError;
use crate::record::{CheckpointRecord, CrossTrackRecord, HistoryRow, NewEvent};

pub(crate) use part::Part;
pub(crate) use task::{Offered, TelemetryTask};

/// Writer of telemetry.
#[async_trait]
pub trait TelemetryWriter: std::fmt::Debug + Send + 'static {
    /// Writes all of a batch or nothing of it, in one transaction. Rows of an ended tenure are
    /// removed from it before, whatever the transaction's outcome.
    ///
    /// # Errors
    /// [`StoreError::Database`] if nothing was written.
    async fn write(&mut self, batch: &mut Batch) -> Result<(), StoreError>;

    /// Adopts robots that this instance has begun to estimate, whose history it continues.
    fn adopt(&mut self, _robots: BTreeSet<RobotId>, _now: WallTime) {}

    /// Deletes rows that are older than `before_s`, wall time since the Unix epoch: at most
    /// [`fleetcal_domain::limits::RETENTION_ROWS_MAX`] of each table. Returns their number.
    ///
    /// # Errors
    /// [`StoreError::Database`] if nothing was deleted.
    async fn prune(&mut self, aged: Aged, before_s: i64) -> Result<u64, StoreError>;

    /// Does deferred work such as roll-ups: work that is due, or `everything` if a caller waits for
    /// it. Failed work is repeated later.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    async fn catch_up(&mut self, _everything: bool) -> Result<(), StoreError> {
        Ok(())
    }

    /// Closes the connection.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    async fn close(self: Box<Self>) -> Result<(), StoreError>;
}

/// Report of the fleet.
#[derive(Debug)]
pub(crate) enum Telemetry {
    /// Estimate and its receipt.
    History(Box<EstimateDocument>, WallTime),
    /// Checkpoint of a robot.
    Checkpoint(CheckpointRecord),
    /// Cross-track errors of a robot.
    CrossTrack(Box<CrossTrackRecord>),
    /// An event.
    Event(Box<EventWrite>),
    /// Use of a session or token.
    Use(CredentialUse),
}

impl Telemetry {
    /// Robot of the report; `None` if it is about no robot.
    pub(crate) fn robot(&self) -> Option<&RobotId> {
        match self {
            Self::History(estimate, _) => Some(&estimate.robot),
            Self::Checkpoint(record) => Some(&record.robot),
            Self::CrossTrack(record) => Some(&record.robot),
            Self::Event(write) => Some(&write.event.robot),
            Self::Use(_) => None,
        }
    }
}

/// Recognition of a repeated event, so that it is not written twice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Repetition {
    /// No recognition: each event is a new one.
    Never,
    /// Recognition by robot, kind, stamp and note: of a message that was delivered or replayed
    /// twice, or that a person sent to the service, which passed it on to the estimator.
    Content,
    /// Recognition by robot, kind, stamp and note, with replacement of the earlier event: an
    /// estimator reports a change before its size is known.
    Completes,
}

/// Event to be written.
#[derive(Debug)]
pub struct EventWrite {
    /// The event.
    pub event: NewEvent,
    /// Recognition of its repetitions.
    pub repetition: Repetition,
}

/// Batch of rows for one transaction.
#[derive(Debug, Default)]
pub struct Batch {
    /// Seconds of history, with their roll-ups.
    pub history: Vec<HistoryRow>,
    /// Latest estimates and their receipt, wall time ns.
    pub current: Vec<(EstimateDocument, WallTime)>,
    /// Checkpoints of robots.
    pub checkpoints: Vec<CheckpointRecord>,
    /// Cross-track errors of robots.
    pub cross_tracks: Vec<CrossTrackRecord>,
    /// Events.
    pub events: Vec<EventWrite>,
    /// Uses of sessions and tokens.
    pub uses: Vec<CredentialUse>,
    /// Tenures that rows of robots were queued under; empty for a single service.
    pub claims: BTreeMap<RobotId, ClaimId>,
}

impl Batch {
    /// Number of its rows.
    pub fn rows(&self) -> usize {
        self.history.len()
            + self.current.len()
            + self.checkpoints.len()
            + self.cross_tracks.len()
            + self.events.len()
            + self.uses.len()
    }

    /// True if it has no rows.
    pub fn is_empty(&self) -> bool {
        self.rows() == 0
    }

    /// Robots of its rows, one for each row.
    fn robots(&self) -> impl Iterator<Item = &RobotId> {
        let history = self.history.iter().map(|row| &row.robot);
        let current = self.current.iter().map(|(estimate, _)| &estimate.robot);
        let checkpoints = self.checkpoints.iter().map(|record| &record.robot);
        let cross_tracks = self.cross_tracks.iter().map(|record| &record.robot);
        let events = self.events.iter().map(|write| &write.event.robot);
        let of_estimators = history.chain(current).chain(checkpoints);
        of_estimators.chain(cross_tracks).chain(events)
    }

    /// Removes the rows of robots that are not to be `kept`.
    pub fn retain(&mut self, kept: impl Fn(&RobotId) -> bool) {
        self.history.retain(|row| kept(&row.robot));
        self.current.retain(|(estimate, _)| kept(&estimate.robot));
        self.checkpoints.retain(|record| kept(&record.robot));
        self.cross_tracks.retain(|record| kept(&record.robot));
        self.events.retain(|write| kept(&write.event.robot));
    }

    /// Removes and returns its first rows, at most `rows_max`.
    fn take_first(&mut self, rows_max: usize) -> Self {
        let mut room = rows_max;
        Self {
            history: first(&mut self.history, &mut room),
            current: first(&mut self.current, &mut room),
            checkpoints: first(&mut self.checkpoints, &mut room),
            cross_tracks: first(&mut self.cross_tracks, &mut room),
            events: first(&mut self.events, &mut room),
            uses: first(&mut self.uses, &mut room),
            claims: BTreeMap::new(),
        }
    }

    /// Puts removed rows back in front.
    fn put_back(&mut self, mut taken: Self) {
        let later = std::mem::take(self);
        taken.history.extend(later.history);
        taken.current.extend(later.current);
        taken.checkpoints.extend(later.checkpoints);
        taken.cross_tracks.extend(later.cross_tracks);
        taken.events.extend(later.events);
        taken.uses.extend(later.uses);
        *self = taken;
    }
}

fn first<T>(rows: &mut Vec<T>, room: &mut usize) -> Vec<T> {
    let taken = rows.len().min(*room);
    *room -= taken;
    rows.drain(..taken).collect()
}

/// Kind of row that is deleted because of its age.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Aged {
    /// Seconds of history, by their receipt.
    Seconds,
    /// Minutes of history, by their receipt.
    Minutes,
    /// Hours of history, by their receipt.
    Hours,
    /// Events, by their receipt.
    Events,
    /// Answers to requests with an `Idempotency-Key`, by the request's receipt.
    Answers,
    /// Alerts, by their end.
    Alerts,
    /// Certificates, by the time of the verification.
    Certificates,
}

impl Aged {
    /// Every kind.
    pub const ALL: [Self; 7] = [
        Self::Seconds,
        Self::Minutes,
        Self::Hours,
        Self::Events,
        Self::Answers,
        Self::Alerts,
        Self::Certificates,
    ];
}
