//! Every table with its columns, and how the rows of one database come into another.

use std::fmt::Write as _;
use std::sync::LazyLock;

use async_trait::async_trait;
use fleetcal_model::Parameter;
use fleetcal_store::StoreError;
use sha2::{Digest, Sha256};

use crate::connection::{Connection, StatementError};
use crate::dialect::Dialect;
use crate::query::query;
use crate::value::{Row, Value};

/// Rows that are read and written at once.
const ROWS_AT_ONCE: i64 = 4_096;

/// A table to copy, in the order of its key.
#[derive(Debug)]
pub struct Table {
    /// Its name, quoted where SQL needs it.
    pub name: &'static str,
    /// Columns that are written, those of the key first.
    columns: Vec<Column>,
    /// Number of columns of the key.
    key: usize,
    /// True if the database draws the numbers of its key.
    numbered: bool,
}

/// A column.
#[derive(Debug)]
struct Column {
    name: String,
    kind: Kind,
}

/// Type of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Integer,
    Real,
    Text,
    Bytes,
    Boolean,
}

/// Number of rows of a table, and the hash of their content.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Content {
    /// Rows.
    pub rows: u64,
    /// Sum of the SHA-256 of each row, modulo 2²⁵⁶, lower-case hexadecimal: it does not depend on
    /// the order of rows, which differs between databases.
    pub sha256: String,
}

/// Destination of copied rows, in one transaction.
#[async_trait]
pub trait CopyTarget: Connection {
    /// Writes rows of a table; `text` is in the text format of PostgreSQL's `COPY`.
    ///
    /// # Errors
    /// The driver's error.
    async fn copy_in(&mut self, table: &Table, text: String) -> Result<(), StatementError>;
}

/// Every table, each after those that it refers to, except `probe`, which holds no data.
pub static TABLES: LazyLock<Vec<Table>> =
    LazyLock::new(|| {
        let mut tables = vec![
            numbered(
                "robot",
                1,
                "key:n id:t config:t version:n created_ns:n updated_ns:n drawn_by:t",
            ),
            table(
                "robot_current",
                1,
                "robot:n stamp_ns:n received_ns:n estimate:t",
            ),
            table("checkpoint", 1, "robot:n stamp_ns:n received_ns:n state:b"),
            history("history_second", &["", "_sigma"], "status:n nis:r"),
            history(
                "history_minute",
                ROLL_UP,
                "count:n status:n nis_mean:r nis_max:r",
            ),
            history(
                "history_hour",
                ROLL_UP,
                "count:n status:n nis_mean:r nis_max:r",
            ),
        ];
        tables.extend([
        numbered(
            "robot_event",
            1,
            "id:n robot:n kind:t stamp_ns:n received_ns:n source:t author:t note:t details:t",
        ),
        table("idempotency", 2, "scope:t key:t request_sha256:b event:n received:n"),
        numbered(
            "audit",
            1,
            "id:n at_ns:n actor:t authentication:t role:t request:t action:t subject:t \
             subject_id:t robot:t before:t after:t reason:t address:t link:t",
        ),
        numbered(
            "\"user\"",
            1,
            "id:n name:t role:t password:t disabled:y version:n created_ns:n updated_ns:n \
             signed_in_ns:n",
        ),
        numbered("session", 1, "id:n sha256:b \"user\":n created_ns:n used_ns:n"),
        numbered(
            "token",
            1,
            "id:n sha256:b name:t role:t robot:t created_by:t created_ns:n expires_ns:n used_ns:n \
             revoked_ns:n",
        ),
        table("setup_code", 1, "sha256:b ends_ns:n"),
        table("access_idempotency", 2, "made:t key:t request_sha256:b id:n received_ns:n"),
        table("revision", 1, "id:n record:t"),
        table("proposal", 1, "id:n record:t"),
        table("deployment", 1, "id:n record:t"),
        table(
            "certificate",
            1,
            "number:n robot:t verified_ns:n approved_by:t record:t",
        ),
        table("rollout", 1, "id:n record:t"),
        table("rollout_robot", 2, "rollout:n robot:t wave:n proposal:n revision:n"),
        table("shadow", 1, "robot:t record:t"),
        table("envelope", 2, "robot:t generation:n record:t"),
        table("outbox", 2, "robot:t kind:t generation:n"),
        table("proposal_request", 2, "robot:t key:t request_sha256:b proposal:n received:n"),
        table("site", 1, "id:n version:n held:y by:t at_ns:n reason:t"),
        table("cross_track", 2, "robot:t generation:n errors:t"),
        numbered("alert", 1, "id:n record:t rank:n"),
        numbered(
            "alert_change",
            1,
            "id:n alert:n at_ns:n version:n state:t what:t by:t note:t",
        ),
        numbered("webhook", 1, "id:n record:t secret:b"),
        numbered(
            "webhook_delivery",
            1,
            "id:n webhook:n message:t event:t body:t created_ns:n state:t due_ns:n \
             attempts_made:n attempts:t finished_ns:n",
        ),
        table("policy", 1, "id:n version:n policy:t by:t at_ns:n reason:t"),
    ]);
        tables
    });

