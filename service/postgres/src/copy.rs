//! The records of another database, brought into an empty one here.

use async_trait::async_trait;
use fleetcal_domain::limits;
use fleetcal_sql::copy::{Content, CopyTarget, TABLES, Table};
use fleetcal_sql::{Connection, Dialect, Row, Statement, StatementError};
use fleetcal_store::StoreError;

use crate::PostgresSetup;
use crate::connection::Session;
use crate::history::{self, DAY_S};
use crate::schema;
use crate::servers::{Purpose, Servers};

/// Tables in which a new schema has a row.
const SEEDED: [&str; 2] = ["site", "policy"];

/// Statement that records the days whose seconds were copied in bulk.
const DAYS_COPIED: &str = "\
UPDATE history_day AS d SET (received, row_count) = (
    SELECT coalesce(max(s.received), 0), count(*) FROM history_second AS s
    WHERE s.t >= d.day * 86400 AND s.t < (d.day + 1) * 86400)";

/// Copies every table of `from` into the database of `setup`, which is migrated to this program's
/// schema and must be empty. All of it is one transaction: an interrupted copy leaves nothing
/// behind and can be repeated. Each table is read again at the end and must equal that of `from`.
///
/// `copied` receives the number of rows of each batch. Returns the content of each table.
///
/// # Errors
/// [`StoreError::Server`] if the database is not empty or a table differs, else the failure of
/// either database.
pub async fn copy(
    from: &mut dyn Connection,
    setup: PostgresSetup,
    copied: &(dyn Fn(u64) + Send + Sync),
) -> Result<Vec<(&'static str, Content)>, StoreError> {
    let servers = Servers::new(setup)?;
    schema::bring(&servers).await?;
    let mut to = Target(Session::new(servers.connect(Purpose::Migration).await?));
    to.0.begin("BEGIN").await?;
    let ended = copy_tables(from, &mut to, &servers, copied).await;
    if ended.is_ok() {
        let committed = to.0.commit().await;
        committed.map_err(StoreError::database("commit the copy"))?;
    }
    // A connection that is closed undoes what it has not committed.
    to.0.close().await;
    ended
}

async fn copy_tables(
    from: &mut dyn Connection,
    to: &mut Target,
    servers: &Servers,
    copied: &(dyn Fn(u64) + Send + Sync),
) -> Result<Vec<(&'static str, Content)>, StoreError> {
    let refused = |reason: String| StoreError::Server {
        database: servers.name(),
        reason,
    };
    for table in TABLES.iter() {
        let rows = table.count(to).await?;
        if SEEDED.contains(&table.name) {
            let emptied = to.execute(statement(format!("DELETE FROM {}", table.name)));
            emptied.await.map_err(StoreError::database("be emptied"))?;
        } else if rows > 0 {
            let name = table.name;
            return Err(refused(format!(
                "is not empty: got {rows} rows in {name}, expected none"
            )));
        }
    }
    let mut contents = Vec::new();
    for table in TABLES.iter() {
        if table.name == "history_second" {
            add_days(from, to).await?;
        }
        let there = table.copy(from, to, copied).await?;
        if table.name == "history_second" {
            let noted = to.execute(statement(DAYS_COPIED.to_owned())).await;
            noted.map_err(StoreError::database("note the days of its history"))?;
        }
        let here = table.content(to).await?;
        if here != there {
            let name = table.name;
            return Err(refused(format!(
                "took {name} in as {here:?}, expected {there:?}"
            )));
        }
        if let Some(sql) = table.restart_numbers() {
            let restarted = to.rows(statement(sql)).await;
            restarted.map_err(StoreError::database("number its rows"))?;
        }
        contents.push((table.name, here));
    }
    Ok(contents)
}

/// Makes the partitions of the latest days with seconds; older ones are pruned row by row.
async fn add_days(from: &mut dyn Connection, to: &mut Target) -> Result<(), StoreError> {
    let newest = from
        .rows(statement(
            "SELECT max(received) FROM history_second".to_owned(),
        ))
        .await
        .map_err(StoreError::database("look for the latest history"))?;
    let Some(newest_s) = newest.first().and_then(|row| row.integer(0)) else {
        return Ok(());
    };
    let kept_s = i64::try_from(limits::HISTORY_SECONDS_KEPT.as_secs()).unwrap_or(i64::MAX);
    let days = (newest_s - kept_s).div_euclid(DAY_S)..=newest_s.div_euclid(DAY_S) + 1;
    for day in days {
        history::add_day(&mut to.0, day).await?;
    }
    Ok(())
}

fn statement(sql: String) -> Statement {
    Statement {
        sql: sql.into(),
        values: Vec::new(),
    }
}

/// Transaction that rows are copied into.
struct Target(Session);

#[async_trait]
impl Connection for Target {
    fn dialect(&self) -> Dialect {
        self.0.dialect()
    }

    async fn rows(&mut self, statement: Statement) -> Result<Vec<Row>, StatementError> {
        self.0.rows(statement).await
    }

    async fn execute(&mut self, statement: Statement) -> Result<u64, StatementError> {
        self.0.execute(statement).await
    }
}

#[async_trait]
impl CopyTarget for Target {
    async fn copy_in(&mut self, table: &Table, text: String) -> Result<(), StatementError> {
        let (name, columns) = (table.name, table.columns());
        let sql = format!("COPY {name} ({columns}) FROM STDIN");
        let within = limits::POSTGRES_BULK_TIMEOUT;
        self.0.copy_in(&sql, text.into_bytes(), within).await
    }
}
