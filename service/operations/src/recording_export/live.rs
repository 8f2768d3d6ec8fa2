//! A recording of a robot that drives now, handed on piece by piece as it is written.

use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use fleetcal_domain::limits;
use fleetcal_fleet::{TapReader, Tapped};
use fleetcal_proto::RobotId;
use fleetcal_robot::recording::RecordingError;
use thiserror::Error;
use tokio::sync::mpsc;
use tokio::time::timeout;

use super::RecordingExport;

/// What was written and not handed on yet. The writer of the recording fills it, [`record`] empties it.
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

/// How long a recording waits for whoever fetches it.
#[derive(Debug, Clone, Copy)]
pub struct Patience {
    /// For one piece to be taken.
    pub piece: Duration,
    /// After the end, for all that is left.
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

/// Why a recording was broken off. What was handed on of it lacks its end.
#[derive(Debug, Error)]
pub enum LiveError {
    /// Something cannot be written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// Nobody takes it any more.
    #[error(
        "the client took nothing for {:.0} s; {left_out} messages had been left out",
        patience.as_secs_f64()
    )]
    Stalled {
        /// How long it waited.
        patience: Duration,
        /// What had come too fast for the reader by then.
        left_out: u64,
    },
    /// The end came, and the rest was taken too slowly.
    #[error("the client did not take the rest within {:.0} s", .0.as_secs_f64())]
    RestNotTaken(Duration),
}

/// Whether the other side takes more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Reader {
    /// It does.
    Takes,
    /// It has gone.
    Gone,
}

/// The way of what was written to whoever fetches it.
struct Delivery {
    spool: Spool,
    pieces: mpsc::Sender<Vec<u8>>,
    patience: Duration,
    /// What was handed on, bytes.
    sent: u64,
}

impl Delivery {
    /// Hands on what was written. To stop this loses nothing.
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

    /// Whether it is as long as it may be.
    fn is_full(&self) -> bool {
        self.sent > limits::RECORDING_BYTES_MAX
    }
}

/// A recording on its way to whoever fetches it.
struct Recording {
    export: RecordingExport<Spool>,
    delivery: Delivery,
}

impl Recording {
    /// Writes down what happened.
    fn add(&mut self, item: Tapped) -> Result<(), RecordingError> {
        let export = &mut self.export;
        match item {
            Tapped::Message {
                stamp,
                topic,
                payload,
            } => export.message(stamp, &topic, &payload),
            Tapped::Pose(stamp, pose) => export.pose(stamp, &pose),
            Tapped::Estimate(document) => export.estimate(&document),
            Tapped::Change(change) => export.change(&change),
            Tapped::Event { stamp_ns, words } => export.event(stamp_ns, &words),
        }
    }

    /// Writes and hands on what happens, until `end`, or until it is full or nobody takes it.
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
            self.add(item)?;
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

    /// Hands on what waits, which was before the end, and the end of the file.
    async fn finish(mut self, mut tap: TapReader) -> Result<(), LiveError> {
        tap.close();
        while !self.delivery.is_full()
            && let Some(item) = tap.next().await
        {
            self.add(item)?;
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
/// [`limits::RECORDING_BYTES_MAX`] long. Then the file is whole, unless the reader has gone.
///
/// # Errors
/// When something cannot be written, or nobody takes it: the file then lacks its end.
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