/// Suffixes of the columns that a roll-up has for each parameter.
const ROLL_UP: &[&str] = &["_mean", "_min", "_max", "_sigma"];

fn table(name: &'static str, key: usize, columns: &str) -> Table {
    let columns = columns.split_whitespace().filter_map(column);
    Table {
        name,
        columns: columns.collect(),
        key,
        numbered: false,
    }
}

fn numbered(name: &'static str, key: usize, columns: &str) -> Table {
    Table {
        numbered: true,
        ..table(name, key, columns)
    }
}

fn history(name: &'static str, of_parameter: &[&str], others: &str) -> Table {
    let mut columns = vec!["t:n robot:n received:n".to_owned()];
    for parameter in Parameter::ALL {
        let name = parameter.name();
        columns.extend(of_parameter.iter().map(|part| format!("{name}{part}:r")));
    }
    columns.push(others.to_owned());
    table(name, 2, &columns.join(" "))
}

/// Parses a column from its name and the letter of its type.
fn column(text: &str) -> Option<Column> {
    let (name, kind) = text.split_once(':')?;
    let kind = match kind {
        "n" => Kind::Integer,
        "r" => Kind::Real,
        "b" => Kind::Bytes,
        "y" => Kind::Boolean,
        _ => Kind::Text,
    };
    Some(Column {
        name: name.to_owned(),
        kind,
    })
}

impl Table {
    /// Returns its columns, separated by commas.
    pub fn columns(&self) -> String {
        let names: Vec<&str> = self.columns.iter().map(|one| one.name.as_str()).collect();
        names.join(", ")
    }

    /// Returns the statement that lets a database continue after the greatest number of its key.
    pub fn restart_numbers(&self) -> Option<String> {
        let key = self.columns.first().filter(|_| self.numbered)?;
        let (table, key) = (self.name, &key.name);
        Some(format!(
            "SELECT setval(pg_get_serial_sequence('{table}', '{key}'), \
             (SELECT coalesce(max({key}), 0) + 1 FROM {table}), false)"
        ))
    }

    /// Returns the number of its rows.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn count(&self, connection: &mut dyn Connection) -> Result<u64, StoreError> {
        let row = query(format!("SELECT count(*) FROM {}", self.name))
            .fetch_one(connection)
            .await
            .map_err(StoreError::database("count rows"))?;
        let count: i64 = row.get(0).map_err(|error| self.corrupt(&error))?;
        Ok(count.unsigned_abs())
    }

    /// Returns the rows after a key, in its order.
    async fn rows_after(
        &self,
        connection: &mut dyn Connection,
        after: Option<&Row>,
    ) -> Result<Vec<Row>, StoreError> {
        let dialect = connection.dialect();
        let keys = self.key_in_order(dialect);
        let order: Vec<String> = keys
            .iter()
            .map(|&key| self.columns[key].in_order(dialect))
            .collect();
        let order = order.join(", ");
        let mut rows = query(format!("SELECT {} FROM {}", self.columns(), self.name));
        if let Some(after) = after {
            rows = rows.push(&format!(" WHERE ({order}) > ("));
            for (place, &key) in keys.iter().enumerate() {
                rows = rows.push(if place == 0 { "" } else { ", " });
                rows = rows.push_bind(after.0[key].clone());
            }
            rows = rows.push(")");
        }
        rows.push(&format!(" ORDER BY {order} LIMIT {ROWS_AT_ONCE}"))
            .fetch_all(connection)
            .await
            .map_err(StoreError::database("read rows"))
    }

    /// Returns the columns of its key in the order of its index: that of the history begins with
    /// the time in SQLite, and with the robot in PostgreSQL.
    fn key_in_order(&self, dialect: Dialect) -> Vec<usize> {
        let keys = 0..self.key;
        if dialect == Dialect::Postgres && self.name.starts_with("history_") {
            return keys.rev().collect();
        }
        keys.collect()
    }

    /// Writes a row in the text format of PostgreSQL's `COPY`.
    fn text_of(&self, row: &Row, text: &mut String) -> Result<(), StoreError> {
        for (index, (column, value)) in self.columns.iter().zip(&row.0).enumerate() {
            if index > 0 {
                text.push('\t');
            }
            column
                .write(value, text)
                .map_err(|error| self.corrupt(&error))?;
        }
        text.push('\n');
        Ok(())
    }

    fn corrupt(&self, error: &impl std::fmt::Display) -> StoreError {
        StoreError::Corrupt {
            table: self.name,
            reason: error.to_string(),
        }
    }

    /// Returns the content of its rows, the same in every database.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn content(&self, connection: &mut dyn Connection) -> Result<Content, StoreError> {
        let mut content = Reading::new(self);
        while content.next(connection).await?.is_some() {}
        Ok(content.content())
    }

    /// Copies its rows; `copied` receives the number of each batch. Returns their content.
    ///
    /// # Errors
    /// The failure of either database.
    pub async fn copy(
        &self,
        from: &mut dyn Connection,
        to: &mut dyn CopyTarget,
        copied: &(dyn Fn(u64) + Send + Sync),
    ) -> Result<Content, StoreError> {
        let mut reading = Reading::new(self);
        loop {
            let before = reading.rows;
            let Some(text) = reading.next(from).await? else {
                return Ok(reading.content());
            };
            to.copy_in(self, text)
                .await
                .map_err(StoreError::database("take rows"))?;
            copied(reading.rows - before);
        }
    }
}

