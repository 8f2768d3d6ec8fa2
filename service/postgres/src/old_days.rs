//! Days of the history that are dropped whole, over a connection of its own: the server answers when
//! it has deleted the files, which takes a second for some 20 GB, and telemetry does not wait for it.

use std::sync::Arc;

use fleetcal_domain::limits;
use fleetcal_sql::{Connection as _, Statement};
use fleetcal_store::StoreError;
use tokio::task::JoinHandle;

use crate::connection::Session;
use crate::failure::Fate;
use crate::servers::{Purpose, Servers};

/// Days that are being dropped.
#[derive(Debug, Default)]
pub(crate) struct OldDays {
    dropping: Option<JoinHandle<Result<u64, StoreError>>>,
}

impl OldDays {
    /// True if there are days all of whose seconds were received before `before_s`.
    ///
    /// # Errors
    /// The database's failure.
    pub(crate) async fn are_there(
        session: &mut Session,
        before_s: i64,
    ) -> Result<bool, StoreError> {
        let rows = session
            .rows(Statement {
                sql: "SELECT day FROM history_day
                      WHERE (day + 1) * 86400 <= $1 AND received < $1 LIMIT 1"
                    .into(),
                values: vec![before_s.into()],
            })
            .await
            .map_err(StoreError::database("look for old days"))?;
        Ok(!rows.is_empty())
    }

    /// Returns the number of rows that were dropped since the last call, and begins to drop those
    /// days if they `are_there`.
    ///
    /// # Errors
    /// The database's failure since then.
    pub(crate) async fn drop_next(
        &mut self,
        servers: &Arc<Servers>,
        are_there: bool,
        before_s: i64,
    ) -> Result<u64, StoreError> {
        if let Some(dropping) = self.dropping.take_if(|dropping| dropping.is_finished()) {
            // A task that panicked has said so in the log.
            return dropping.await.unwrap_or(Ok(0));
        }
        if are_there && self.dropping.is_none() {
            let servers = Arc::clone(servers);
            self.dropping = Some(tokio::spawn(async move {
                let mut session = Session::new(servers.connect(Purpose::Retention).await?);
                let dropped = drop_days(&mut session, before_s).await;
                session.close().await;
                dropped
            }));
        }
        Ok(0)
    }
}

impl Drop for OldDays {
    fn drop(&mut self) {
        if let Some(dropping) = &self.dropping {
            dropping.abort();
        }
    }
}

/// Drops the days all of whose seconds were received before `before_s`; returns the number of rows.
/// Days with a long-running reader stay until the next time.
///
/// # Errors
/// The database's failure.
pub(crate) async fn drop_days(session: &mut Session, before_s: i64) -> Result<u64, StoreError> {
    let query = sqlx::query_scalar("SELECT history_drop_days($1)").bind(before_s);
    match session
        .scalar_within(limits::POSTGRES_BULK_TIMEOUT, query)
        .await
    {
        Ok(rows) => Ok(rows.unsigned_abs()),
        Err(_) if session.fate() == Fate::Conflict => Ok(0),
        Err(error) => Err(StoreError::database("drop a day of the history")(error)),
    }
}
