//! The connections that write: one for jobs, one for telemetry.

use std::collections::{BTreeMap, BTreeSet};
use std::mem;
use std::sync::Arc;

use async_trait::async_trait;
use fleetcal_domain::limits;
use fleetcal_model::{RobotId, WallTime};
use fleetcal_sql::{Keys, SqlRecords, StatementError, telemetry};
use fleetcal_store::StoreError;
use fleetcal_store::backend::{Aged, Batch, RecordWriter, TelemetryWriter};
use fleetcal_store::transaction::Waiting;

use crate::advisory::AdvisoryLock;
use crate::cluster::{Fence, adoption};
use crate::connection::Session;
use crate::failure::Fate;
use crate::history::{self, History, Written};
use crate::line::Line;
use crate::old_days::OldDays;
use crate::servers::{Purpose, Servers};

/// Isolation in which every job sees the database as if it ran alone.
const BEGIN_JOB: &str = "BEGIN ISOLATION LEVEL SERIALIZABLE";
/// Isolation of telemetry, which only adds and overwrites.
const BEGIN_TELEMETRY: &str = "BEGIN ISOLATION LEVEL READ COMMITTED";

/// Connection of jobs.
#[derive(Debug)]
pub(crate) struct Records {
    line: Line,
    jobs: JobRuns,
}

/// Least number of runs of each job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JobRuns {
    /// Once, and again after a conflict with another transaction.
    Once,
    /// Once in vain, then again: this lets tests find a job that cannot be repeated.
    Twice,
}

/// Outcome of one attempt at a job.
enum Attempted {
    /// The job is over: committed, refused, or failed for good.
    Ended(Result<(), StoreError>),
    /// The attempt wrote nothing because of a conflict with another transaction.
    Again(StoreError),
    /// The connection is lost, and so are the jobs after this one.
    Lost(StoreError),
}

impl Records {
    pub(crate) fn new(servers: Arc<Servers>, session: Session, jobs: JobRuns) -> Self {
        Self {
            line: Line::new(servers, Purpose::Records, Some(session), None),
            jobs,
        }
    }

    /// Runs a job until it meets no conflict with another transaction.
    async fn run_one(&mut self, job: &mut Waiting) -> Attempted {
        let mut last = StoreError::Closed;
        if self.jobs == JobRuns::Twice {
            self.attempt(job, false).await;
        }
        for _ in 0..limits::POSTGRES_CONFLICT_TRIES {
            match self.attempt(job, true).await {
                Attempted::Again(error) => last = error,
                ended => return ended,
            }
            tokio::time::sleep(limits::POSTGRES_CONFLICT_PAUSE).await;
        }
        Attempted::Ended(Err(last))
    }

    /// Runs a job once, and commits its writes if it is to be `kept`.
    async fn attempt(&mut self, job: &mut Waiting, kept: bool) -> Attempted {
        let (session, keys) = match self.line.begin(BEGIN_JOB).await {
            Ok(begun) => begun,
            Err(error) => return Attempted::Lost(error),
        };
        let mut learnt = Vec::new();
        let ended = job
            .attempt(&mut SqlRecords {
                connection: &mut *session,
                keys: &mut *keys,
                learnt: &mut learnt,
            })
            .await;
        let attempted = match (session.fate(), ended) {
            (Fate::Well, Ok(())) if kept => match committed(session).await {
                Attempted::Ended(Ok(())) => return Attempted::Ended(Ok(())),
                not_committed => not_committed,
            },
            // A refusal: the job tells it.
            (Fate::Well, _) => Attempted::Ended(Ok(())),
            // A failure that the job has made nothing of: COMMIT would undo it without a word.
            (fate, Ok(())) => unwritten(fate, StoreError::database("run a job")(Swallowed)),
            (fate, Err(error)) => unwritten(fate, error),
        };
        for robot in learnt {
            keys.remove(&robot);
        }
        session.roll_back().await;
        attempted
    }
}

/// Error of a job that continued after a failed statement.
#[derive(Debug, thiserror::Error)]
#[error("a statement of the job failed")]
struct Swallowed;

/// Returns the outcome of a failure before COMMIT.
fn unwritten(fate: Fate, error: StoreError) -> Attempted {
    match fate {
        Fate::Conflict => Attempted::Again(error),
        Fate::Lost => Attempted::Lost(error),
        Fate::Well | Fate::Aborted => {
            tracing::error!(%error, source = ?std::error::Error::source(&error), "a job failed");
            Attempted::Ended(Err(error))
        }
    }
}

/// Commits a job.
async fn committed(session: &mut Session) -> Attempted {
    match session.commit().await {
        Ok(()) => Attempted::Ended(Ok(())),
        Err(error) => match session.fate() {
            // The server has answered: it has not committed.
            Fate::Conflict => Attempted::Again(not_committed(error)),
            Fate::Well | Fate::Aborted => Attempted::Ended(Err(not_committed(error))),
            Fate::Lost => Attempted::Lost(StoreError::Commit(Arc::new(error))),
        },
    }
}

fn not_committed(error: StatementError) -> StoreError {
    StoreError::database("commit what was written")(error)
}

#[async_trait]
impl RecordWriter for Records {
    async fn run(&mut self, jobs: &mut [Waiting]) -> Result<(), StoreError> {
        let mut failure: Option<StoreError> = None;
        for job in jobs {
            // Who waits behind a lost connection is answered at once.
            if let Some(error) = &failure {
                job.settle(Err(error.clone()));
                continue;
            }
            match self.run_one(job).await {
                Attempted::Ended(ended) => job.settle(ended),
                Attempted::Again(error) => job.settle(Err(error)),
                Attempted::Lost(error) => {
                    job.settle(Err(error.clone()));
                    self.line.session = None;
                    failure = Some(beside(error));
                }
            }
        }
        failure.map_or(Ok(()), Err)
    }

