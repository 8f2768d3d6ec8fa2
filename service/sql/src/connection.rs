//! Connection of a driver: runs a statement with its values, and gives rows.

use async_trait::async_trait;

use crate::dialect::Dialect;
use crate::statement::Statement;
use crate::value::Row;

/// Why a statement failed, as the driver says it.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub struct StatementError(#[from] Box<dyn std::error::Error + Send + Sync>);

impl StatementError {
    /// What a driver said.
    pub fn new(error: impl std::error::Error + Send + Sync + 'static) -> Self {
        Self(Box::new(error))
    }
}

/// A statement that had to give a row gave none.
#[derive(Debug, thiserror::Error)]
#[error("the statement gave no row")]
pub(crate) struct NoRow;

/// A connection to a database, or a transaction on one.
#[async_trait]
pub trait Connection: Send {
    /// What the database speaks.
    fn dialect(&self) -> Dialect;

    /// Runs a statement and gives its rows.
    ///
    /// # Errors
    /// What the driver says.
    async fn rows(&mut self, statement: Statement) -> Result<Vec<Row>, StatementError>;

    /// Runs a statement that gives no rows; says how many it wrote.
    ///
    /// # Errors
    /// What the driver says.
    async fn execute(&mut self, statement: Statement) -> Result<u64, StatementError>;
}

/// Connections that only read, taken for one statement each.
#[async_trait]
pub trait Pool: std::fmt::Debug + Send + Sync + 'static {
    /// What the database speaks.
    fn dialect(&self) -> Dialect;

    /// Runs a statement on any connection and gives its rows.
    ///
    /// # Errors
    /// What the driver says.
    async fn rows(&self, statement: Statement) -> Result<Vec<Row>, StatementError>;

    /// Closes the connections.
    async fn close(&self);
}
