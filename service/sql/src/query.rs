//! Statements: their making and running.

use std::borrow::Cow;
use std::marker::PhantomData;

use crate::connection::{Connection, NoRow, StatementError};
use crate::statement::Statement;
use crate::value::{FromValue, Row, Value};

/// Makes a statement whose values are bound one after another.
pub(crate) fn query(sql: impl Into<Cow<'static, str>>) -> Query {
    Query(Statement {
        sql: sql.into(),
        values: Vec::new(),
    })
}

/// Makes a statement that reads the first column of a row.
pub(crate) fn query_scalar<T: FromValue>(sql: impl Into<Cow<'static, str>>) -> Scalar<T> {
    Scalar(query(sql), PhantomData)
}

/// A statement in the making.
#[derive(Debug)]
pub(crate) struct Query(Statement);

impl Query {
    /// Binds the next value.
    pub(crate) fn bind(mut self, value: impl Into<Value>) -> Self {
        self.0.values.push(value.into());
        self
    }

    /// Appends to the text.
    pub(crate) fn push(mut self, sql: &str) -> Self {
        self.0.sql.to_mut().push_str(sql);
        self
    }

    /// Appends a value to the text.
    pub(crate) fn push_bind(self, value: impl Into<Value>) -> Self {
        let query = self.bind(value);
        let place = format!("${}", query.0.values.len());
        query.push(&place)
    }

    pub(crate) async fn fetch_all(
        self,
        connection: &mut dyn Connection,
    ) -> Result<Vec<Row>, StatementError> {
        connection.rows(self.0).await
    }

    pub(crate) async fn fetch_optional(
        self,
        connection: &mut dyn Connection,
    ) -> Result<Option<Row>, StatementError> {
        Ok(connection.rows(self.0).await?.into_iter().next())
    }

    pub(crate) async fn fetch_one(
        self,
        connection: &mut dyn Connection,
    ) -> Result<Row, StatementError> {
        let row = self.fetch_optional(connection).await?;
        row.ok_or_else(|| StatementError::new(NoRow))
    }

    /// Runs it; returns the number of rows written.
    pub(crate) async fn execute(
        self,
        connection: &mut dyn Connection,
    ) -> Result<u64, StatementError> {
        connection.execute(self.0).await
    }
}

/// A statement that reads one value.
#[derive(Debug)]
pub(crate) struct Scalar<T>(Query, PhantomData<T>);

impl<T: FromValue> Scalar<T> {
    /// Binds the next value.
    pub(crate) fn bind(self, value: impl Into<Value>) -> Self {
        Self(self.0.bind(value), PhantomData)
    }

    pub(crate) async fn fetch_one(
        self,
        connection: &mut dyn Connection,
    ) -> Result<T, StatementError> {
        let row = self.0.fetch_one(connection).await?;
        row.get(0).map_err(StatementError::new)
    }

    pub(crate) async fn fetch_optional(
        self,
        connection: &mut dyn Connection,
    ) -> Result<Option<T>, StatementError> {
        let row = self.0.fetch_optional(connection).await?;
        row.map(|row| row.get(0))
            .transpose()
            .map_err(StatementError::new)
    }
}
