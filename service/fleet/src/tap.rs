//! Tap of a robot's messages, for those who record it.
//!
//! The robot's task hands on what it takes and what came of it, and never waits: a reader that is
//! too slow misses messages, which are counted.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use fleetcal_domain::limits;
use fleetcal_domain::robot::ServiceEvent;
use fleetcal_estimator::{Pose2, RobotTime};
use fleetcal_proto::RecordingTopic;
use fleetcal_proto::estimate::{ChangeDocument, EstimateDocument};
use fleetcal_proto::event::RobotEvent;
use tokio::sync::mpsc;

use crate::words::word;

/// Item of a session that is being recorded.
#[derive(Debug, Clone, PartialEq)]
pub enum Tapped {
    /// A message of the robot that was processed.
    Message {
        /// Its header stamp.
        stamp: RobotTime,
        /// Its topic and type.
        topic: RecordingTopic,
        /// Payload.
        payload: Arc<[u8]>,
    },
    /// Pose of the rear axle in the filter's odometry frame.
    Pose(RobotTime, Pose2),
    /// The new estimate.
    Estimate(Arc<EstimateDocument>),
    /// A change or fault.
    Change(ChangeDocument),
    /// Another event, in words.
    Event {
        /// Its time, ns since 1970 by the robot's clock.
        stamp_ns: RobotTime,
        /// The words.
        words: String,
    },
}

impl Tapped {
    /// Makes the item of a note of a person or tool.
    pub fn of_note(note: &RobotEvent) -> Self {
        Self::in_words(note.stamp_ns, &word(&note.kind), &note.note)
    }

    /// Makes the item of an event of the service about the robot.
    pub fn of_service_event(event: &ServiceEvent) -> Self {
        Self::in_words(event.stamp_ns, &word(&event.kind), &event.note)
    }

    fn in_words(stamp_ns: RobotTime, kind: &str, note: &str) -> Self {
        let words = match note {
            "" => kind.to_owned(),
            note => format!("{kind}: {note}"),
        };
        Self::Event { stamp_ns, words }
    }

    /// Returns the size that it takes of the room for payloads.
    fn bytes(&self) -> usize {
        match self {
            Self::Message { payload, .. } => payload.len(),
            _ => 0,
        }
    }
}

/// Counters that a reader and the robot's task share.
#[derive(Debug, Default)]
struct Counts {
    /// Bytes of payloads that wait for the reader.
    waiting_bytes: AtomicUsize,
    /// Items that it missed.
    left_out: AtomicU64,
}

#[derive(Debug)]
struct Tap {
    items: mpsc::Sender<Tapped>,
    counts: Arc<Counts>,
}

