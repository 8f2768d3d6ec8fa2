//! The path of telemetry: what the fleet tells of itself, gathered for a second and written in
//! batches. Nobody waits for it, and what finds no room or cannot be written is lost and counted.

mod pending;
mod retention;
mod task;

use async_trait::async_trait;
use fleetcal_model::WallTime;
use fleetcal_proto::estimate::EstimateDocument;

use crate::accounts::CredentialUse;
use crate::error::StoreError;
use crate::record::{CheckpointRecord, CrossTrackRecord, HistoryRow, NewEvent};

pub(crate) use task::{Offered, TelemetryTask};

/// Where telemetry is written.
#[async_trait]
pub trait TelemetryWriter: std::fmt::Debug + Send + 'static {
    /// Writes all of a batch or nothing of it, in one transaction.
    ///
    /// # Errors
    /// [`StoreError::Database`] when nothing was written.
    async fn write(&mut self, batch: &Batch) -> Result<(), StoreError>;

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
