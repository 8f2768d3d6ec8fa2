//! Connection of a driver: runs a statement with its values, and gives rows.

use async_trait::async_trait;

use crate::dialect::Dialect;
use crate::statement::Statement;
use crate::value::Row;

/// Error of a statement, in the driver's words.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub struct StatementError(#[from] Box<dyn std::error::Error + Send + Sync>);

impl StatementError {
    /// Wraps a driver's error.
    pub fn new(error: impl std::error::Error + Send + Sync + 'static) -> Self {
        Self(Box::new(error))
    }
}

/// Error of a statement that returned none of the expected rows.
#[derive(Debug, thiserror::Error)]
#[error("the statement gave no row")]
pub(crate) struct NoRow;

/// A connection to a database, or a transaction on one.
#[async_trait]
pub trait Connection: Send {
    /// Returns the dialect of the database.
    fn dialect(&self) -> Dialect;

    /// Runs a statement and returns its rows.
    ///
    /// # Errors
    /// The driver's error.
    async fn rows(&mut self, statement: Statement) -> Result<Vec<Row>, StatementError>;

    /// Runs a statement without rows; returns the number of rows written.
    ///
    /// # Errors
    /// The driver's error.
    async fn execute(&mut self, statement: Statement) -> Result<u64, StatementError>;
}

/// Connections for reading, each used for one statement.
#[async_trait]
pub trait Pool: std::fmt::Debug + Send + Sync + 'static {
    /// Returns the dialect of the database.
    fn dialect(&self) -> Dialect;

    /// Runs a statement on any connection and returns its rows.
    ///
    /// # Errors
    /// The driver's error.
    async fn rows(&self, statement: Statement) -> Result<Vec<Row>, StatementError>;

    /// Closes the connections.
    async fn close(&self);
}
