//! One transaction about the cluster's rows.

use std::sync::Arc;

use fleetcal_store::StoreError;
use tokio::sync::{Mutex, MutexGuard};

use crate::connection::Session;
use crate::line::Line;

/// A transaction. If it is dropped before its end, its connection is dropped too, so that an
/// abandoned one leaves nothing half done.
pub(super) struct Transaction<'l> {
    line: MutexGuard<'l, Line>,
    session: Session,
}

impl<'l> Transaction<'l> {
    /// Begins a transaction on a line.
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

    /// Commits the work, or undoes it after a failure.
    ///
    /// # Errors
    /// The work's error; [`StoreError::Commit`] if the commit failed.
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
