//! What outlives the service: robots, their history, events and estimators' states.
//!
//! One task writes, a few connections read. Nothing outside this crate knows the database; what a
//! database has to do is said by the traits in `backend`.

mod accounts;
mod alerts;
mod approvals;
mod audit;
pub mod backend;
mod command;
mod error;
mod history;
mod interface;
mod journal;
mod liveness;
mod pending;
mod policy;
mod record;
mod retry;
mod webhooks;
mod writer;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::EstimateDocument;
use tokio::sync::{mpsc, oneshot};
use tokio::time::Instant;

pub use accounts::{
    Credential, CredentialUse, SessionRecord, TokenChange, TokenRecord, TokenWrite, UserChange,
    UserEdit, UserRecord, UserWrite, Written,
};
pub use alerts::{
    AcknowledgeWrite, AlertChange, AlertFilter, AlertMoment, AlertSelection, AlertWrite,
};
pub use approvals::{
    AuditFilter, AuditRow, Decided, Decision, HoldWrite, ProposalFilter, SiteHold,
};
pub use audit::AuditEntry;
pub use backend::{Cell, Stretch};
pub use error::{DriverError, StoreError};
pub use history::{History, HistoryQuery};
pub use journal::kind_of_note;
pub use policy::{PolicyWrite, StoredPolicy};
pub use record::{
    CheckpointRecord, CrossTrackRecord, CurrentRecord, EventKind, EventRecord, EventSource,
    Expected, HistoryRow, IdempotencyKey, NewEvent, RobotRecord, unpack_status,
};
pub use webhooks::{
    AttemptWrite, CreateWrite, DeleteWrite, DueDelivery, WebhookWrite, WebhookWritten,
};

use fleetcal_clock::SharedClock;

use backend::{Database, EventWrite, Reader, Repetition, RobotWrite, Writer};
use command::{Command, Queued, Reply};
use fleetcal_domain::access::Actor;
use fleetcal_domain::limits;
use fleetcal_domain::robot::RobotConfig;
use liveness::Liveness;
use writer::{WriterCounters, WriterTask};

/// What the store has done since it was opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StoreCounters {
    /// Transactions committed.
    pub commits: u64,
    /// Transactions that failed.
    pub failed_commits: u64,
    /// Seconds of history written.
    pub history_rows: u64,
    /// Rows that were not taken because too many were waiting.
    pub refused: u64,
    /// Rows that were taken and lost because the database failed.
    pub lost: u64,
    /// Seconds of history among them.
    pub lost_history: u64,
    /// Rows deleted because of their age.
    pub pruned_rows: u64,
    /// Writes that wait in memory now, those of the commit under way included.
    pub waiting: u64,
}

/// The store. Cheap to clone; the database is closed by [`Store::close`].
#[derive(Debug, Clone)]
pub struct Store {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    commands: mpsc::Sender<Queued>,
    reader: Box<dyn Reader>,
    clock: SharedClock,
    counters: Arc<WriterCounters>,
    refused: AtomicU64,
    /// Held as long as the store.
    database: Arc<dyn Database>,
}

impl Store {
    /// Starts the store's writer upon an open database.
    pub fn start(
        writer: impl Writer,
        reader: impl Reader,
        database: Arc<dyn Database>,
        clock: SharedClock,
    ) -> Self {
        let (commands, inbox) = mpsc::channel(limits::STORE_QUEUE_MAX);
        let counters = Arc::new(WriterCounters::default());
        let task = WriterTask::new(writer, Arc::clone(&clock), Arc::clone(&counters));
        let liveness = Liveness::new(Arc::clone(&counters), commands.downgrade());
        // The store alone holds the database.
        let held = Arc::downgrade(&database);
        let fresh = move || {
            let write = held.upgrade().map(|database| database.write_once());
            async move {
                match write {
                    Some(write) => write.await,
                    None => Err(StoreError::Closed),
                }
            }
        };
        tokio::spawn(liveness.watch(tokio::spawn(task.run(inbox)), fresh));
        let shared = Shared {
            commands,
            reader: Box::new(reader),
            clock,
            counters,
            refused: AtomicU64::new(0),
            database,
        };
        Self {
            shared: Arc::new(shared),
        }
    }

    /// Keeps an estimate that was received at `received_ns` (wall time): one second of history,
    /// and the robot's latest estimate. Never waits; what cannot be queued is counted.
    pub fn record_history(&self, estimate: &EstimateDocument, received_ns: i64) {
        self.offer(Command::History(Box::new(estimate.clone()), received_ns));
    }

    /// Keeps an estimator's state, of message time `stamp_ns`, as JSON. It replaces the robot's
    /// earlier one. Never waits; what cannot be queued is counted.
    pub fn save_checkpoint(&self, robot: &RobotId, stamp_ns: i64, state: String) {
        let received_ns = self.shared.clock.now_ns();
        let robot = robot.clone();
        self.offer(Command::Checkpoint(CheckpointRecord {
            robot,
            stamp_ns,
            received_ns,
            state,
        }));
    }

    /// Keeps an event. Never waits; what cannot be queued is counted.
    fn offer_event(&self, event: NewEvent, repetition: Repetition) {
        let write = EventWrite {
            event,
            repetition,
            noted_by: None,
        };
        self.offer(Command::Event(write, None));
    }

    /// Keeps an event that somebody notes and waits until it is committed. With a key, a request that was answered
    /// before is answered with the same event again.
    ///
    /// # Errors
    /// [`StoreError::KeyReused`] when the same key came with another request; otherwise the
    /// database's failure.
    pub async fn record_event(
        &self,
        event: NewEvent,
        noted_by: Actor,
        key: Option<IdempotencyKey>,
    ) -> Result<EventRecord, StoreError> {
        let write = EventWrite {
            event,
            repetition: key.map_or(Repetition::Never, Repetition::Key),
            noted_by: Some(noted_by),
        };
        self.ask(|reply| Command::Event(write, Some(reply))).await
    }

