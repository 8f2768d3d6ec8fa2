//! Statements of the store on sqlx's connections to PostgreSQL, each within its time.

use std::time::Duration;

use async_trait::async_trait;
use fleetcal_domain::limits;
use fleetcal_sql::{Connection, Dialect, Pool, Row, Statement, StatementError, Value};
use fleetcal_store::StoreError;
use sqlx::postgres::{PgArguments, PgConnection, PgPool, PgRow, PgValueRef, Postgres};
use sqlx::query::{QueryAs, QueryScalar};
use sqlx::{AssertSqlSafe, Decode, Executor, FromRow, Row as _, TypeInfo as _, ValueRef as _};
use tokio::sync::watch;
use tokio::time::Instant;

use crate::failure::{Fate, TimedOut};

/// A connection with the fate of its transaction.
#[derive(Debug)]
pub(crate) struct Session {
    connection: PgConnection,
    fate: Fate,
    /// Time limit of a statement.
    within: Duration,
}

impl Session {
    pub(crate) fn new(connection: PgConnection) -> Self {
        Self::within(limits::POSTGRES_STATEMENT_TIMEOUT, connection)
    }

    /// Makes a session whose statements have this time limit.
    pub(crate) fn within(within: Duration, connection: PgConnection) -> Self {
        Self {
            connection,
            fate: Fate::Well,
            within,
        }
    }

    /// Returns the fate of the transaction.
    pub(crate) fn fate(&self) -> Fate {
        self.fate
    }

    /// Begins a transaction.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub(crate) async fn begin(&mut self, begin: &'static str) -> Result<(), StoreError> {
        self.fate = Fate::Well;
        let began = self.run(begin).await;
        began.map_err(StoreError::database("begin to write"))
    }

    /// Commits. If this fails and the fate is [`Fate::Lost`], the outcome is unknown.
    ///
    /// # Errors
    /// The driver's error.
    pub(crate) async fn commit(&mut self) -> Result<(), StatementError> {
        self.run("COMMIT").await
    }

    /// Undoes the transaction; returns `false` if the connection is lost, which undoes it as well.
    pub(crate) async fn roll_back(&mut self) -> bool {
        self.fate != Fate::Lost && self.run("ROLLBACK").await.is_ok()
    }

    /// Closes the connection.
    pub(crate) async fn close(self) {
        let closing = sqlx::Connection::close(self.connection);
        let closed = tokio::time::timeout(limits::POSTGRES_STATEMENT_TIMEOUT, closing).await;
        if !matches!(closed, Ok(Ok(()))) {
            tracing::debug!("a connection to the database was not closed in order");
        }
    }

    /// Runs a statement without values and rows.
    pub(crate) async fn run(&mut self, sql: &'static str) -> Result<(), StatementError> {
        let ended = in_time_of(self.within, self.connection.execute(sql)).await;
        self.noted(ended).map(drop)
    }

    /// Runs a statement that may take long.
    pub(crate) async fn run_within(
        &mut self,
        within: Duration,
        sql: String,
    ) -> Result<(), StatementError> {
        let ended = in_time_of(within, self.connection.execute(AssertSqlSafe(sql))).await;
        self.noted(ended).map(drop)
    }

    /// Runs a statement whose values are arrays; returns the number of rows written.
    pub(crate) async fn execute_query(
        &mut self,
        query: sqlx::query::Query<'_, Postgres, PgArguments>,
    ) -> Result<u64, StatementError> {
        let ended = in_time_of(self.within, query.execute(&mut self.connection)).await;
        Ok(self.noted(ended)?.rows_affected())
    }

    /// Runs a query whose values may be arrays; returns its rows, each as `T`.
    pub(crate) async fn fetch<T>(
        &mut self,
        query: QueryAs<'_, Postgres, T, PgArguments>,
    ) -> Result<Vec<T>, StatementError>
    where
        T: for<'r> FromRow<'r, PgRow> + Send + Unpin,
    {
        let ended = in_time_of(self.within, query.fetch_all(&mut self.connection)).await;
        self.noted(ended)
    }

    /// Returns to a savepoint, which the statement names; the transaction continues.
    pub(crate) async fn return_to(
        &mut self,
        roll_back: &'static str,
    ) -> Result<(), StatementError> {
        self.run(roll_back).await?;
        self.fate = Fate::Well;
        Ok(())
    }

    /// Writes rows in the text format of `COPY`, within a time limit.
    pub(crate) async fn copy_in(
        &mut self,
        sql: &str,
        text: Vec<u8>,
        within: Duration,
    ) -> Result<(), StatementError> {
        let copying = async {
            let mut copy = self.connection.copy_in_raw(sql).await?;
            copy.send(text).await?;
            copy.finish().await
        };
        let ended = in_time_of(within, copying).await;
        self.noted(ended).map(drop)
    }

    /// Runs a query of one number that may take long.
    pub(crate) async fn scalar_within(
        &mut self,
        within: Duration,
        query: QueryScalar<'_, Postgres, i64, PgArguments>,
    ) -> Result<i64, StatementError> {
        let ended = in_time_of(within, query.fetch_one(&mut self.connection)).await;
        self.noted(ended)
    }

    /// Updates the transaction's fate by an error.
    fn noted<T>(&mut self, ended: Result<T, sqlx::Error>) -> Result<T, StatementError> {
        ended.map_err(|error| {
            self.fate = self.fate.max(Fate::after(&error));
            StatementError::new(error)
        })
    }
}

#[async_trait]
impl Connection for Session {
    fn dialect(&self) -> Dialect {
        Dialect::Postgres
    }

