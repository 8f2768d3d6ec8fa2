//! Locks that a connection holds for as long as it is open: who may serve a database, and which
//! process goes by an instance's name. Two services would estimate every robot twice, and two
//! processes of one name would end each other's lives.

use fleetcal_cluster::InstanceId;
use fleetcal_domain::limits;
use fleetcal_sql::{Connection as _, Row, Statement, Value};
use fleetcal_store::StoreError;
use tokio::time::Instant;

use crate::connection::Session;
use crate::servers::Servers;

/// Keys of the database's lock, "flee" and "tcal" read as bytes.
const DATABASE: (&str, &str) = ("1718379877", "1952670060");
/// First key of the lock of a name, "inst" read as bytes.
pub(crate) const NAME: &str = "1768846196";

/// Object of a lock.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Locked {
    /// The database, for one service.
    Alone,
    /// The database, beside other instances and against a service that is alone.
    Beside,
    /// An instance's name, for one process.
    Name(InstanceId),
}

/// Lock that a connection holds while it is open.
#[derive(Debug)]
pub(crate) struct AdvisoryLock {
    locked: Locked,
    /// Server process of the connection that held it last, and its start: a server may not have
    /// noticed yet that the connection is gone.
    last: Option<(i64, String)>,
}

impl Locked {
    const fn function(&self) -> &'static str {
        match self {
            Self::Beside => "pg_try_advisory_lock_shared",
            Self::Alone | Self::Name(_) => "pg_try_advisory_lock",
        }
    }

    /// Returns the two keys, in SQL.
    const fn keys(&self) -> (&'static str, &'static str) {
        match self {
            Self::Alone | Self::Beside => DATABASE,
            Self::Name(_) => (NAME, "hashtext($1)"),
        }
    }

    /// Returns the value of `$1` in the keys.
    fn values(&self) -> Vec<Value> {
        match self {
            Self::Alone | Self::Beside => Vec::new(),
            Self::Name(instance) => vec![instance.as_str().into()],
        }
    }

    /// Returns the reason for which the lock is unavailable while `other` has it.
    fn refusal(&self, other: &str) -> String {
        match self {
            Self::Alone => format!(
                "is served by another fleetcal{other}; end that one first, or give this one a \
                 database of its own"
            ),
            Self::Beside => format!(
                "is served by a fleetcal that is no instance of a cluster{other}; end that one \
                 first, or give it a name with --instance"
            ),
            Self::Name(instance) => format!(
                "has an instance {} already{other}; end that one first, or give this one another \
                 name",
                instance.as_str()
            ),
        }
    }
}

impl AdvisoryLock {
    pub(crate) const fn new(locked: Locked) -> Self {
        Self { locked, last: None }
    }

    /// Acquires the lock on a new connection.
    ///
    /// # Errors
    /// [`StoreError::Server`] if another process has it.
    pub(crate) async fn take(
        &mut self,
        servers: &Servers,
        session: &mut Session,
    ) -> Result<(), StoreError> {
        let give_up_at = Instant::now() + limits::POSTGRES_CONNECT_TIMEOUT;
        while !self.try_take(session).await? {
            let holder = self.holder(session).await?;
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
                    reason: self.locked.refusal(&other),
                });
            }
            tokio::time::sleep(limits::POSTGRES_CONFLICT_PAUSE).await;
        }
        Ok(())
    }

    async fn try_take(&mut self, session: &mut Session) -> Result<bool, StoreError> {
        let function = self.locked.function();
        let (class, object) = self.locked.keys();
        let sql = format!(
            "SELECT {function}({class}, {object}), pid::int8, backend_start::text
             FROM pg_stat_activity WHERE pid = pg_backend_pid()"
        );
        let row = asked(session, sql, self.locked.values()).await?;
        let Some(row) = row else { return Ok(false) };
        let taken = row.0.first() == Some(&Value::Boolean(Some(true)));
        if taken {
            self.last = row.integer(1).zip(text(&row, 2));
        }
        Ok(taken)
    }

    /// Ends the former connection, which is alive for the server alone.
    async fn end_last(&self, session: &mut Session) -> Result<(), StoreError> {
        let Some((pid, _)) = &self.last else {
            return Ok(());
        };
        let sql = format!("SELECT pg_terminate_backend({pid})");
        asked(session, sql, Vec::new()).await.map(drop)
    }

    /// Returns the holder of the lock: process, its start, and the address that it is connected
    /// from.
    async fn holder(
        &self,
        session: &mut Session,
    ) -> Result<Option<(i64, String, String)>, StoreError> {
        let (class, object) = self.locked.keys();
        let sql = format!(
            "SELECT a.pid::int8, a.backend_start::text,
                 coalesce(host(a.client_addr), 'this machine')
             FROM pg_locks AS l JOIN pg_stat_activity AS a USING (pid)
             WHERE l.locktype = 'advisory' AND l.granted
                 AND l.classid = {class} AND l.objid = ({object}::int8 & 4294967295)::oid
                 AND l.database = (SELECT oid FROM pg_database WHERE datname = current_database())"
        );
        let row = asked(session, sql, self.locked.values()).await?;
        Ok(row.and_then(|row| Some((row.integer(0)?, text(&row, 1)?, text(&row, 2)?))))
    }
}

async fn asked(
    session: &mut Session,
    sql: String,
    values: Vec<Value>,
) -> Result<Option<Row>, StoreError> {
    let statement = Statement {
        sql: sql.into(),
        values,
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
