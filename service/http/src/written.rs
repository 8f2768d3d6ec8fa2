//! Files that are made by writing, off the tasks that serve requests.

use std::io::{self, Write};

use axum::body::Bytes;
use futures::{Stream, stream};
use tokio::sync::mpsc;

/// Bytes of a piece.
const PIECE_BYTES: usize = 64 * 1024;

/// Streams what `write` writes, in pieces, then its error, if there is one. It runs on a thread for
/// blocking work, two pieces ahead of the reader at most; after the reader is gone every write fails.
pub fn written(
    write: impl FnOnce(&mut Pieces) -> io::Result<()> + Send + 'static,
) -> impl Stream<Item = io::Result<Bytes>> + Send + 'static {
    let (pieces, mut receiver) = mpsc::channel(1);
    tokio::task::spawn_blocking(move || {
        let mut to = Pieces {
            pieces,
            waiting: Vec::new(),
        };
        let done = write(&mut to).and_then(|()| to.flush());
        if let Err(error) = done
            && to.pieces.blocking_send(Err(error)).is_err()
        {
            tracing::debug!("its reader is gone");
        }
    });
    stream::poll_fn(move |context| receiver.poll_recv(context))
}

/// Writer of a file's pieces.
#[derive(Debug)]
pub struct Pieces {
    pieces: mpsc::Sender<io::Result<Bytes>>,
    /// Bytes of the next piece.
    waiting: Vec<u8>,
}

impl Write for Pieces {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let room = PIECE_BYTES - self.waiting.len();
        let part = bytes.get(..room).unwrap_or(bytes);
        self.waiting.extend_from_slice(part);
        if self.waiting.len() == PIECE_BYTES {
            self.flush()?;
        }
        Ok(part.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.waiting.is_empty() {
            return Ok(());
        }
        let piece = Bytes::from(std::mem::take(&mut self.waiting));
        let sent = self.pieces.blocking_send(Ok(piece));
        sent.map_err(|_| io::ErrorKind::BrokenPipe.into())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use futures::StreamExt;
    use tokio::sync::oneshot;

    use super::*;

    #[tokio::test]
    async fn a_file_is_streamed_in_pieces_and_its_error_comes_last() {
        let file = written(|to| {
            to.write_all(&vec![7; PIECE_BYTES + 1])?;
            Err(io::ErrorKind::UnexpectedEof.into())
        });
        let pieces: Vec<_> = file.collect().await;
        assert_eq!(pieces.len(), 2);
        assert_eq!(pieces[0].as_ref().unwrap().len(), PIECE_BYTES);
        assert!(pieces[1].is_err());
        let file = written(|to| to.write_all(&vec![7; PIECE_BYTES + 1]));
        let bytes: Vec<_> = file.map(|piece| piece.unwrap().len()).collect().await;
        assert_eq!(bytes, [PIECE_BYTES, 1]);
    }

    #[tokio::test]
    async fn what_nobody_reads_is_not_written_far_ahead_and_ends_with_its_reader() {
        let count = Arc::new(AtomicUsize::new(0));
        let of_writer = Arc::clone(&count);
        let (ended, outcome) = oneshot::channel();
        let mut file = Box::pin(written(move |to| {
            let mut write = || to.write_all(&vec![7; PIECE_BYTES]);
            let error = loop {
                if let Err(error) = write() {
                    break error;
                }
                of_writer.fetch_add(1, Ordering::SeqCst);
            };
            ended
                .send(error.kind())
                .map_err(|_| io::ErrorKind::Other.into())
        }));
        assert!(file.next().await.is_some_and(|piece| piece.is_ok()));
        drop(file);
        assert_eq!(outcome.await.unwrap(), io::ErrorKind::BrokenPipe);
        let written = count.load(Ordering::SeqCst);
        assert!(written <= 3, "{written} pieces for a reader of one");
    }
}
