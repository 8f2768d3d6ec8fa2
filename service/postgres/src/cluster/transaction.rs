//! One transaction about the cluster's rows.

use std::sync::Arc;

use fleetcal_store::StoreError;
use tokio::sync::{Mutex, MutexGuard};

use crate::connection::Session;
use crate::line::Line;

/// A transaction. One that is dropped before its end goes with its connection, so that whoever gives
/// up waiting leaves nothing half done.
pub(super) struct Transaction<'l> {
    line: MutexGuard<'l, Line>,
    session: Session,
}

impl<'l> Transaction<'l> {
    /// Begins one on a line.
    ///
    /// # Errors
    /// As of [`Line::begin`].
    pub(super) async fn begin(
        line: &'l Mutex<Line>,
        begin: &'static str,
    ) -> Result<Self, StoreError> {
        let mut line = line.lock().await;
        line.begin(begin).await?;
        let session = line.session.take().ok_or(StoreError::Closed)?;
        Ok(Self { line, session })
    }

    pub(super) fn session(&mut self) -> &mut Session {
        &mut self.session
    }

    /// Commits what was done, or undoes it when something failed.
    ///
    /// # Errors
    /// What failed; [`StoreError::Commit`] when the commit did.
    pub(super) async fn end<T>(mut self, done: Result<T, StoreError>) -> Result<T, StoreError> {
        let ended = match done {
            Ok(done) => {
                let committed = self.session.commit().await;
                committed.map_or_else(
                    |error| Err(StoreError::Commit(Arc::new(error))),
                    |()| Ok(done),
                )
            }
            Err(error) => Err(error),
        };
        if ended.is_ok() || self.session.roll_back().await {
            self.line.session = Some(self.session);
        }
        ended
    }
}
