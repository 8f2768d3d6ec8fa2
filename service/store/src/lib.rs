//! Store of all that outlives the service: robots, their history, events and estimators' states.
//!
//! Two paths lead to the database. *Records* are changed by a [`Job`], for which its caller waits:
//! [`Store::transact`]. *Telemetry* is gathered and written in batches without a caller that waits.
//! A few connections read. The traits in [`backend`] and [`transaction`] define the database's
//! part; no decision is made here.

mod accounts;
mod administration;
mod alerts;
mod approvals;
mod audit;
pub mod backend;
mod certificates;
pub mod cluster;
mod counters;
pub mod database_url;
mod error;
mod history;
mod interface;
mod journal;
mod liveness;
mod policy;
mod record;
mod retry;
mod rollouts;
mod telemetry;
pub mod transaction;
mod webhooks;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use fleetcal_model::{RobotTime, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::EstimateDocument;
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinSet;

pub use accounts::{Credential, CredentialUse, SessionRecord, TokenRecord, UserRecord, Written};
pub use administration::Administration;
pub use alerts::{AlertFilter, AlertMoment, AlertSelection};
pub use approvals::{AuditFilter, DeploymentFreeze, ProposalFilter};
pub use audit::{AuditBroken, AuditEntry, AuditRow};
pub use backend::{Cell, Stretch};
pub use certificates::{CertificateFilter, CertificateRecord};
pub use error::{DriverError, StoreError};
pub use history::{History, HistoryQuery};
pub use journal::kind_of_note;
pub use policy::StoredPolicy;
pub use record::{
    CheckpointRecord, CrossTrackRecord, CurrentRecord, EventKind, EventRecord, EventSource,
    Expected, HistoryRow, IdempotencyKey, NewEvent, PackedStatus, RobotRecord,
};
pub use rollouts::RolloutFilter;
pub use transaction::{Job, Records};
pub use webhooks::DueDelivery;

use fleetcal_clock::SharedClock;

use backend::{Database, EventWrite, Reader, RecordWriter, Repetition, TelemetryWriter};
use cluster::{Claimed, Claims};
use counters::{Counters, PathCounters};
use fleetcal_domain::limits;
use liveness::{Liveness, Watched};
use prometheus_client::metrics::histogram::Histogram;
use telemetry::{Offered, Part, Telemetry, TelemetryTask};
use transaction::{Asked, JobsTask, Waiting};

/// Future that is compiled in this crate, and not in each that awaits it.
pub type Boxed<'a, T> = std::pin::Pin<Box<dyn Future<Output = T> + Send + 'a>>;

/// Counters of the store since it was opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StoreCounters {
    /// Transactions committed.
    pub commits: u64,
    /// Transactions that failed.
    pub failed_commits: u64,
    /// Seconds of history written.
    pub history_rows: u64,
    /// Rows that were refused because too many were waiting.
    pub refused: u64,
    /// Rows that were queued and lost because the database failed.
    pub lost: u64,
    /// Seconds of history among the lost rows.
    pub lost_history: u64,
    /// Rows deleted because of their age.
    pub pruned_rows: u64,
    /// Rows that were not written because another instance has their robots by now.
    pub fenced: u64,
    /// Writes in memory now, those of the commit under way included.
    pub waiting: u64,
}

/// Store, cheap to clone; [`Store::close`] closes the database.
#[derive(Debug, Clone)]
pub struct Store {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    jobs: mpsc::Sender<Asked>,
    telemetry: mpsc::Sender<Offered>,
    reader: Box<dyn Reader>,
    clock: SharedClock,
    counters: Counters,
    refused: AtomicU64,
    claims: Claims,
    part: Arc<Part>,
    /// Database, held as long as the store.
    database: Arc<dyn Database>,
}

impl Store {
    /// Starts the store's two tasks on an open database.
    pub fn start(
        records: impl RecordWriter,
        telemetry: impl TelemetryWriter,
        reader: impl Reader,
        database: Arc<dyn Database>,
        clock: SharedClock,
    ) -> Self {
        let (jobs, asked) = mpsc::channel(limits::STORE_JOBS_MAX);
        let (telemetry_in, offered) = mpsc::channel(limits::STORE_QUEUE_MAX);
        let counters = Counters::default();
        let is_alone = database.registry().is_none();
        let part = Arc::new(Part::new(is_alone));
        let claims = Claims::default();
        if !is_alone {
            claims.begin_cluster();
        }
        let (of_records, of_telemetry) = (&counters.records, &counters.telemetry);
        let run_jobs = JobsTask::new(records, Arc::clone(of_records));
        let write = TelemetryTask::new(
            telemetry,
            Arc::clone(&clock),
            Arc::clone(of_telemetry),
            Arc::clone(&counters.rows),
            Arc::clone(&part),
        );
        let liveness = Liveness::new(
            Watched::new(Arc::clone(of_records), jobs.downgrade()),
            Watched::new(Arc::clone(of_telemetry), telemetry_in.downgrade()),
            Arc::clone(&counters.stuck),
        );
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
        let mut tasks = JoinSet::new();
        tasks.spawn(run_jobs.run(asked));
        tasks.spawn(write.run(offered));
        tokio::spawn(liveness.watch(tasks, fresh));
        let shared = Shared {
            jobs,
            telemetry: telemetry_in,
            reader: Box::new(reader),
            clock,
            counters,
            refused: AtomicU64::new(0),
            claims,
            part,
            database,
        };
        Self {
            shared: Arc::new(shared),
        }
    }

