//! The connection that writes. Jobs and telemetry share it and take turns, in the order in which
//! they ask for it.

use std::path::Path;
use std::sync::Arc;

use async_trait::async_trait;
use fleetcal_sql::{Keys, SqlRecords, telemetry};
use fleetcal_store::StoreError;
use fleetcal_store::backend::{Aged, Batch, RecordWriter, TelemetryWriter};
use fleetcal_store::transaction::Waiting;
use sqlx::sqlite::{Sqlite, SqliteConnectOptions, SqliteConnection};
use sqlx::{ConnectOptions, Connection, Transaction};
use tokio::sync::Mutex;

use super::connection::OnConnection;
use super::place::Place;

/// The only connection that writes, with its reopening.
///
/// A connection on which a transaction did not begin or end as it should is dropped: sqlx-sqlite
/// lowers its transaction depth only when COMMIT or ROLLBACK succeeds, and refuses every later
/// BEGIN IMMEDIATE on the same connection.
#[derive(Debug)]
pub(crate) struct SqliteWriter {
    options: SqliteConnectOptions,
    /// `None` after a failure, until the next commit opens another.
    connection: Option<SqliteConnection>,
    /// Connection that never writes, and stays open as long as this value. While it exists, no
    /// connection is the first one, so that none recovers the write-ahead log: whatever a failed
    /// COMMIT left in the log stays out of the database and is overwritten. Without it, a batch
    /// that is written again could count twice.
    keeper: SqliteConnection,
    /// Files that it writes.
    place: Place,
    /// Keys of the robots of committed transactions.
    keys: Keys,
    jobs: JobRuns,
}

/// Number of runs of each job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum JobRuns {
    Once,
    /// Each job runs once in vain, then again, as in a database that failed to serialize its
    /// transaction.
    Twice,
}

