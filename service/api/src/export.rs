//! Files of many rows: how many are written at once, and for how long.

use std::io;
use std::sync::Arc;

use axum::body::{Body, Bytes};
use axum::http::StatusCode;
use fleetcal_domain::limits;
use fleetcal_http::{Share, Shares, Turned};
use futures::{Stream, StreamExt, stream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use crate::ApiState;
use crate::access::{Caller, permission_ended};
use crate::problem::Problem;

/// The places for files that are being written.
#[derive(Debug, Clone)]
pub(crate) struct Exports {
    all: Arc<Semaphore>,
    of_callers: Shares,
}

impl Default for Exports {
    fn default() -> Self {
        Self {
            all: Arc::new(Semaphore::new(limits::EXPORTS_MAX)),
            of_callers: Shares::new(limits::EXPORTS_PER_CALLER_MAX),
        }
    }
}

/// The place of one file, which is free again when this goes.
#[derive(Debug)]
pub(crate) struct ExportPlace {
    api: ApiState,
    caller: Caller,
    _all: OwnedSemaphorePermit,
    _share: Share,
}

impl ExportPlace {
    /// Takes a place for a file of this caller.
    ///
    /// # Errors
    /// [`Problem`] when the caller has as many files as it may have, or all together.
    pub(crate) fn take(api: &ApiState, caller: Caller) -> Result<Self, Problem> {
        let taken = Self::free(api, caller);
        taken.inspect_err(|_| api.connections.count(Turned::Exports))
    }

    fn free(api: &ApiState, caller: Caller) -> Result<Self, Problem> {
        let share = api.exports.of_callers.take(caller.actor.key());
        let share = share.ok_or_else(|| {
            let most = limits::EXPORTS_PER_CALLER_MAX;
            let detail = format!("{most} files are written for this user or token, the limit");
            let status = StatusCode::TOO_MANY_REQUESTS;
            Problem::new(status, "exports_of_caller", detail).retry_after(RETRY_AFTER_S)
        })?;
        let all = Arc::clone(&api.exports.all).try_acquire_owned();
        let all = all.map_err(|_| {
            let detail = format!(
                "{} files are written already, the limit",
                limits::EXPORTS_MAX
            );
            let status = StatusCode::SERVICE_UNAVAILABLE;
            Problem::new(status, "exports_full", detail).retry_after(RETRY_AFTER_S)
        })?;
        Ok(Self {
            api: api.clone(),
            caller,
            _all: all,
            _share: share,
        })
    }

    /// The body of the file. It breaks off when the caller may no longer read it, or takes too long.
    pub(crate) fn body(
        self,
        pieces: impl Stream<Item = io::Result<Bytes>> + Send + 'static,
    ) -> Body {
        let (api, caller) = (self.api.clone(), self.caller.clone());
        let end = async move {
            tokio::select! {
                () = permission_ended(api, caller) => "the permission has ended",
                () = tokio::time::sleep(limits::EXPORT_TAKEN_WITHIN) => "it was not taken in time",
            }
        };
        Body::from_stream(until(end, pieces, self))
    }
}

/// The pieces until `end` says why there are no more; then an error, which breaks the connection off.
/// Until then `held` is.
fn until<Held: Send + 'static>(
    end: impl Future<Output = &'static str> + Send + 'static,
    pieces: impl Stream<Item = io::Result<Bytes>> + Send + 'static,
    held: Held,
) -> impl Stream<Item = io::Result<Bytes>> + Send + 'static {
    let writing = (Box::pin(pieces), Box::pin(end), held);
    stream::unfold(Some(writing), |writing| async {
        let (mut pieces, mut end, held) = writing?;
        tokio::select! {
            biased;
            cause = &mut end => {
                tracing::warn!(cause, "a file was broken off");
                Some((Err(io::Error::other(cause)), None))
            }
            piece = pieces.next() => match piece? {
                Ok(piece) => Some((Ok(piece), Some((pieces, end, held)))),
                Err(error) => Some((Err(error), None)),
            },
        }
    })
}

/// What a caller should wait before it asks again, s: a file of the audit takes some seconds.
const RETRY_AFTER_S: u32 = 10;

#[cfg(test)]
mod tests {
    use tokio::sync::oneshot;

    use super::*;

    #[tokio::test]
    async fn a_file_that_is_not_whole_ends_with_an_error_and_leaves_its_place() {
        let (ended, end) = oneshot::channel();
        let end = async { end.await.unwrap_or("gone") };
        let piece = || Ok(Bytes::from_static(b"a row"));
        let place = Arc::new(());
        let pieces = stream::iter([piece(), piece(), piece()]);
        let mut file = Box::pin(until(end, pieces, Arc::clone(&place)));
        assert!(file.next().await.unwrap().is_ok());
        assert_eq!(Arc::strong_count(&place), 2);
        ended.send("the permission has ended").unwrap();
        let broken = file.next().await.unwrap().unwrap_err();
        assert_eq!(broken.to_string(), "the permission has ended");
        assert!(file.next().await.is_none());
        assert_eq!(Arc::strong_count(&place), 1);
    }

    #[tokio::test]
    async fn a_whole_file_ends_without_an_error() {
        let pieces = stream::iter([Ok(Bytes::from_static(b"a row"))]);
        let file = until(std::future::pending(), pieces, ());
        let file: Vec<_> = file.collect().await;
        assert!(file.len() == 1 && file[0].is_ok());
    }
}
