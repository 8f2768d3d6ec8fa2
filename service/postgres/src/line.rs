//! A connection that is opened again after it was lost.

use std::sync::Arc;

use fleetcal_domain::limits;
use fleetcal_sql::Keys;
use fleetcal_store::StoreError;
use tokio::time::Instant;

use crate::advisory::AdvisoryLock;
use crate::connection::Session;
use crate::failure::Fate;
use crate::servers::{Purpose, Servers};

/// Connection that is reopened after a loss.
#[derive(Debug)]
pub(crate) struct Line {
    servers: Arc<Servers>,
    purpose: Purpose,
    /// Session; `None` until the next transaction opens one.
    pub(crate) session: Option<Session>,
    /// Lock that every connection of this line holds.
    lock: Option<AdvisoryLock>,
    /// Keys of the robots of committed transactions.
    keys: Keys,
}

impl Line {
    pub(crate) fn new(
        servers: Arc<Servers>,
        purpose: Purpose,
        session: Option<Session>,
        lock: Option<AdvisoryLock>,
    ) -> Self {
        Self {
            servers,
            purpose,
            session,
            lock,
            keys: Keys::new(),
        }
    }

    pub(crate) fn servers(&self) -> &Arc<Servers> {
        &self.servers
    }

    /// Begins a transaction; returns its connection, with the known keys. A connection that was
    /// lost while idle is reopened.
    ///
    /// # Errors
    /// Errors of connecting; [`StoreError::Database`].
    pub(crate) async fn begin(
        &mut self,
        begin: &'static str,
    ) -> Result<(&mut Session, &mut Keys), StoreError> {
        let session = match self.take_usable() {
            Some(session) => begun(session, begin).await?,
            None => None,
        };
        let session = if let Some(session) = session {
            session
        } else {
            // A server that crashed, or a standby that was behind, may have lost the rows that
            // these are of, and gives their numbers again.
            self.keys.clear();
            let mut session = self.servers.session(self.purpose).await?;
            if let Some(lock) = &mut self.lock {
                lock.take(&self.servers, &mut session).await?;
            }
            session.begin(begin).await?;
            session
        };
        Ok((self.session.insert(session), &mut self.keys))
    }

    /// Takes its connection out, unless it was lost; if it is not put back, the next use opens
    /// another.
    pub(crate) fn take_usable(&mut self) -> Option<Session> {
        let session = self.session.take();
        session.filter(|session| session.fate() != Fate::Lost)
    }

    pub(crate) async fn close(self) {
        if let Some(session) = self.session {
            session.close().await;
        }
    }
}

/// Begins a transaction on a connection; returns `None` if the connection was lost before.
async fn begun(mut session: Session, begin: &'static str) -> Result<Option<Session>, StoreError> {
    let asked_at = Instant::now();
    match session.begin(begin).await {
        Ok(()) => Ok(Some(session)),
        // Who waits has no time for a second server that does not answer.
        Err(error) if asked_at.elapsed() > limits::POSTGRES_CONNECT_TIMEOUT => Err(error),
        Err(_) => Ok(None),
    }
}
