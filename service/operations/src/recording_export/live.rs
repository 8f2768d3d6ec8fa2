//! Live recording of a robot, delivered piece by piece while it is written.

use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use fleetcal_domain::limits;
use fleetcal_fleet::TapReader;
use fleetcal_proto::RobotId;
use fleetcal_robot::recording::RecordingError;
use thiserror::Error;
use tokio::sync::mpsc;
use tokio::time::timeout;

use super::RecordingExport;

/// Spool of written bytes that were not delivered yet: the writer of the recording fills it, and
/// [`record`] empties it.
#[derive(Debug, Clone, Default)]
struct Spool(Arc<Mutex<Vec<u8>>>);

impl Spool {
    fn is_empty(&self) -> bool {
        let spool = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        spool.is_empty()
    }

    fn take(&self) -> Vec<u8> {
        std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Write for Spool {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut spool = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        spool.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Time for which a recording waits for its client.
#[derive(Debug, Clone, Copy)]
pub struct Patience {
    /// Time for one piece to be read.
    pub piece: Duration,
    /// Time after the end for the rest to be read.
    pub rest: Duration,
}

impl Default for Patience {
    fn default() -> Self {
        Self {
            piece: limits::RECORDING_STALLED_AFTER,
            rest: limits::RECORDING_REST_TAKEN_WITHIN,
        }
    }
}

/// Reason for which a recording ended early. The delivered part lacks its end.
#[derive(Debug, Error)]
pub enum LiveError {
    /// Data that cannot be written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// Client that does not read any more.
    #[error(
        "the client took nothing for {:.0} s; {left_out} messages had been left out",
        patience.as_secs_f64()
    )]
    Stalled {
        /// Time for which it waited.
        patience: Duration,
        /// Number of messages that had arrived too fast for the client by then.
        left_out: u64,
    },
    /// Rest after the end that was read too slowly.
    #[error("the client did not take the rest within {:.0} s", .0.as_secs_f64())]
    RestNotTaken(Duration),
}

/// State of the client.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Reader {
    /// Client that reads.
    Takes,
    /// Client that is gone.
    Gone,
}

/// Delivery of written bytes to the client.
struct Delivery {
    spool: Spool,
    pieces: mpsc::Sender<Vec<u8>>,
    patience: Duration,
    /// Delivered bytes.
    sent: u64,
}

impl Delivery {
    /// Delivers the written bytes. Cancelling it loses none.
    async fn hand_on(&mut self, tap: &TapReader) -> Result<Reader, LiveError> {
        if self.spool.is_empty() {
            return Ok(Reader::Takes);
        }
        match timeout(self.patience, self.pieces.reserve()).await {
            Ok(Ok(place)) => {
                let piece = self.spool.take();
                self.sent += piece.len() as u64;
                place.send(piece);
                Ok(Reader::Takes)
            }
            Ok(Err(_)) => Ok(Reader::Gone),
            Err(_) => Err(LiveError::Stalled {
                patience: self.patience,
                left_out: tap.left_out(),
            }),
        }
    }

    /// True if the recording has its largest size.
    fn is_full(&self) -> bool {
        self.sent > limits::RECORDING_BYTES_MAX
    }
}

/// Recording and its delivery to the client.
struct Recording {
    export: RecordingExport<Spool>,
    delivery: Delivery,
}

impl Recording {
    /// Writes and delivers items, until `end`, or until the recording is full or the client is
    /// gone.
    async fn follow(
        &mut self,
        tap: &mut TapReader,
        end: impl Future<Output = ()> + Send,
    ) -> Result<Reader, LiveError> {
        tokio::pin!(end);
        while !self.delivery.is_full() {
            let item = tokio::select! {
                () = &mut end => break,
                () = self.delivery.pieces.closed() => return Ok(Reader::Gone),
                item = tap.next() => item,
            };
            let Some(item) = item else { break };
            self.export.tapped(&item)?;
            let reader = tokio::select! {
                // What was written is handed on with the rest.
                () = &mut end => break,
                reader = self.delivery.hand_on(tap) => reader?,
            };
            if reader == Reader::Gone {
                return Ok(Reader::Gone);
            }
        }
        Ok(Reader::Takes)
    }

    /// Delivers the items that waited before the end, and the end of the file.
    async fn finish(mut self, mut tap: TapReader) -> Result<(), LiveError> {
        tap.close();
        while !self.delivery.is_full()
            && let Some(item) = tap.next().await
        {
            self.export.tapped(&item)?;
            if self.delivery.hand_on(&tap).await? == Reader::Gone {
                return Ok(());
            }
        }
        self.export.left_out(tap.left_out())?;
        self.export.finish()?;
        // A reader that has gone needs no end.
        self.delivery.hand_on(&tap).await?;
        Ok(())
    }
}

/// Writes a recording of a robot into `pieces` until `end`, or until it is
/// [`limits::RECORDING_BYTES_MAX`] long. Then the file is complete, unless the client is gone.
///
/// # Errors
/// If an item cannot be written, or the client does not read: the file then lacks its end.
pub async fn record(
    robot: RobotId,
    mut tap: TapReader,
    pieces: mpsc::Sender<Vec<u8>>,
    patience: Patience,
    end: impl Future<Output = ()> + Send,
) -> Result<(), LiveError> {
    let path = PathBuf::from(format!("{robot}.mcap"));
    let spool = Spool::default();
    let mut recording = Recording {
        export: RecordingExport::begin(&path, spool.clone(), &robot)?,
        delivery: Delivery {
            spool,
            pieces,
            patience: patience.piece,
            sent: 0,
        },
    };
    if recording.follow(&mut tap, end).await? == Reader::Gone {
        return Ok(());
    }
    timeout(patience.rest, recording.finish(tap))
        .await
        .unwrap_or(Err(LiveError::RestNotTaken(patience.rest)))
}

#[cfg(test)]
mod tests;