    /// Runs a job in a transaction and waits until it is committed. Jobs are run in the order of
    /// their arrival; each is done wholly or not at all.
    ///
    /// # Errors
    /// The job's refusal; [`StoreError::Late`] if its turn came too late, [`StoreError::QueueFull`]
    /// if too many wait; otherwise the database's failure. Nothing has changed then, except perhaps
    /// after a failed commit, whose outcome is unknown.
    pub fn transact<J: Job>(&self, job: J) -> Boxed<'_, Result<J::Done, StoreError>> {
        let (job, ended) = Waiting::new(job);
        Box::pin(async move {
            self.ask(Asked::Run(job)).await?;
            ended.await.map_err(|_| StoreError::Closed)?
        })
    }

    /// Wall time of the service.
    pub fn now(&self) -> WallTime {
        self.shared.clock.now()
    }

    /// Stores an estimate that was received at `received_ns` (wall time) as one second of history,
    /// and as the robot's latest estimate. Never waits; counts an estimate that cannot be queued.
    pub fn record_history(&self, estimate: &EstimateDocument, received_ns: WallTime) {
        self.offer(Telemetry::History(Box::new(estimate.clone()), received_ns));
    }

    /// Stores a robot's checkpoint of message time `stamp_ns`, in the fleet's format, in place of
    /// its earlier one. Never waits; counts a checkpoint that cannot be queued.
    pub fn save_checkpoint(&self, robot: &RobotId, stamp_ns: RobotTime, state: Vec<u8>) {
        let received_ns = self.shared.clock.now();
        let robot = robot.clone();
        self.offer(Telemetry::Checkpoint(CheckpointRecord {
            robot,
            stamp_ns,
            received_ns,
            state,
        }));
    }

    /// Stores an event. Never waits; counts an event that cannot be queued.
    fn offer_event(&self, event: NewEvent, repetition: Repetition) {
        self.offer(Telemetry::Event(Box::new(EventWrite { event, repetition })));
    }

    /// Waits until every write handed over before is committed.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn flush(&self) -> Result<(), StoreError> {
        self.probe().await?;
        let (reply, ended) = oneshot::channel();
        let telemetry = &self.shared.telemetry;
        telemetry
            .send(Offered::Flush(reply))
            .await
            .map_err(|_| StoreError::Closed)?;
        ended.await.map_err(|_| StoreError::Closed)?
    }

    /// Tests the database with a write.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn probe(&self) -> Result<(), StoreError> {
        let now = self.now();
        self.transact(Prove { now }).await
    }

    /// Commits the writes handed over before and closes the database. Later calls fail with
    /// [`StoreError::Closed`].
    ///
    /// # Errors
    /// [`StoreError::RowsLost`] if a row could not be written, or the database's failure.
    pub async fn close(&self) -> Result<(), StoreError> {
        // Readers first: the last connection folds the log into the database.
        self.shared.reader.close().await;
        let (reply, jobs_ended) = oneshot::channel();
        self.ask(Asked::Close(reply)).await?;
        let jobs_ended = jobs_ended.await.map_err(|_| StoreError::Closed)?;
        let (reply, ended) = oneshot::channel();
        let telemetry = &self.shared.telemetry;
        telemetry
            .send(Offered::Close(reply))
            .await
            .map_err(|_| StoreError::Closed)?;
        ended.await.map_err(|_| StoreError::Closed)?.and(jobs_ended)
    }

    /// Every robot, by id.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn load_robots(&self) -> Result<Vec<RobotRecord>, StoreError> {
        self.shared.reader.robots().await
    }

    /// Reads one robot; `None` if the store has no record of it.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn load_robot(&self, id: &RobotId) -> Result<Option<RobotRecord>, StoreError> {
        self.shared.reader.robot(id).await
    }

    /// The latest stored estimate of every robot that has one; up to
    /// [`limits::STORE_CURRENT_LEARNT_EVERY`] old.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn load_current(&self) -> Result<Vec<CurrentRecord>, StoreError> {
        self.shared.reader.current().await
    }

    /// Checkpoints of all robots.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn load_checkpoints(&self) -> Result<Vec<CheckpointRecord>, StoreError> {
        self.shared.reader.checkpoints().await
    }

    /// Cross-track errors of every robot, by generation.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn load_cross_tracks(&self) -> Result<Vec<CrossTrackRecord>, StoreError> {
        self.shared.reader.cross_tracks().await
    }

    /// History of a robot at the finest resolution that fits into `points_max` stretches.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn history(&self, query: &HistoryQuery) -> Result<History, StoreError> {
        history::read(self.shared.reader.as_ref(), query).await
    }

    /// Last second of message time of a robot's latest stored estimate.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn last_second(&self, robot: &RobotId) -> Result<Option<i64>, StoreError> {
        self.shared.reader.last_second(robot).await
    }

    /// Events of a robot before number `before`, newest first, at most `limit`.
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

    /// Newest migration of the database, and newest one that this program knows.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn schema(&self) -> Result<(i64, i64), StoreError> {
        Ok((
            self.shared.reader.schema_version().await?,
            self.shared.database.schema_known(),
        ))
    }

    /// True if acknowledged writes survive the loss of the database's machine; `None` if this
    /// cannot be determined.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn survives_machine_loss(&self) -> Result<Option<bool>, StoreError> {
        self.shared.reader.survives_machine_loss().await
    }

    /// Counters of the store since it was opened.
    pub fn counters(&self) -> StoreCounters {
        let load = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        let Counters {
            records,
            telemetry,
            rows,
            ..
        } = &self.shared.counters;
        let both = |of: fn(&PathCounters) -> &AtomicU64| load(of(records)) + load(of(telemetry));
        StoreCounters {
            commits: both(|path| &path.commits),
            failed_commits: both(|path| &path.failed_commits),
            history_rows: load(&rows.history_rows),
            refused: load(&self.shared.refused),
            lost: load(&rows.lost),
            lost_history: load(&rows.lost_history),
            pruned_rows: load(&rows.pruned_rows),
            fenced: load(&rows.fenced),
            waiting: self.queued_jobs() as u64
                + self.queued_telemetry() as u64
                + both(|path| &path.pending),
        }
    }

    /// Durations of transactions since it was opened, by path.
    pub fn transaction_durations(&self) -> [(&'static str, Histogram); 2] {
        let counters = &self.shared.counters;
        [
            ("records", counters.records.durations.clone()),
            ("telemetry", counters.telemetry.durations.clone()),
        ]
    }

    /// True if one of the tasks has not written for [`limits::STORE_STUCK_AFTER`] although the
    /// database accepts writes: then only a restart of the process helps.
    pub fn is_stuck(&self) -> bool {
        self.shared.counters.stuck.load(Ordering::Relaxed)
    }

    /// Jobs that are queued and not begun.
    fn queued_jobs(&self) -> usize {
        let jobs = &self.shared.jobs;
        jobs.max_capacity() - jobs.capacity()
    }

    /// Telemetry that is queued and not received by its task.
    fn queued_telemetry(&self) -> usize {
        let telemetry = &self.shared.telemetry;
        telemetry.max_capacity() - telemetry.capacity()
    }

    /// Queues telemetry with the present tenure of its robot.
    fn offer(&self, telemetry: Telemetry) {
        let robot = telemetry.robot();
        let claimed = robot.map_or(Claimed::Alone, |robot| self.shared.claims.of(robot));
        let claim = match claimed {
            Claimed::Alone => None,
            Claimed::Under(claim) => Some(claim),
            Claimed::Not => return self.shared.counters.rows.fence(1),
        };
        let offered = Offered::Keep(telemetry, claim);
        if self.shared.telemetry.try_send(offered).is_err() {
            let refused = self.shared.refused.fetch_add(1, Ordering::Relaxed) + 1;
            // Lost data is an error, but one line for each row would be a second loss.
            if refused.is_power_of_two() {
                tracing::error!(refused, "the store's queue is full, rows are lost");
            }
        }
    }

    /// Queues a request of a caller that waits.
    async fn ask(&self, asked: Asked) -> Result<(), StoreError> {
        let place = self.shared.jobs.reserve();
        let place = tokio::time::timeout(limits::STORE_READ_TIMEOUT, place).await;
        let place = place.map_err(|_| StoreError::QueueFull {
            waiting: self.queued_jobs(),
        })?;
        place.map_err(|_| StoreError::Closed)?.send(asked);
        Ok(())
    }
}

/// Test write.
#[derive(Debug)]
struct Prove {
    now: WallTime,
}

#[async_trait::async_trait]
impl Job for Prove {
    type Done = ();

    async fn run(&self, records: &mut dyn Records) -> Result<(), StoreError> {
        records.prove_writable(self.now).await
    }
}
