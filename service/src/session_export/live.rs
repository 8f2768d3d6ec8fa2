//! The session of a robot that drives now, handed on piece by piece as it is written.

use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use fleetcal_proto::RobotId;
use fleetcal_robot::recording::RecordingError;
use tokio::sync::mpsc;

use super::SessionExport;
use crate::fleet::{TapReader, Tapped};
use crate::limits;

/// What was written and not handed on yet. A session's writer fills it, [`record`] empties it.
#[derive(Debug, Clone, Default)]
struct Spool(Arc<Mutex<Vec<u8>>>);

impl Spool {
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

/// Whether the other side takes more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Reader {
    /// It does.
    Takes,
    /// It has gone, or takes nothing any more.
    Gone,
}

/// A recording on its way to whoever fetches it.
struct Recording {
    export: SessionExport<Spool>,
    spool: Spool,
    pieces: mpsc::Sender<Vec<u8>>,
    /// What was handed on, bytes.
    sent: u64,
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

    /// Hands on what was written.
    async fn hand_on(&mut self) -> Reader {
        let piece = self.spool.take();
        hand_on(&self.pieces, piece, &mut self.sent).await
    }
}

async fn hand_on(pieces: &mpsc::Sender<Vec<u8>>, piece: Vec<u8>, sent: &mut u64) -> Reader {
    if piece.is_empty() {
        return Reader::Takes;
    }
    *sent += piece.len() as u64;
    let handed = tokio::time::timeout(limits::SESSION_STALLED_AFTER, pieces.send(piece)).await;
    match handed {
        Ok(Ok(())) => Reader::Takes,
        Ok(Err(_)) | Err(_) => Reader::Gone,
    }
}

/// Writes a robot's session into `pieces` until `end`, or until it is
/// [`limits::SESSION_BYTES_MAX`] long or nobody takes it. Then the file is whole, unless the
/// reader has gone.
///
/// # Errors
/// When something cannot be written.
pub async fn record(
    robot: RobotId,
    mut tap: TapReader,
    pieces: mpsc::Sender<Vec<u8>>,
    end: impl Future<Output = ()> + Send,
) -> Result<(), RecordingError> {
    let path = PathBuf::from(format!("{robot}.mcap"));
    let spool = Spool::default();
    let mut recording = Recording {
        export: SessionExport::begin(&path, spool.clone(), &robot)?,
        spool,
        pieces,
        sent: 0,
    };
    tokio::pin!(end);
    let mut ended = false;
    loop {
        let item = tokio::select! {
            () = &mut end, if !ended => {
                // What waits was before the end.
                ended = true;
                tap.close();
                continue;
            }
            () = recording.pieces.closed() => return Ok(()),
            item = tap.next() => item,
        };
        let Some(item) = item else { break };
        recording.add(item)?;
        if recording.hand_on().await == Reader::Gone {
            return Ok(());
        }
        if recording.sent > limits::SESSION_BYTES_MAX {
            break;
        }
    }
    let left_out = tap.left_out();
    drop(tap);
    let Recording {
        mut export,
        spool,
        pieces,
        mut sent,
    } = recording;
    export.left_out(left_out)?;
    export.finish()?;
    // A reader that has gone needs no end.
    hand_on(&pieces, spool.take(), &mut sent).await;
    Ok(())
}