    async fn rows(&mut self, statement: Statement) -> Result<Vec<Row>, StatementError> {
        let ended = in_time_of(
            self.within,
            prepared(statement).fetch_all(&mut self.connection),
        )
        .await;
        rows_of(&self.noted(ended)?)
    }

    async fn execute(&mut self, statement: Statement) -> Result<u64, StatementError> {
        let ended = in_time_of(
            self.within,
            prepared(statement).execute(&mut self.connection),
        )
        .await;
        Ok(self.noted(ended)?.rows_affected())
    }
}

/// Connections for reading.
#[derive(Debug)]
pub(crate) struct ReadPool {
    pub(crate) pool: PgPool,
    /// Time until which no server is known to be usable.
    pub(crate) away_until: watch::Receiver<Option<Instant>>,
}

impl ReadPool {
    /// Completes shortly after all servers are known to be unusable: sqlx's pool tries again and
    /// again, and readers would wait for seconds.
    async fn until_away(&self) {
        let mut away_until = self.away_until.clone();
        let is_away = |until: &Option<Instant>| until.is_some_and(|until| until > Instant::now());
        if away_until.wait_for(is_away).await.is_err() {
            // The servers are gone, and the pool with them.
            return;
        }
        // A connection that is open is there at once.
        tokio::time::sleep(limits::POSTGRES_NEXT_HOST_AFTER).await;
    }
}

#[async_trait]
impl Pool for ReadPool {
    fn dialect(&self) -> Dialect {
        Dialect::Postgres
    }

    async fn rows(&self, statement: Statement) -> Result<Vec<Row>, StatementError> {
        let acquired = tokio::select! {
            acquired = self.pool.acquire() => acquired,
            () = self.until_away() => Err(sqlx::Error::PoolTimedOut),
        };
        let mut connection = acquired.map_err(StatementError::new)?;
        let reading = prepared(statement).fetch_all(&mut *connection);
        let read = in_time_of(limits::POSTGRES_READ_TIMEOUT, reading).await;
        if let Err(error) = &read
            && Fate::after(error) == Fate::Lost
        {
            // The pool would give it to the next one, with an answer still under way.
            drop(connection.detach());
        }
        rows_of(&read.map_err(StatementError::new)?)
    }

    async fn close(&self) {
        if in_time_of(limits::POSTGRES_STATEMENT_TIMEOUT, async {
            self.pool.close().await;
            Ok(())
        })
        .await
        .is_err()
        {
            tracing::debug!("the connections that read were not closed in order");
        }
    }
}

/// Awaits a future within the time limit of a statement.
pub(crate) async fn in_time<T>(
    future: impl Future<Output = Result<T, sqlx::Error>>,
) -> Result<T, sqlx::Error> {
    in_time_of(limits::POSTGRES_STATEMENT_TIMEOUT, future).await
}

/// Awaits a future within a time limit.
pub(crate) async fn in_time_of<T>(
    within: Duration,
    future: impl Future<Output = Result<T, sqlx::Error>>,
) -> Result<T, sqlx::Error> {
    let late = |_| {
        let seconds = within.as_secs_f32();
        let late = std::io::Error::new(std::io::ErrorKind::TimedOut, TimedOut { seconds });
        sqlx::Error::Io(late)
    };
    tokio::time::timeout(within, future).await.map_err(late)?
}

/// Prepares a statement with its values. sqlx caches it by its text, which contains no values.
fn prepared(statement: Statement) -> sqlx::query::Query<'static, Postgres, PgArguments> {
    let query = sqlx::query(AssertSqlSafe(statement.sql.into_owned()));
    statement
        .values
        .into_iter()
        .fold(query, |query, value| match value {
            Value::Integer(number) => query.bind(number),
            Value::Real(number) => query.bind(number),
            Value::Text(text) => query.bind(text.map(without_nul)),
            Value::Bytes(bytes) => query.bind(bytes),
            Value::Boolean(yes) => query.bind(yes),
            Value::Null => query.bind(None::<i64>),
        })
}

/// Replaces NUL in a text, which PostgreSQL cannot store and a robot's note may hold: a batch that
/// it refused would be written again for ever.
fn without_nul(text: String) -> String {
    if text.contains('\0') {
        text.replace('\0', "\u{fffd}")
    } else {
        text
    }
}

fn rows_of(rows: &[PgRow]) -> Result<Vec<Row>, StatementError> {
    rows.iter().map(row_of).collect()
}

fn row_of(row: &PgRow) -> Result<Row, StatementError> {
    let values = (0..row.len()).map(|index| {
        let value = row.try_get_raw(index).map_err(StatementError::new)?;
        value_of(value).map_err(StatementError::from)
    });
    values.collect::<Result<_, _>>().map(Row)
}

fn value_of(value: PgValueRef<'_>) -> Result<Value, sqlx::error::BoxDynError> {
    if value.is_null() {
        return Ok(Value::Null);
    }
    let type_info = value.type_info();
    Ok(match type_info.name() {
        "INT8" => Value::Integer(Some(<i64 as Decode<Postgres>>::decode(value)?)),
        "INT4" => Value::Integer(Some(<i32 as Decode<Postgres>>::decode(value)?.into())),
        "FLOAT8" => Value::Real(Some(<f64 as Decode<Postgres>>::decode(value)?)),
        "TEXT" | "VARCHAR" | "NAME" => {
            Value::Text(Some(<String as Decode<Postgres>>::decode(value)?))
        }
        "BYTEA" => Value::Bytes(Some(<Vec<u8> as Decode<Postgres>>::decode(value)?)),
        "BOOL" => Value::Boolean(Some(<bool as Decode<Postgres>>::decode(value)?)),
        other => return Err(format!("a value of type {other} is not expected").into()),
    })
}