/// Work of one transaction.
enum Work<'a> {
    Jobs(&'a mut [Waiting], JobRuns),
    Telemetry(&'a Batch),
    Prune(Aged, i64),
}

/// Outcome of a transaction.
#[derive(Debug)]
enum Ended {
    /// Committed, with this number of deleted rows.
    Committed(u64),
    /// Rolled back: nothing was written, and the connection remains usable.
    RolledBack(StoreError),
    /// Broken: nothing was written, and the connection is no longer usable.
    Broken(StoreError),
}

/// Reason for which a transaction was not committed.
enum Failed {
    /// The transaction has to be undone.
    Undo(StoreError),
    /// The state of its connection is unknown.
    Lost(StoreError),
}

impl From<StoreError> for Failed {
    fn from(error: StoreError) -> Self {
        Self::Undo(error)
    }
}

impl SqliteWriter {
    /// Makes the writer from the first connection to `database`; `options` open the next ones.
    ///
    /// # Errors
    /// [`StoreError::Database`] if a second connection cannot be opened beside it.
    pub(super) async fn new(
        connection: SqliteConnection,
        options: SqliteConnectOptions,
        jobs: JobRuns,
        database: &Path,
    ) -> Result<Self, StoreError> {
        let failed = || StoreError::database("be opened");
        let mut keeper = options
            .clone()
            .read_only(true)
            .connect()
            .await
            .map_err(failed())?;
        // The first read attaches it to the log.
        sqlx::query("SELECT count(*) FROM sqlite_schema")
            .execute(&mut keeper)
            .await
            .map_err(failed())?;
        Ok(Self {
            options,
            connection: Some(connection),
            keeper,
            place: Place::of(database),
            keys: Keys::new(),
            jobs,
        })
    }

    async fn run(&mut self, jobs: &mut [Waiting]) -> Result<(), StoreError> {
        let work = Work::Jobs(jobs, self.jobs);
        self.commit(work).await.map(drop)
    }

    async fn commit(&mut self, work: Work<'_>) -> Result<u64, StoreError> {
        let mut connection = self.connection().await?;
        let ended = transact(&mut connection, &mut self.keys, work).await;
        // Dropping a connection does not wait for it: its own thread closes it.
        if !matches!(ended, Ended::Broken(_)) {
            self.connection = Some(connection);
        }
        match ended {
            // Before anybody is told that it is stored.
            Ended::Committed(rows) => self.place.check().map(|()| rows),
            Ended::RolledBack(error) | Ended::Broken(error) => {
                // Some of these may have been made by the transaction that is gone.
                self.keys.clear();
                Err(error)
            }
        }
    }

    /// Returns the connection; a new one after a failure.
    async fn connection(&mut self) -> Result<SqliteConnection, StoreError> {
        match self.connection.take() {
            Some(connection) => Ok(connection),
            None => self
                .options
                .connect()
                .await
                .map_err(StoreError::database("be opened again")),
        }
    }

    pub(super) async fn close(mut self) -> Result<(), StoreError> {
        let connection = self.connection().await;
        // The keeper first: the last connection folds the log into the database.
        super::close(self.keeper).await?;
        super::close(connection?).await
    }
}

/// Writer shared by the task of jobs and that of telemetry. The lock is fair: after each
/// transaction of one task, the other has its turn.
#[derive(Debug, Clone)]
pub(crate) struct SharedWriter(Arc<Mutex<SqliteWriter>>);

impl SharedWriter {
    pub(super) fn new(writer: SqliteWriter) -> Self {
        Self(Arc::new(Mutex::new(writer)))
    }

    /// Closes the connection once it has no other holder.
    async fn let_go(self) -> Result<(), StoreError> {
        match Arc::into_inner(self.0) {
            Some(writer) => writer.into_inner().close().await,
            None => Ok(()),
        }
    }
}

#[async_trait]
impl RecordWriter for SharedWriter {
    async fn run(&mut self, jobs: &mut [Waiting]) -> Result<(), StoreError> {
        self.0.lock().await.run(jobs).await
    }

    async fn close(self: Box<Self>) -> Result<(), StoreError> {
        self.let_go().await
    }
}

#[async_trait]
impl TelemetryWriter for SharedWriter {
    async fn write(&mut self, batch: &mut Batch) -> Result<(), StoreError> {
        let mut writer = self.0.lock().await;
        writer.commit(Work::Telemetry(batch)).await.map(drop)
    }

    async fn prune(&mut self, aged: Aged, before_s: i64) -> Result<u64, StoreError> {
        self.0
            .lock()
            .await
            .commit(Work::Prune(aged, before_s))
            .await
    }

    async fn close(self: Box<Self>) -> Result<(), StoreError> {
        self.let_go().await
    }
}

/// Performs some work in one transaction.
async fn transact(connection: &mut SqliteConnection, keys: &mut Keys, work: Work<'_>) -> Ended {
    // A deferred transaction that reads first could not become a writing one while another
    // process writes, whatever the busy timeout.
    let begun = connection.begin_with("BEGIN IMMEDIATE").await;
    let mut transaction = match begun.map_err(StoreError::database("begin to write")) {
        Ok(transaction) => transaction,
        Err(error) => return Ended::Broken(error),
    };
    let done = match work {
        Work::Jobs(jobs, runs) => run(&mut transaction, keys, jobs, runs).await.map(|()| 0),
        Work::Telemetry(batch) => {
            let written = telemetry::write(&mut OnConnection(&mut transaction), keys, batch).await;
            written.map(|()| 0).map_err(Failed::from)
        }
        Work::Prune(aged, before_s) => {
            let pruned =
                telemetry::prune(&mut OnConnection(&mut transaction), aged, before_s).await;
            pruned.map_err(Failed::from)
        }
    };
    match done {
        Ok(rows) => match transaction.commit().await {
            Ok(()) => Ended::Committed(rows),
            Err(error) => Ended::Broken(StoreError::Commit(Arc::new(error))),
        },
        Err(Failed::Lost(error)) => Ended::Broken(error),
        Err(Failed::Undo(error)) => match transaction.rollback().await {
            Ok(()) => Ended::RolledBack(error),
            Err(source) => {
                tracing::error!(%source, "a failed write could not be rolled back");
                Ended::Broken(error)
            }
        },
    }
}

/// Runs jobs, each in a savepoint: the writes of a failed job are undone, and the others stay.
async fn run(
    transaction: &mut Transaction<'_, Sqlite>,
    keys: &mut Keys,
    jobs: &mut [Waiting],
    runs: JobRuns,
) -> Result<(), Failed> {
    for job in jobs {
        if runs == JobRuns::Twice {
            run_one(transaction, keys, job, false).await?;
        }
        run_one(transaction, keys, job, true).await?;
    }
    Ok(())
}

/// Runs a job in a savepoint, and undoes its writes if it fails or is not to be `kept`.
async fn run_one(
    transaction: &mut Transaction<'_, Sqlite>,
    keys: &mut Keys,
    job: &mut Waiting,
    kept: bool,
) -> Result<(), Failed> {
    let lost = |error: sqlx::Error| Failed::Lost(StoreError::database("undo a job")(error));
    let begun = transaction.begin().await;
    let mut savepoint = begun.map_err(StoreError::database("begin a job"))?;
    let mut learnt = Vec::new();
    let mut records = SqlRecords {
        connection: &mut OnConnection(&mut savepoint),
        keys: &mut *keys,
        learnt: &mut learnt,
    };
    let ended = job.attempt(&mut records).await;
    if let Err(error) = &ended
        && !error.is_refusal()
    {
        tracing::error!(%error, source = ?std::error::Error::source(error), "a job failed");
    }
    if ended.is_ok() && kept {
        return savepoint.commit().await.map_err(lost);
    }
    for robot in learnt {
        keys.remove(&robot);
    }
    // A failure after which SQLite has undone the whole transaction by itself shows here.
    savepoint.rollback().await.map_err(lost)
}
