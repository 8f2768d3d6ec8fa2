//! Store of an administration command, which may run beside the service.

use std::fmt;

use fleetcal_domain::limits;
use fleetcal_model::AuditId;

use crate::accounts::{TokenRecord, UserRecord};
use crate::audit::AuditRow;
use crate::backend::{Reader, RecordWriter};
use crate::error::StoreError;
use crate::transaction::{Job, Waiting};

/// Users and tokens of a database. Each change is a transaction of its own.
#[derive(Debug)]
pub struct Administration {
    writer: Box<dyn RecordWriter>,
    reader: Box<dyn Reader>,
    /// Lock of the data folder against a starting service, held as long as this value.
    _held: Option<Box<dyn fmt::Debug + Send + Sync>>,
}

impl Administration {
    /// Makes an administration over these connections.
    pub fn new(
        writer: impl RecordWriter,
        reader: impl Reader,
        held: Option<Box<dyn fmt::Debug + Send + Sync>>,
    ) -> Self {
        Self {
            writer: Box::new(writer),
            reader: Box::new(reader),
            _held: held,
        }
    }

    /// Runs a job in a transaction of its own.
    ///
    /// # Errors
    /// The job's refusal, or the database's failure.
    pub async fn transact<J: Job>(&mut self, job: J) -> Result<J::Done, StoreError> {
        let (mut job, ended) = Waiting::new(job);
        let committed = self.writer.run(std::slice::from_mut(&mut job)).await;
        job.answer(committed);
        ended.await.map_err(|_| StoreError::Closed)?
    }

    /// The user of a name, upper or lower case.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn user_named(&self, name: &str) -> Result<Option<UserRecord>, StoreError> {
        self.reader.user_named(name).await
    }

    /// Every user.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn users(&self) -> Result<Vec<UserRecord>, StoreError> {
        self.reader.users(0, limits::USERS_MAX).await
    }

    /// Every token.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn tokens(&self) -> Result<Vec<TokenRecord>, StoreError> {
        self.reader.tokens(0, limits::TOKENS_MAX).await
    }

    /// Rows of the audit after number `after`, oldest first, at most `limit`.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn audit_after(
        &self,
        after: AuditId,
        limit: u32,
    ) -> Result<Vec<AuditRow>, StoreError> {
        self.reader.audit_after(after, limit).await
    }

    /// Closes the database.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn close(self) -> Result<(), StoreError> {
        self.reader.close().await;
        self.writer.close().await
    }
}
