//! Statements of the store on sqlx's connections to SQLite.

use async_trait::async_trait;
use fleetcal_sql::{Connection, Dialect, Pool, Row, Statement, StatementError, Value};
use sqlx::sqlite::{
    Sqlite, SqliteArguments, SqliteConnection, SqlitePool, SqliteRow, SqliteValueRef,
};
use sqlx::{AssertSqlSafe, Decode, Executor, Row as _, TypeInfo as _, ValueRef as _};

/// A connection, or a transaction on one.
pub(crate) struct OnConnection<'c>(pub(crate) &'c mut SqliteConnection);

#[async_trait]
impl Connection for OnConnection<'_> {
    fn dialect(&self) -> Dialect {
        Dialect::Sqlite
    }

    async fn rows(&mut self, statement: Statement) -> Result<Vec<Row>, StatementError> {
        rows(&mut *self.0, statement).await
    }

    async fn execute(&mut self, statement: Statement) -> Result<u64, StatementError> {
        let done = prepared(statement).execute(&mut *self.0).await;
        Ok(done.map_err(StatementError::new)?.rows_affected())
    }
}

/// Connections for reading.
#[derive(Debug)]
pub(crate) struct ReadPool(pub(crate) SqlitePool);

#[async_trait]
impl Pool for ReadPool {
    fn dialect(&self) -> Dialect {
        Dialect::Sqlite
    }

    async fn rows(&self, statement: Statement) -> Result<Vec<Row>, StatementError> {
        rows(&self.0, statement).await
    }

    async fn close(&self) {
        self.0.close().await;
    }
}

async fn rows(
    executor: impl Executor<'_, Database = Sqlite>,
    statement: Statement,
) -> Result<Vec<Row>, StatementError> {
    let rows = prepared(statement).fetch_all(executor).await;
    let rows = rows.map_err(StatementError::new)?;
    rows.iter().map(row_of).collect()
}

/// Prepares a statement with its values. sqlx caches it by its text, which contains no values.
fn prepared(statement: Statement) -> sqlx::query::Query<'static, Sqlite, SqliteArguments> {
    let query = sqlx::query(AssertSqlSafe(statement.sql.into_owned()));
    statement
        .values
        .into_iter()
        .fold(query, |query, value| match value {
            Value::Integer(number) => query.bind(number),
            Value::Real(number) => query.bind(number),
            Value::Text(text) => query.bind(text),
            Value::Bytes(bytes) => query.bind(bytes),
            Value::Boolean(yes) => query.bind(yes),
            Value::Null => query.bind(None::<i64>),
        })
}

fn row_of(row: &SqliteRow) -> Result<Row, StatementError> {
    let values = (0..row.len()).map(|index| {
        let value = row.try_get_raw(index).map_err(StatementError::new)?;
        value_of(value).map_err(StatementError::from)
    });
    values.collect::<Result<_, _>>().map(Row)
}

/// Reads a value by its own type: SQLite's columns have one, its expressions only their values.
fn value_of(value: SqliteValueRef<'_>) -> Result<Value, sqlx::error::BoxDynError> {
    if value.is_null() {
        return Ok(Value::Null);
    }
    let type_info = value.type_info();
    Ok(match type_info.name() {
        "INTEGER" => Value::Integer(Some(<i64 as Decode<Sqlite>>::decode(value)?)),
        "REAL" => Value::Real(Some(<f64 as Decode<Sqlite>>::decode(value)?)),
        "TEXT" => Value::Text(Some(<String as Decode<Sqlite>>::decode(value)?)),
        "BLOB" => Value::Bytes(Some(<Vec<u8> as Decode<Sqlite>>::decode(value)?)),
        other => return Err(format!("a value of type {other} is not expected").into()),
    })
}
