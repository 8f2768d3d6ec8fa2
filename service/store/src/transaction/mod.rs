//! Path of records: a [`Job`] loads records, decides, and saves, in one transaction.
//!
//! The traits here read and write records without any decision. The implementations of [`Job`]
//! decide, by the pure rules of `fleetcal-domain`.

mod accounts;
mod alerts;
mod answers;
mod approvals;
mod job;
mod robots;
mod rollouts;
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
pub use rollouts::RolloutRecords;
pub(crate) use task::{Asked, JobsTask};
pub use webhooks::WebhookRecords;

use crate::audit::AuditEntry;
use crate::audit::AuditRow;
use crate::error::StoreError;

/// Records of one transaction. A record that was read stays the same until the transaction ends, as
/// if no other one ran: a database that runs several at once locks the rows, or repeats a job whose
/// rows another one changed.
///
/// # Errors
/// Every method returns [`StoreError::Database`] when the database fails and
/// [`StoreError::Corrupt`] when a row holds what this program never writes.
#[async_trait]
pub trait Records:
    AccountRecords
    + AlertRecords
    + AnswerRecords
    + ApprovalRecords
    + RobotRecords
    + RolloutRecords
    + SessionRecords
    + TokenRecords
    + WebhookRecords
    + Send
{
    /// Appends a row to the audit.
    async fn append_audit(&mut self, entry: &AuditEntry) -> Result<(), StoreError>;

    /// Notes about a robot in the audit after number `after`, oldest first, at most `limit`.
    async fn notes_after(
        &mut self,
        robot: &RobotId,
        after: AuditId,
        limit: u32,
    ) -> Result<Vec<AuditRow>, StoreError>;

    /// True if a tenure has not ended, and will not before the transaction has: so an instance's
    /// own decision about its robot is not written after another instance took over. Always true
    /// for a single service.
    async fn holds_tenure(&mut self, tenure: &Tenure) -> Result<bool, StoreError>;

    /// True if an instance has a duty in this life, and keeps it until the transaction has ended:
    /// so its work for the whole cluster is not written beside its successor's. Always true for a
    /// single service.
    async fn holds_duty(&mut self, seat: &Seat, duty: Duty) -> Result<bool, StoreError>;

    /// Writes a row that nothing reads, to prove that the database can be written.
    async fn prove_writable(&mut self, now: WallTime) -> Result<(), StoreError>;
}

/// Writer that runs jobs.
#[async_trait]
pub trait RecordWriter: std::fmt::Debug + Send + 'static {
    /// Runs jobs, in their order if they use the same records. Each leaves all of its writes or
    /// none, and a refused one does not affect the others.
    ///
    /// One connection runs them in one transaction, with a savepoint each. A database that locks
    /// rows may give each its own transaction, and runs a job again whose transaction could not be
    /// brought into an order with the others.
    ///
    /// # Errors
    /// [`StoreError::Database`] if nothing was written; every job then reports it.
    async fn run(&mut self, jobs: &mut [Waiting]) -> Result<(), StoreError>;

    /// Closes the connection.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    async fn close(self: Box<Self>) -> Result<(), StoreError>;
}
