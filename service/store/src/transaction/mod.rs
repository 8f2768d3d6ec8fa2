//! The path of records: a [`Job`] loads records, decides, and saves, in one transaction.
//!
//! The traits here read and write records and decide nothing. Whoever implements [`Job`] decides,
//! by the pure rules of `fleetcal-domain`.

mod accounts;
mod alerts;
mod answers;
mod approvals;
mod job;
mod robots;
mod task;
mod webhooks;

use async_trait::async_trait;
use fleetcal_cluster::{Duty, Seat, Tenure};
use fleetcal_model::{AuditId, RobotId, WallTime};

pub use accounts::{AccountRecords, SessionRecords, TokenRecords};
pub use alerts::AlertRecords;
pub use answers::{Answer, AnswerRecords, AnswerScope};
pub use approvals::ApprovalRecords;
pub use job::{Job, Waiting};
pub use robots::RobotRecords;
pub(crate) use task::{Asked, JobsTask};
pub use webhooks::WebhookRecords;

use crate::approvals::AuditRow;
use crate::audit::AuditEntry;
use crate::error::StoreError;

/// The records of one transaction. What is read stays as it was read until the transaction ends,
/// as if no other one ran: a database that runs several at once locks the rows, or repeats a job
/// whose rows another one changed.
///
/// # Errors
/// Every method gives [`StoreError::Database`] when the database fails and
/// [`StoreError::Corrupt`] when a row holds what this program never writes.
#[async_trait]
pub trait Records:
    AccountRecords
    + AlertRecords
    + AnswerRecords
    + ApprovalRecords
    + RobotRecords
    + SessionRecords
    + TokenRecords
    + WebhookRecords
    + Send
{
    /// Appends a row to the audit.
    async fn append_audit(&mut self, entry: &AuditEntry) -> Result<(), StoreError>;

    /// Rows of the audit after number `after` that are notes about a robot, oldest first, at most `limit`.
    async fn notes_after(
        &mut self,
        robot: &RobotId,
        after: AuditId,
        limit: u32,
    ) -> Result<Vec<AuditRow>, StoreError>;

    /// Whether a tenure has not ended, which it does not before the transaction has: so what an
    /// instance decides about its robot by itself is not written behind another one's back. Always
    /// where one service has the database.
    async fn holds_tenure(&mut self, tenure: &Tenure) -> Result<bool, StoreError>;

    /// Whether an instance has a duty in this life, which it keeps until the transaction has ended: so
    /// what it does for the whole cluster is not written beside what its successor does. Always where
    /// one service has the database.
    async fn holds_duty(&mut self, seat: &Seat, duty: Duty) -> Result<bool, StoreError>;

    /// Writes a row that nothing reads, to prove that the database can be written.
    async fn prove_writable(&mut self, now: WallTime) -> Result<(), StoreError>;
}

/// Where jobs are run.
#[async_trait]
pub trait RecordWriter: std::fmt::Debug + Send + 'static {
    /// Runs jobs, in their order as far as they meet the same records. Each leaves all of its writes
    /// or none, and a refused one leaves the others alone.
    ///
    /// One connection runs them in one transaction, with a savepoint each. A database that locks
    /// rows may give each its own transaction, and runs a job again whose transaction could not be
    /// brought into an order with the others.
    ///
    /// # Errors
    /// [`StoreError::Database`] when nothing was written; every job is then told so.
    async fn run(&mut self, jobs: &mut [Waiting]) -> Result<(), StoreError>;

    /// Closes the connection.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    async fn close(self: Box<Self>) -> Result<(), StoreError>;
}