    /// Keeps a robot's configuration; gives its new version.
    ///
    /// # Errors
    /// [`StoreError::VersionConflict`] when it is not at the expected version; otherwise the
    /// database's failure.
    pub async fn save_robot(
        &self,
        robot: &RobotId,
        config: &RobotConfig,
        expected: Expected,
        actor: Actor,
    ) -> Result<u64, StoreError> {
        let now_ns = self.shared.clock.now_ns();
        let (robot, config) = (robot.clone(), config.clone());
        let write = RobotWrite {
            robot,
            config,
            expected,
            actor,
            now_ns,
        };
        self.ask(|reply| Command::Robot(Box::new(write), reply))
            .await
    }

    /// Waits until everything that was handed over before is committed.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn flush(&self) -> Result<(), StoreError> {
        self.ask(Command::Flush).await
    }

    /// Writes to the database, to find out whether that works.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn probe(&self) -> Result<(), StoreError> {
        self.ask(Command::Probe).await
    }

    /// Commits what was handed over before and closes the database. Later calls fail with
    /// [`StoreError::Closed`].
    ///
    /// # Errors
    /// [`StoreError::RowsLost`] when not everything could be written, or the database's failure.
    pub async fn close(&self) -> Result<(), StoreError> {
        // Readers first: the last connection folds the log into the database.
        self.shared.reader.close().await;
        self.ask(Command::Close).await
    }

    /// Every robot, by id.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn load_robots(&self) -> Result<Vec<RobotRecord>, StoreError> {
        self.shared.reader.robots().await
    }

    /// One robot; `None` when the store has never heard of it.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn load_robot(&self, id: &RobotId) -> Result<Option<RobotRecord>, StoreError> {
        self.shared.reader.robot(id).await
    }

    /// The latest stored estimate of every robot that has one; up to
    /// [`limits::STORE_CURRENT_EVERY`] old.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn load_current(&self) -> Result<Vec<CurrentRecord>, StoreError> {
        self.shared.reader.current().await
    }

    /// The state of every estimator.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn load_checkpoints(&self) -> Result<Vec<CheckpointRecord>, StoreError> {
        self.shared.reader.checkpoints().await
    }

    /// How well every robot follows its path, by generation.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn load_cross_tracks(&self) -> Result<Vec<CrossTrackRecord>, StoreError> {
        self.shared.reader.cross_tracks().await
    }

    /// A robot's history at the finest resolution that fits into `points_max` stretches.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn history(&self, query: &HistoryQuery) -> Result<History, StoreError> {
        history::read(self.shared.reader.as_ref(), query).await
    }

    /// The last second of message time that a robot's latest stored estimate is about.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn last_second(&self, robot: &RobotId) -> Result<Option<i64>, StoreError> {
        self.shared.reader.last_second(robot).await
    }

    /// A robot's events before number `before`, newest first, at most `limit`.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn events(
        &self,
        robot: &RobotId,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<EventRecord>, StoreError> {
        self.shared.reader.events(robot, before, limit).await
    }

    /// The newest migration of the database and the newest one that this program knows.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn schema(&self) -> Result<(i64, i64), StoreError> {
        Ok((
            self.shared.reader.schema_version().await?,
            self.shared.database.schema_known(),
        ))
    }

    /// What the store has done since it was opened.
    pub fn counters(&self) -> StoreCounters {
        let load = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        let counters = &self.shared.counters;
        StoreCounters {
            commits: load(&counters.commits),
            failed_commits: load(&counters.failed_commits),
            history_rows: load(&counters.history_rows),
            refused: load(&self.shared.refused),
            lost: load(&counters.lost),
            lost_history: load(&counters.lost_history),
            pruned_rows: load(&counters.pruned_rows),
            waiting: self.queued() as u64 + load(&counters.pending),
        }
    }

    /// Whether the writer has not written for [`limits::STORE_STUCK_AFTER`] although the database
    /// takes writes: then only a restart of the process helps.
    pub fn is_stuck(&self) -> bool {
        self.shared.counters.stuck.load(Ordering::Relaxed)
    }

    /// Commands that the writer has not taken yet.
    fn queued(&self) -> usize {
        let commands = &self.shared.commands;
        commands.max_capacity() - commands.capacity()
    }

    /// Queues what nobody waits for.
    fn offer(&self, command: Command) {
        let queued = Queued {
            command,
            asked_at: None,
        };
        if self.shared.commands.try_send(queued).is_err() {
            let refused = self.shared.refused.fetch_add(1, Ordering::Relaxed) + 1;
            // Lost data is an error, but one line for each row would be a second loss.
            if refused.is_power_of_two() {
                tracing::error!(refused, "the store's queue is full, rows are lost");
            }
        }
    }

    /// Queues a command and waits for its answer.
    async fn ask<T>(&self, command: impl FnOnce(Reply<T>) -> Command) -> Result<T, StoreError> {
        let (reply, answer) = oneshot::channel();
        let asked_at = Some(Instant::now());
        let place =
            tokio::time::timeout(limits::STORE_READ_TIMEOUT, self.shared.commands.reserve())
                .await
                .map_err(|_| StoreError::QueueFull {
                    waiting: self.queued(),
                })?
                .map_err(|_| StoreError::Closed)?;
        place.send(Queued {
            command: command(reply),
            asked_at,
        });
        answer.await.map_err(|_| StoreError::Closed)?
    }
}
