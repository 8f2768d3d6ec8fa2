//! Recordings whose readers are slow.

use std::future::pending;

use fleetcal_estimator::RobotTime;
use fleetcal_fleet::{Tapped, Taps};
use fleetcal_proto::RecordingTopic;
use fleetcal_proto::encoding::Encoding;
use fleetcal_proto::message_type::MessageType;
use fleetcal_robot::recording::Recording as Recorded;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

use super::*;

const MESSAGES: usize = 64;
/// Size of a message, that of one piece.
const MESSAGE_BYTES: usize = 1 << 20;
/// Duration beyond that of any test.
const LONG: Duration = Duration::from_mins(10);
const SHORT: Duration = Duration::from_millis(500);

fn message() -> Tapped {
    Tapped::Message {
        stamp: RobotTime(1),
        topic: RecordingTopic {
            topic: "/a/scan".to_owned(),
            message_type: MessageType::LaserScan,
            encoding: Encoding::Cdr,
        },
        payload: vec![0; MESSAGE_BYTES].into(),
    }
}

/// Recording that has begun, and its robot.
struct Begun {
    taps: Taps,
    pieces: mpsc::Receiver<Vec<u8>>,
    end: oneshot::Sender<()>,
    recording: JoinHandle<Result<(), LiveError>>,
}

fn begin(patience: Patience) -> Begun {
    let taps = Taps::default();
    let (sender, pieces) = mpsc::channel(limits::RECORDING_PIECES_WAITING_MAX);
    let (end, ended) = oneshot::channel();
    let ended = async {
        if ended.await.is_err() {
            pending::<()>().await;
        }
    };
    let robot = RobotId::parse("a").unwrap();
    let recording = tokio::spawn(record(robot, taps.open(), sender, patience, ended));
    Begun {
        taps,
        pieces,
        end,
        recording,
    }
}

impl Begun {
    /// Sends the robot's messages without waiting.
    async fn send(&self) {
        for _ in 0..MESSAGES {
            self.taps.offer(message());
            tokio::task::yield_now().await;
        }
    }

    /// Result of the recording.
    async fn outcome(self) -> Result<(), LiveError> {
        let outcome = timeout(Duration::from_mins(1), self.recording).await;
        outcome.expect("the recording does not end").unwrap()
    }
}

/// Reads to the end.
async fn read(mut pieces: mpsc::Receiver<Vec<u8>>) -> Vec<u8> {
    let mut file = Vec::new();
    while let Some(piece) = pieces.recv().await {
        file.extend(piece);
    }
    file
}

/// Numbers of scans in a file, and of messages that it reports as missing; the file must be
/// complete.
fn counted(file: &[u8]) -> (u64, u64) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    std::fs::write(&path, file).unwrap();
    let scans = Recorded::open(&path).unwrap().count(&["/a/scan"]);
    let key = b"left_out";
    let at = file.windows(key.len()).position(|bytes| bytes == key);
    let value = &file[at.unwrap() + key.len()..];
    let length = u32::from_le_bytes(value[..4].try_into().unwrap()) as usize;
    let left_out = std::str::from_utf8(&value[4..4 + length]).unwrap();
    (scans, left_out.parse().unwrap())
}

#[tokio::test]
async fn who_takes_nothing_gets_no_more_and_the_robot_does_not_wait() {
    let begun = begin(Patience {
        piece: SHORT,
        rest: LONG,
    });
    begun.send().await;
    match begun.outcome().await {
        Err(LiveError::Stalled { left_out, .. }) => {
            assert!(left_out > 0 && left_out < MESSAGES as u64, "{left_out}");
        }
        other => panic!("{other:?}"),
    }
}

#[tokio::test]
async fn who_reads_too_late_has_a_whole_file_that_counts_what_is_missing() {
    let begun = begin(Patience {
        piece: LONG,
        rest: LONG,
    });
    begun.send().await;
    begun.end.send(()).unwrap();
    let (scans, left_out) = counted(&read(begun.pieces).await);
    assert!(left_out > 0, "nothing is missing");
    assert_eq!(scans + left_out, MESSAGES as u64);
    begun.recording.await.unwrap().unwrap();
}

#[tokio::test]
async fn who_reads_in_time_misses_nothing() {
    let mut begun = begin(Patience::default());
    let pieces = std::mem::replace(&mut begun.pieces, mpsc::channel(1).1);
    let reading = tokio::spawn(read(pieces));
    begun.send().await;
    begun.end.send(()).unwrap();
    let file = reading.await.unwrap();
    assert_eq!(counted(&file), (MESSAGES as u64, 0));
}

#[tokio::test]
async fn after_the_end_the_rest_has_one_deadline() {
    let mut begun = begin(Patience {
        piece: LONG,
        rest: SHORT,
    });
    begun.send().await;
    let end = std::mem::replace(&mut begun.end, oneshot::channel().0);
    end.send(()).unwrap();
    let outcome = begun.outcome().await;
    assert!(
        matches!(outcome, Err(LiveError::RestNotTaken(waited)) if waited == SHORT),
        "{outcome:?}"
    );
}
