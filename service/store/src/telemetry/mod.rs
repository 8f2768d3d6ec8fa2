//! The path of telemetry: what the fleet tells of itself, gathered for a second and written in
//! batches. Nobody waits for it, and what finds no room or cannot be written is lost and counted.

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

/// Where telemetry is written.
#[async_trait]
pub trait TelemetryWriter: std::fmt::Debug + Send + 'static {
    /// Writes all of a batch or nothing of it, in one transaction. What bears a tenure that has
    /// ended is taken out of it before, however the transaction ends.
    ///
    /// # Errors
    /// [`StoreError::Database`] when nothing was written.
    async fn write(&mut self, batch: &mut Batch) -> Result<(), StoreError>;

    /// Takes that this instance has begun to estimate robots, whose history it has to go on with.
    fn adopt(&mut self, _robots: BTreeSet<RobotId>, _now: WallTime) {}

    /// Deletes rows that are older than `before_s`, wall time since the Unix epoch: at most
    /// [`fleetcal_domain::limits::RETENTION_ROWS_MAX`] of each table. Gives their number.
    ///
    /// # Errors
    /// [`StoreError::Database`] when nothing was deleted.
    async fn prune(&mut self, aged: Aged, before_s: i64) -> Result<u64, StoreError>;

    /// Does what writing put off, such as roll-ups: what is due, or `everything` when somebody waits
    /// for it. What fails is done later.
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

/// What the fleet tells of itself.
#[derive(Debug)]
pub(crate) enum Telemetry {
    /// An estimate, and when it was received.
    History(Box<EstimateDocument>, WallTime),
    /// An estimator's state.
    Checkpoint(CheckpointRecord),
    /// How well a robot follows its path.
    CrossTrack(Box<CrossTrackRecord>),
    /// An event.
    Event(Box<EventWrite>),
    /// That a session or token was used.
    Use(CredentialUse),
}

impl Telemetry {
    /// The robot that it is about; `None` of what no robot has told.
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

/// How an event that comes again is recognised, so that it is not written twice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Repetition {
    /// It is not: each is an event of its own.
    Never,
    /// By its robot, kind, stamp and note: a message that was delivered or replayed twice, or that
    /// a person gave the service, which passed it on to the estimator.
    Content,
    /// By its robot, kind, stamp and note, and what it says now replaces what it said: an estimator
    /// tells of a change before it knows how far it went.
    Completes,
}

/// An event to be written.
#[derive(Debug)]
pub struct EventWrite {
    /// The event.
    pub event: NewEvent,
    /// What makes it recognisable when it comes again.
    pub repetition: Repetition,
}

/// What one transaction writes.
#[derive(Debug, Default)]
pub struct Batch {
    /// Seconds of history, with their roll-ups.
    pub history: Vec<HistoryRow>,
    /// Latest estimates, with when they were received, wall time ns.
    pub current: Vec<(EstimateDocument, WallTime)>,
    /// States of estimators.
    pub checkpoints: Vec<CheckpointRecord>,
    /// How well robots follow their paths.
    pub cross_tracks: Vec<CrossTrackRecord>,
    /// Events.
    pub events: Vec<EventWrite>,
    /// Sessions and tokens that were used.
    pub uses: Vec<CredentialUse>,
    /// The tenures in which rows of robots were handed over; none where one service has all robots.
    pub claims: BTreeMap<RobotId, ClaimId>,
}

impl Batch {
    /// How many rows it has.
    pub fn rows(&self) -> usize {
        self.history.len()
            + self.current.len()
            + self.checkpoints.len()
            + self.cross_tracks.len()
            + self.events.len()
            + self.uses.len()
    }

    /// Whether there is nothing to write.
    pub fn is_empty(&self) -> bool {
        self.rows() == 0
    }

    /// The robots that its rows are about, one for each row.
    fn robots(&self) -> impl Iterator<Item = &RobotId> {
        let history = self.history.iter().map(|row| &row.robot);
        let current = self.current.iter().map(|(estimate, _)| &estimate.robot);
        let checkpoints = self.checkpoints.iter().map(|record| &record.robot);
        let cross_tracks = self.cross_tracks.iter().map(|record| &record.robot);
        let events = self.events.iter().map(|write| &write.event.robot);
        let of_estimators = history.chain(current).chain(checkpoints);
        of_estimators.chain(cross_tracks).chain(events)
    }

    /// Takes out the rows of robots that are not to be `kept`.
    pub fn retain(&mut self, kept: impl Fn(&RobotId) -> bool) {
        self.history.retain(|row| kept(&row.robot));
        self.current.retain(|(estimate, _)| kept(&estimate.robot));
        self.checkpoints.retain(|record| kept(&record.robot));
        self.cross_tracks.retain(|record| kept(&record.robot));
        self.events.retain(|write| kept(&write.event.robot));
    }

    /// Takes out its first rows, at most `rows_max`.
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

    /// Puts rows that were taken out in front again.
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

/// Rows that are deleted because of their age.
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
}

impl Aged {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::Seconds,
        Self::Minutes,
        Self::Hours,
        Self::Events,
        Self::Answers,
        Self::Alerts,
    ];
}
