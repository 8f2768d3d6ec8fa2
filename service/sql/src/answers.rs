//! Answers already given to requests with an `Idempotency-Key`: three tables, since each names what
//! was made in another one.

use async_trait::async_trait;
use fleetcal_model::WallTime;
use fleetcal_store::transaction::{Answer, AnswerRecords, AnswerScope};
use fleetcal_store::{IdempotencyKey, StoreError};

use super::query::query;
use super::row::{NS_PER_S, column, corrupt};
use super::transaction::SqlRecords;
use super::value::Row;

/// Statements of a scope, and its value in them.
struct Table<'a> {
    scope: &'a str,
    select: &'static str,
    insert: &'static str,
    /// Unit of its column of time, ns.
    unit_ns: i64,
}

impl<'a> Table<'a> {
    fn of(scope: AnswerScope<'a>) -> Self {
        const ACCESS_SELECT: &str =
            "SELECT request_sha256, id FROM access_idempotency WHERE made = $1 AND key = $2";
        const ACCESS_INSERT: &str = "INSERT INTO access_idempotency
             (made, key, request_sha256, id, received_ns) VALUES ($1, $2, $3, $4, $5)";
        match scope {
            AnswerScope::Event(robot) => Self {
                scope: robot.as_str(),
                select: "SELECT request_sha256, event FROM idempotency
                         WHERE scope = $1 AND key = $2",
                insert: "INSERT INTO idempotency (scope, key, request_sha256, event, received)
                         VALUES ($1, $2, $3, $4, $5)",
                unit_ns: NS_PER_S,
            },
            AnswerScope::Proposal(robot) => Self {
                scope: robot.as_str(),
                select: "SELECT request_sha256, proposal FROM proposal_request
                         WHERE robot = $1 AND key = $2",
                insert: "INSERT INTO proposal_request
                         (robot, key, request_sha256, proposal, received)
                         VALUES ($1, $2, $3, $4, $5)",
                unit_ns: NS_PER_S,
            },
            AnswerScope::User => Self {
                scope: "user",
                select: ACCESS_SELECT,
                insert: ACCESS_INSERT,
                unit_ns: 1,
            },
            AnswerScope::Token => Self {
                scope: "token",
                select: ACCESS_SELECT,
                insert: ACCESS_INSERT,
                unit_ns: 1,
            },
        }
    }
}

#[async_trait]
impl AnswerRecords for SqlRecords<'_> {
    async fn answer(
        &mut self,
        scope: AnswerScope<'_>,
        key: &str,
    ) -> Result<Option<Answer>, StoreError> {
        let table = Table::of(scope);
        let row = query(table.select)
            .bind(table.scope)
            .bind(key)
            .fetch_optional(&mut *self.connection)
            .await
            .map_err(StoreError::database("look up an Idempotency-Key"))?;
        row.as_ref().map(answer_of).transpose()
    }

    async fn add_answer(
        &mut self,
        scope: AnswerScope<'_>,
        key: &IdempotencyKey,
        made: i64,
        now: WallTime,
    ) -> Result<(), StoreError> {
        let table = Table::of(scope);
        query(table.insert)
            .bind(table.scope)
            .bind(key.key.as_str())
            .bind(key.request_sha256.as_slice())
            .bind(made)
            .bind(now.0.div_euclid(table.unit_ns))
            .execute(&mut *self.connection)
            .await
            .map_err(StoreError::database("write an Idempotency-Key"))?;
        Ok(())
    }
}

fn answer_of(row: &Row) -> Result<Answer, StoreError> {
    const TABLE: &str = "idempotency";
    let sha256: Vec<u8> = column(row, TABLE, 0)?;
    Ok(Answer {
        request_sha256: sha256
            .try_into()
            .map_err(|_| corrupt(TABLE)("a hash has not 32 bytes"))?,
        made: column(row, TABLE, 1)?,
    })
}
