//! The connection that writes: each batch is one transaction.

use async_trait::async_trait;
use fleetcal_store::StoreError;
use fleetcal_store::backend::{Batch, Outcomes, Writer};
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};
use sqlx::{ConnectOptions, Connection};

use super::row::Keys;
use super::write::write;

/// The one connection that writes, and how it is opened again.
///
/// A connection on which a transaction did not begin or end as it should is dropped: sqlx-sqlite
/// lowers its transaction depth only when COMMIT or ROLLBACK succeeds, and refuses every later
/// BEGIN IMMEDIATE on the same connection.
#[derive(Debug)]
pub(crate) struct SqliteWriter {
    options: SqliteConnectOptions,
    /// `None` after a failure, until the next commit opens another.
    connection: Option<SqliteConnection>,
    /// Never writes, and stays open as long as this value. While it is there, no connection is the
    /// first one, so that none recovers the write-ahead log: what a failed COMMIT left in the log
    /// stays out of the database and is overwritten. Without it, a batch that is written again
    /// could count twice.
    keeper: SqliteConnection,
    /// Keys of the robots of committed transactions.
    keys: Keys,
}

/// How a transaction ended.
#[derive(Debug)]
enum Ended {
    Committed(Outcomes),
    /// Nothing was written, and the connection can be used.
    RolledBack(StoreError),
    /// Nothing was written, and the connection cannot be used any more.
    Broken(StoreError),
}

impl SqliteWriter {
    /// Takes the first connection; `options` open the next ones, of the same database.
    ///
    /// # Errors
    /// [`StoreError::Database`] when a second connection cannot be opened beside it.
    pub(super) async fn new(
        connection: SqliteConnection,
        options: SqliteConnectOptions,
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
            keys: Keys::new(),
        })
    }

    /// The connection; a new one after a failure.
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
}

#[async_trait]
impl Writer for SqliteWriter {
    async fn commit(&mut self, batch: &Batch) -> Result<Outcomes, StoreError> {
        let mut connection = self.connection().await?;
        let ended = transact(&mut connection, &mut self.keys, batch).await;
        // Dropping a connection does not wait for it: its own thread closes it.
        if !matches!(ended, Ended::Broken(_)) {
            self.connection = Some(connection);
        }
        match ended {
            Ended::Committed(outcomes) => Ok(outcomes),
            Ended::RolledBack(error) | Ended::Broken(error) => {
                // Some of these may have been made by the transaction that is gone.
                self.keys.clear();
                Err(error)
            }
        }
    }

    async fn close(mut self: Box<Self>) -> Result<(), StoreError> {
        let connection = self.connection().await;
        // The keeper first: the last connection folds the log into the database.
        super::close(self.keeper).await?;
        super::close(connection?).await
    }
}

/// Writes a batch in one transaction.
async fn transact(connection: &mut SqliteConnection, keys: &mut Keys, batch: &Batch) -> Ended {
    // A deferred transaction that reads first could not become a writing one while another
    // process writes, whatever the busy timeout.
    let begun = connection.begin_with("BEGIN IMMEDIATE").await;
    let mut transaction = match begun.map_err(StoreError::database("begin to write")) {
        Ok(transaction) => transaction,
        Err(error) => return Ended::Broken(error),
    };
    match write(&mut transaction, keys, batch).await {
        Ok(outcomes) => match transaction.commit().await {
            Ok(()) => Ended::Committed(outcomes),
            Err(error) => Ended::Broken(StoreError::database("commit what was written")(error)),
        },
        Err(error) => match transaction.rollback().await {
            Ok(()) => Ended::RolledBack(error),
            Err(source) => {
                tracing::error!(%source, "a failed write could not be rolled back");
                Ended::Broken(error)
            }
        },
    }
}