impl Column {
    /// Returns its name for ordering rows by it: by bytes, as SQLite orders texts.
    fn in_order(&self, dialect: Dialect) -> String {
        match (dialect, self.kind) {
            (Dialect::Postgres, Kind::Text) => format!("{} COLLATE \"C\"", self.name),
            _ => self.name.clone(),
        }
    }

    /// Writes a value as text.
    fn write(&self, value: &Value, text: &mut String) -> Result<(), std::fmt::Error> {
        match (self.kind, value) {
            (Kind::Integer, Value::Integer(Some(number))) => write!(text, "{number}"),
            // Shortest text that is read as the same number.
            (Kind::Real, Value::Real(Some(number))) => write!(text, "{number:e}"),
            (Kind::Text, Value::Text(Some(value))) => {
                escape(value, text);
                Ok(())
            }
            (Kind::Bytes, Value::Bytes(Some(bytes))) => {
                text.push_str("\\\\x");
                text.push_str(&hex::encode(bytes));
                Ok(())
            }
            (Kind::Boolean, Value::Boolean(Some(yes))) => write!(text, "{yes}"),
            (Kind::Boolean, Value::Integer(Some(number))) => write!(text, "{}", *number != 0),
            (
                _,
                Value::Null
                | Value::Integer(None)
                | Value::Real(None)
                | Value::Text(None)
                | Value::Bytes(None)
                | Value::Boolean(None),
            ) => {
                text.push_str("\\N");
                Ok(())
            }
            _ => Err(std::fmt::Error),
        }
    }
}

/// Writes a text so that `COPY` reads it unchanged.
fn escape(value: &str, text: &mut String) {
    for letter in value.chars() {
        match letter {
            '\\' => text.push_str("\\\\"),
            '\t' => text.push_str("\\t"),
            '\n' => text.push_str("\\n"),
            '\r' => text.push_str("\\r"),
            letter => text.push(letter),
        }
    }
}

/// A table that is read from its first row to its last.
struct Reading<'t> {
    table: &'t Table,
    last: Option<Row>,
    rows: u64,
    sum: [u8; 32],
}

impl<'t> Reading<'t> {
    fn new(table: &'t Table) -> Self {
        Self {
            table,
            last: None,
            rows: 0,
            sum: [0; 32],
        }
    }

    /// Returns the next rows as text; `None` after the last.
    async fn next(
        &mut self,
        connection: &mut dyn Connection,
    ) -> Result<Option<String>, StoreError> {
        let mut rows = self
            .table
            .rows_after(connection, self.last.as_ref())
            .await?;
        let mut text = String::new();
        for row in &rows {
            let begins = text.len();
            self.table.text_of(row, &mut text)?;
            add(
                &mut self.sum,
                &Sha256::digest(&text.as_bytes()[begins..]).into(),
            );
        }
        let Some(last) = rows.pop() else {
            return Ok(None);
        };
        self.rows += rows.len() as u64 + 1;
        self.last = Some(last);
        Ok(Some(text))
    }

    fn content(self) -> Content {
        Content {
            rows: self.rows,
            sha256: hex::encode(self.sum),
        }
    }
}

/// Adds modulo 2²⁵⁶, least significant byte first.
fn add(sum: &mut [u8; 32], other: &[u8; 32]) {
    let mut carry = 0_u16;
    for (byte, other) in sum.iter_mut().zip(other) {
        let total = u16::from(*byte) + u16::from(*other) + carry;
        *byte = total.to_le_bytes()[0];
        carry = total >> 8;
    }
}
