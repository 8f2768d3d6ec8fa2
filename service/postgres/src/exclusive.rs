//! That one service alone serves a database: two would estimate every robot twice.

use fleetcal_domain::limits;
use fleetcal_sql::{Connection as _, Row, Statement, Value};
use fleetcal_store::StoreError;
use tokio::time::Instant;

use crate::connection::Session;
use crate::servers::Servers;

/// Which advisory lock: its two keys are ours, as "flee" and "tcal" are read as bytes.
const KEYS: &str = "1718379877, 1952670060";

/// The lock, held by a connection for as long as this is open.
#[derive(Debug, Default)]
pub(crate) struct ExclusiveLock {
    /// The process of the server for the connection that held it last, and when this began: a server
    /// may not know yet that the connection is gone.
    last: Option<(i64, String)>,
}

impl ExclusiveLock {
    /// Takes the lock on a new connection.
    ///
    /// # Errors
    /// [`StoreError::Server`] when another service has it.
    pub(crate) async fn take(
        &mut self,
        servers: &Servers,
        session: &mut Session,
    ) -> Result<(), StoreError> {
        let give_up_at = Instant::now() + limits::POSTGRES_CONNECT_TIMEOUT;
        while !self.try_take(session).await? {
            let holder = holder(session).await?;
            let is_ours = |(pid, began, _): &(i64, String, String)| {
                Some((*pid, began.as_str()))
                    == self.last.as_ref().map(|(pid, at)| (*pid, at.as_str()))
            };
            if holder.as_ref().is_some_and(is_ours) {
                self.end_last(session).await?;
            }
            if Instant::now() >= give_up_at {
                let other = holder.map_or_else(String::new, |(_, began, address)| {
                    format!(", from {address} since {began}")
                });
                return Err(StoreError::Server {
                    database: servers.name(),
                    reason: format!(
                        "is served by another fleetcal{other}; end that one first, or give this \
                         one a database of its own"
                    ),
                });
            }
            tokio::time::sleep(limits::POSTGRES_CONFLICT_PAUSE).await;
        }
        Ok(())
    }

    async fn try_take(&mut self, session: &mut Session) -> Result<bool, StoreError> {
        let row = asked(
            session,
            format!(
                "SELECT pg_try_advisory_lock({KEYS}), pid::int8, backend_start::text
                 FROM pg_stat_activity WHERE pid = pg_backend_pid()"
            ),
        )
        .await?;
        let Some(row) = row else { return Ok(false) };
        let taken = row.0.first() == Some(&Value::Boolean(Some(true)));
        if taken {
            self.last = row.integer(1).zip(text(&row, 2));
        }
        Ok(taken)
    }

    /// Ends the connection that had it, which only the server still believes in.
    async fn end_last(&self, session: &mut Session) -> Result<(), StoreError> {
        let Some((pid, _)) = &self.last else {
            return Ok(());
        };
        let sql = format!("SELECT pg_terminate_backend({pid})");
        asked(session, sql).await.map(drop)
    }
}

/// Who holds the lock: process, when it began, and from where it is connected.
async fn holder(session: &mut Session) -> Result<Option<(i64, String, String)>, StoreError> {
    let (high, low) = KEYS.split_once(", ").unwrap_or_default();
    let row = asked(
        session,
        format!(
            "SELECT a.pid::int8, a.backend_start::text,
                 coalesce(host(a.client_addr), 'this machine')
             FROM pg_locks AS l JOIN pg_stat_activity AS a USING (pid)
             WHERE l.locktype = 'advisory' AND l.granted AND l.classid = {high} AND l.objid = {low}
                 AND l.database = (SELECT oid FROM pg_database WHERE datname = current_database())"
        ),
    )
    .await?;
    Ok(row.and_then(|row| Some((row.integer(0)?, text(&row, 1)?, text(&row, 2)?))))
}

async fn asked(session: &mut Session, sql: String) -> Result<Option<Row>, StoreError> {
    let statement = Statement {
        sql: sql.into(),
        values: Vec::new(),
    };
    let rows = session.rows(statement).await;
    let rows = rows.map_err(StoreError::database("ask who serves it"))?;
    Ok(rows.into_iter().next())
}

fn text(row: &Row, index: usize) -> Option<String> {
    match row.0.get(index) {
        Some(Value::Text(text)) => text.clone(),
        _ => None,
    }
}