impl Tap {
    fn offer(&self, item: Tapped) {
        let bytes = item.bytes();
        let counts = &self.counts;
        let waiting = counts.waiting_bytes.load(Ordering::Relaxed);
        let fits = waiting.saturating_add(bytes) <= limits::RECORDING_WAITING_BYTES_MAX;
        // Added first: the reader may be faster than the next line.
        counts.waiting_bytes.fetch_add(bytes, Ordering::Relaxed);
        if !fits || self.items.try_send(item).is_err() {
            counts.waiting_bytes.fetch_sub(bytes, Ordering::Relaxed);
            counts.left_out.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// Readers that record a robot.
#[derive(Debug, Default)]
pub struct Taps {
    open: Mutex<Vec<Tap>>,
    /// Number of readers, to be read without the lock.
    count: AtomicUsize,
}

impl Taps {
    /// Opens a reader of all items from now on.
    pub fn open(&self) -> TapReader {
        let (sender, items) = mpsc::channel(limits::RECORDING_WAITING_MAX);
        let counts = Arc::new(Counts::default());
        let mut open = self.lock();
        // A robot that sends nothing clears no places of those who have gone.
        open.retain(|tap| !tap.items.is_closed());
        open.push(Tap {
            items: sender,
            counts: Arc::clone(&counts),
        });
        self.count.store(open.len(), Ordering::Release);
        TapReader { items, counts }
    }

    /// Ends all readers after the waiting items, because another instance takes over the robot.
    pub fn end(&self) {
        let mut open = self.lock();
        open.clear();
        self.count.store(0, Ordering::Release);
    }

    /// True if there is a reader.
    pub fn is_open(&self) -> bool {
        self.count.load(Ordering::Acquire) > 0
    }

    /// Passes on the result of `item`, which is called only if there is a reader.
    pub fn offer(&self, item: impl FnOnce() -> Option<Tapped>) {
        if !self.is_open() {
            return;
        }
        let item = item();
        let mut open = self.lock();
        open.retain(|tap| !tap.items.is_closed());
        self.count.store(open.len(), Ordering::Release);
        if let Some(item) = item {
            for tap in open.iter() {
                tap.offer(item.clone());
            }
        }
    }

    /// Locks the list. It is whole after every statement, so the panic of another thread is no
    /// reason to stop.
    fn lock(&self) -> MutexGuard<'_, Vec<Tap>> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Reader of a robot's session; dropping it ends the reading.
#[derive(Debug)]
pub struct TapReader {
    items: mpsc::Receiver<Tapped>,
    counts: Arc<Counts>,
}

impl TapReader {
    /// Returns the next item; `None` after [`Self::close`] and the items that waited then, and once
    /// another instance has the robot.
    pub async fn next(&mut self) -> Option<Tapped> {
        let item = self.items.recv().await?;
        let bytes = item.bytes();
        self.counts
            .waiting_bytes
            .fetch_sub(bytes, Ordering::Relaxed);
        Some(item)
    }

    /// Accepts no further items; those that wait remain.
    pub fn close(&mut self) {
        self.items.close();
    }

    /// Returns the number of missed items.
    pub fn left_out(&self) -> u64 {
        self.counts.left_out.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use fleetcal_proto::encoding::Encoding;
    use fleetcal_proto::message_type::MessageType;

    use super::*;

    fn message(bytes: usize) -> Tapped {
        Tapped::Message {
            stamp: RobotTime(1),
            topic: RecordingTopic {
                topic: "/a/scan".to_owned(),
                message_type: MessageType::LaserScan,
                encoding: Encoding::Cdr,
            },
            payload: vec![0; bytes].into(),
        }
    }

    #[tokio::test]
    async fn a_slow_reader_misses_what_is_too_much_and_is_told_how_much() {
        let taps = Taps::default();
        taps.offer(|| panic!("nobody reads"));
        let (mut reader, mut other) = (taps.open(), taps.open());
        let half = limits::RECORDING_WAITING_BYTES_MAX / 2;
        for _ in 0..5 {
            taps.offer(|| Some(message(half)));
        }
        assert_eq!(reader.left_out(), 3);
        assert_eq!(reader.next().await, Some(message(half)));
        taps.offer(|| Some(message(half)));
        assert_eq!(reader.left_out(), 3, "there is room again");
        assert_eq!(other.left_out(), 4, "there is none");
        // Small things are bounded by their number.
        for _ in 0..limits::RECORDING_WAITING_MAX + 10 {
            taps.offer(|| Some(message(0)));
        }
        assert_eq!(reader.left_out(), 3 + 12);
        reader.close();
        let mut read = 0;
        while reader.next().await.is_some() {
            read += 1;
        }
        assert_eq!(read, limits::RECORDING_WAITING_MAX);
        other.close();
        taps.offer(|| Some(message(0)));
        assert!(!taps.is_open());
    }

    #[test]
    fn who_has_gone_leaves_nothing_behind_though_the_robot_is_silent() {
        let taps = Taps::default();
        let stays = taps.open();
        for _ in 0..100 {
            drop(taps.open());
        }
        assert_eq!(taps.lock().len(), 2, "who stays, and the last that went");
        assert_eq!(taps.count.load(Ordering::Acquire), 2);
        drop(stays);
        drop(taps.open());
        assert_eq!(taps.lock().len(), 1);
    }
}
