//! Files that are written while they are taken: how many at once, and until when.

use std::io;
use std::sync::Arc;

use axum::body::Bytes;
use fleetcal_domain::limits;
use futures::{Stream, StreamExt, stream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};

use crate::{Share, Shares};

/// Places for files that are being written.
#[derive(Debug, Clone)]
pub struct Exports {
    all: Arc<Semaphore>,
    of_callers: Shares,
}

/// Place of one file, which is freed on drop.
#[derive(Debug)]
pub struct ExportPlace {
    _all: OwnedSemaphorePermit,
    _share: Share,
}

/// Reason for which a file has no place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExportRefused {
    /// Its caller has reached its limit.
    OfCaller,
    /// The limit of all files together is reached.
    Full,
}

impl Default for Exports {
    fn default() -> Self {
        Self {
            all: Arc::new(Semaphore::new(limits::EXPORTS_MAX)),
            of_callers: Shares::new(limits::EXPORTS_PER_CALLER_MAX),
        }
    }
}

impl Exports {
    /// Allocates a place for a file of this caller.
    ///
    /// # Errors
    /// [`ExportRefused`] if none is free.
    pub fn take(&self, caller: String) -> Result<ExportPlace, ExportRefused> {
        let share = self.of_callers.take(caller);
        let share = share.ok_or(ExportRefused::OfCaller)?;
        let all = Arc::clone(&self.all).try_acquire_owned();
        let all = all.map_err(|_| ExportRefused::Full)?;
        Ok(ExportPlace {
            _all: all,
            _share: share,
        })
    }
}

/// Streams the pieces of a file until `end` returns a reason to stop, then an error, which breaks
/// the connection off. It keeps `held` until then, also where the peer does not read: a task of its
/// own writes, one piece ahead of the peer.
pub fn until<Held: Send + 'static>(
    end: impl Future<Output = &'static str> + Send + 'static,
    pieces: impl Stream<Item = io::Result<Bytes>> + Send + 'static,
    held: Held,
) -> impl Stream<Item = io::Result<Bytes>> + Send + 'static {
    let (written, mut pieces_of_file) = mpsc::channel(1);
    tokio::spawn(async move {
        let pieces = Box::pin(pieces);
        tokio::select! {
            biased;
            cause = end => {
                tracing::warn!(cause, "a file was broken off");
                drop(held);
                let broken = written.send(Err(io::Error::other(cause))).await;
                if broken.is_err() {
                    tracing::debug!("its peer is gone");
                }
            }
            () = write(pieces, &written) => {}
        }
    });
    stream::poll_fn(move |context| pieces_of_file.poll_recv(context))
}

/// Passes the pieces of a file on, to its end or until the peer is gone.
async fn write(
    mut pieces: impl Stream<Item = io::Result<Bytes>> + Unpin,
    written: &mpsc::Sender<io::Result<Bytes>>,
) {
    loop {
        let piece = tokio::select! {
            () = written.closed() => return,
            piece = pieces.next() => piece,
        };
        let Some(piece) = piece else { return };
        let is_whole = piece.is_ok();
        if written.send(piece).await.is_err() || !is_whole {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use tokio::sync::oneshot;

    use super::*;

    /// Waits until nothing but the test holds a place.
    async fn left(place: &Arc<()>) {
        while Arc::strong_count(place) > 1 {
            tokio::task::yield_now().await;
        }
    }

    #[tokio::test]
    async fn a_file_that_is_not_whole_ends_with_an_error_and_leaves_its_place() {
        let (ended, end) = oneshot::channel();
        let end = async { end.await.unwrap_or("gone") };
        let piece = || Ok(Bytes::from_static(b"a row"));
        let place = Arc::new(());
        let pieces = stream::iter([piece(), piece(), piece()]).chain(stream::pending());
        let mut file = Box::pin(until(end, pieces, Arc::clone(&place)));
        assert!(file.next().await.unwrap().is_ok());
        assert_eq!(Arc::strong_count(&place), 2);
        ended.send("the permission has ended").unwrap();
        let rest: Vec<_> = file.by_ref().collect().await;
        let (broken, before) = rest.split_last().unwrap();
        assert!(before.iter().all(Result::is_ok) && before.len() <= 2);
        let broken = broken.as_ref().unwrap_err();
        assert_eq!(broken.to_string(), "the permission has ended");
        assert!(file.next().await.is_none());
        left(&place).await;
    }

    #[tokio::test]
    async fn a_file_that_its_peer_does_not_read_leaves_its_place_at_the_end() {
        let (ended, end) = oneshot::channel();
        let end = async { end.await.unwrap_or("gone") };
        let place = Arc::new(());
        let pieces = stream::repeat_with(|| Ok(Bytes::from_static(b"a row")));
        let _unread = until(end, pieces, Arc::clone(&place));
        tokio::task::yield_now().await;
        assert_eq!(Arc::strong_count(&place), 2);
        ended.send("it took too long").unwrap();
        left(&place).await;
    }

    #[tokio::test]
    async fn a_file_whose_peer_is_gone_leaves_its_place() {
        let place = Arc::new(());
        let held = Arc::clone(&place);
        drop(until(std::future::pending(), stream::pending(), held));
        left(&place).await;
    }

    #[tokio::test]
    async fn a_whole_file_ends_without_an_error() {
        let pieces = stream::iter([Ok(Bytes::from_static(b"a row"))]);
        let mut file = Box::pin(until(std::future::pending(), pieces, ()));
        assert!(file.next().await.is_some_and(|piece| piece.is_ok()));
        assert!(file.next().await.is_none());
        assert!(file.next().await.is_none(), "asked again after its end");
    }
}