    async fn close(self: Box<Self>) -> Result<(), StoreError> {
        self.line.close().await;
        Ok(())
    }
}

/// Returns the error for jobs that were not begun because of another one's failure.
fn beside(error: StoreError) -> StoreError {
    match error {
        StoreError::Commit(source) => StoreError::Database {
            task: "be reached",
            source,
        },
        error => error,
    }
}

/// Connection of telemetry.
#[derive(Debug)]
pub(crate) struct Telemetry {
    line: Line,
    /// Fence for an instance of a cluster.
    fence: Option<Fence>,
    /// Robots whose history this instance has not examined yet, with the start of their estimation
    /// here.
    adopted: BTreeMap<RobotId, WallTime>,
    history: History,
    old_days: OldDays,
}

impl Telemetry {
    pub(crate) fn new(
        servers: Arc<Servers>,
        session: Session,
        history: History,
        lock: Option<AdvisoryLock>,
        fence: Option<Fence>,
    ) -> Self {
        Self {
            line: Line::new(servers, Purpose::Telemetry, Some(session), lock),
            fence,
            adopted: BTreeMap::new(),
            history,
            old_days: OldDays::default(),
        }
    }

    /// Performs some work in a transaction.
    async fn transact(&mut self, work: Work<'_>) -> Result<Done, StoreError> {
        let (session, keys) = self.line.begin(BEGIN_TELEMETRY).await?;
        let fence = self.fence.as_ref();
        let done = work.run(session, keys, &mut self.history, fence).await;
        let done = match done {
            Ok(mut done) => match session.commit().await {
                Ok(()) => {
                    self.history.take(mem::take(&mut done.written));
                    return Ok(done);
                }
                Err(error) => Err(StoreError::Commit(Arc::new(error))),
            },
            Err(error) => Err(error),
        };
        // Some of these may have been made by the transaction that is gone.
        keys.clear();
        session.roll_back().await;
        done
    }
}

/// Work of a transaction of telemetry.
enum Work<'b> {
    Write(&'b mut Batch),
    RollUp(&'b [(i64, i64)]),
    Adopt(&'b BTreeMap<RobotId, WallTime>),
    Prune(Aged, i64),
}

/// Result of the work.
#[derive(Debug, Default)]
struct Done {
    pruned: u64,
    /// True if there are days to be dropped.
    old_days: bool,
    written: Written,
}

impl Work<'_> {
    async fn run(
        self,
        session: &mut Session,
        keys: &mut Keys,
        history: &mut History,
        fence: Option<&Fence>,
    ) -> Result<Done, StoreError> {
        let mut done = Done::default();
        match self {
            Work::Write(batch) => {
                if let Some(fence) = fence {
                    fence.hold_back(session, batch).await?;
                }
                done.written = history.write(session, keys, &batch.history).await?;
                telemetry::write_beside_history(session, keys, batch).await?;
            }
            Work::RollUp(minutes) => match fence {
                Some(fence) => {
                    let own = fence.own_minutes(session, minutes).await?;
                    history::roll_up(session, &own).await?;
                }
                None => history::roll_up(session, minutes).await?,
            },
            Work::Adopt(robots) => {
                if let Some(fence) = fence {
                    let own = fence.own_robots(session, robots).await?;
                    adoption::note_start(session, &own).await?;
                    let own: Vec<i64> = own.iter().map(|(key, _)| *key).collect();
                    done.written = History::not_rolled_up(session, &own).await?;
                }
            }
            Work::Prune(Aged::Seconds, before_s) => {
                done.old_days = OldDays::are_there(session, before_s).await?;
                done.pruned = telemetry::prune_seconds_beside_days(session, before_s).await?;
            }
            Work::Prune(aged, before_s) => {
                done.pruned = telemetry::prune(session, aged, before_s).await?;
            }
        }
        Ok(done)
    }
}

#[async_trait]
impl TelemetryWriter for Telemetry {
    async fn write(&mut self, batch: &mut Batch) -> Result<(), StoreError> {
        self.transact(Work::Write(batch)).await.map(drop)
    }

    fn adopt(&mut self, robots: BTreeSet<RobotId>, now: WallTime) {
        self.adopted
            .extend(robots.into_iter().map(|robot| (robot, now)));
    }

    async fn catch_up(&mut self, everything: bool) -> Result<(), StoreError> {
        while !self.adopted.is_empty() {
            let part = self
                .adopted
                .iter()
                .take(limits::CLUSTER_ADOPTED_AT_ONCE_MAX);
            let part = part.map(|(robot, now)| (robot.clone(), *now)).collect();
            self.transact(Work::Adopt(&part)).await?;
            self.adopted.retain(|robot, _| !part.contains_key(robot));
        }
        while let Some(minutes) = self.history.next_part(everything) {
            self.transact(Work::RollUp(&minutes)).await?;
            self.history.rolled_up(&minutes);
        }
        Ok(())
    }

    async fn prune(&mut self, aged: Aged, before_s: i64) -> Result<u64, StoreError> {
        // What goes is in its minute before, and what goes of these in its hour.
        if matches!(aged, Aged::Seconds | Aged::Minutes) && self.history.reaches(before_s) {
            self.catch_up(true).await?;
        }
        let done = self.transact(Work::Prune(aged, before_s)).await?;
        let servers = self.line.servers();
        let days = &mut self.old_days;
        let dropped = days.drop_next(servers, done.old_days, before_s).await?;
        Ok(done.pruned + dropped)
    }

    async fn close(self: Box<Self>) -> Result<(), StoreError> {
        self.line.close().await;
        Ok(())
    }
}
