//! Tap of a robot's messages, for those who record it.
//!
//! The robot's task hands on what it takes and what came of it, and never waits: a reader that is
//! too slow misses messages, which are counted.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use fleetcal_domain::limits;
use fleetcal_estimator::RobotTime;
use fleetcal_proto::RecordingTopic;
use tokio::sync::mpsc;

use crate::ring::Ring;
use crate::tapped::Tapped;

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

/// Readers that record a robot, and the ring of what came last.
#[derive(Debug, Default)]
pub struct Taps {
    /// Ring of the latest items.
    pub(crate) ring: Ring,
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

    /// Ends all readers after the waiting items and clears the ring, because another instance takes
    /// over the robot.
    pub fn end(&self) {
        self.ring.clear();
        let mut open = self.lock();
        open.clear();
        self.count.store(0, Ordering::Release);
    }

    /// True if there is a reader.
    pub fn is_open(&self) -> bool {
        self.count.load(Ordering::Acquire) > 0
    }

    /// Passes a message of the robot on to the ring and to the readers.
    pub fn offer_message(&self, stamp: RobotTime, topic: RecordingTopic, payload: &[u8]) {
        self.ring.append_message(stamp, &topic, payload);
        if self.is_open() {
            self.pass_on(&Tapped::Message {
                stamp,
                topic,
                payload: payload.into(),
            });
        }
    }

    /// Passes another item on to the ring and to the readers.
    pub fn offer(&self, item: Tapped) {
        if self.is_open() {
            self.pass_on(&item);
        }
        self.ring.append(item);
    }

    fn pass_on(&self, item: &Tapped) {
        let mut open = self.lock();
        open.retain(|tap| !tap.items.is_closed());
        self.count.store(open.len(), Ordering::Release);
        for tap in open.iter() {
            tap.offer(item.clone());
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
        let (mut reader, mut other) = (taps.open(), taps.open());
        let half = limits::RECORDING_WAITING_BYTES_MAX / 2;
        for _ in 0..5 {
            taps.offer(message(half));
        }
        assert_eq!(reader.left_out(), 3);
        assert_eq!(reader.next().await, Some(message(half)));
        taps.offer(message(half));
        assert_eq!(reader.left_out(), 3, "there is room again");
        assert_eq!(other.left_out(), 4, "there is none");
        // Small things are bounded by their number.
        for _ in 0..limits::RECORDING_WAITING_MAX + 10 {
            taps.offer(message(0));
        }
        assert_eq!(reader.left_out(), 3 + 12);
        reader.close();
        let mut read = 0;
        while reader.next().await.is_some() {
            read += 1;
        }
        assert_eq!(read, limits::RECORDING_WAITING_MAX);
        other.close();
        taps.offer(message(0));
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
