//! Ring of a robot's latest messages in memory: the data of up to the last minute, for the moment at
//! which somebody asks for them.
//!
//! The robot's task appends, and never waits; a robot that sends nothing has an empty ring. The
//! messages lie in chunks of many, so that a ring takes little more than their payloads, and a chunk
//! is dropped as a whole.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use fleetcal_domain::limits;
use fleetcal_estimator::RobotTime;
use fleetcal_proto::RecordingTopic;

use crate::tapped::Tapped;

/// Message in a chunk.
#[derive(Debug, Clone, Copy)]
struct Place {
    stamp: RobotTime,
    /// Place of its topic in the ring's topics.
    topic: u16,
    /// End of its payload in the chunk, which begins where the one before ends.
    end: u32,
}

/// Some messages that follow each other.
#[derive(Debug, Clone, Default)]
struct Chunk {
    bytes: Vec<u8>,
    places: Vec<Place>,
    /// Running time of the latest tick before its last message.
    newest: Duration,
}

impl Chunk {
    fn size(&self) -> usize {
        self.bytes.capacity() + self.places.capacity() * size_of::<Place>()
    }

    fn fits(&self, bytes: usize) -> bool {
        self.bytes.len() + bytes <= self.bytes.capacity()
    }
}

#[derive(Debug, Default)]
struct Inner {
    topics: Vec<RecordingTopic>,
    chunks: VecDeque<Arc<Chunk>>,
    /// Items that are no messages, with the running time of the latest tick before each.
    found: VecDeque<(Duration, Tapped)>,
    /// Running time of the latest tick.
    now: Duration,
    /// Most bytes at present.
    share: usize,
}

impl Inner {
    fn size(&self) -> usize {
        let chunks: usize = self.chunks.iter().map(|chunk| chunk.size()).sum();
        chunks + self.found.len() * limits::MOMENT_FOUND_BYTES
    }

    /// Returns the size of a chunk, bytes: several fit into the share.
    fn chunk_bytes(&self) -> usize {
        limits::MOMENT_CHUNK_BYTES.min(self.share / 4)
    }

    /// Returns the most items that are no messages: they take a quarter of the share at most.
    fn found_max(&self) -> usize {
        limits::MOMENT_FOUND_MAX.min(self.share / 4 / limits::MOMENT_FOUND_BYTES)
    }

    /// Appends a message. One that alone exceeds the share is left out.
    fn append(&mut self, stamp: RobotTime, topic: &RecordingTopic, payload: &[u8]) {
        if payload.len() > self.share {
            return;
        }
        let known = self.topics.iter().position(|known| known == topic);
        let place = known.unwrap_or_else(|| {
            self.topics.push(topic.clone());
            self.topics.len() - 1
        });
        let Ok(topic) = u16::try_from(place) else {
            return;
        };
        if self
            .chunks
            .back()
            .is_none_or(|last| !last.fits(payload.len()))
        {
            let bytes = payload.len().max(self.chunk_bytes());
            self.make_room(bytes);
            self.chunks.push_back(Arc::new(Chunk {
                bytes: Vec::with_capacity(bytes),
                ..Chunk::default()
            }));
        }
        let now = self.now;
        if let Some(last) = self.chunks.back_mut() {
            // Copies a chunk that somebody reads at this moment.
            let last = Arc::make_mut(last);
            last.bytes.extend_from_slice(payload);
            last.newest = now;
            let end = last.bytes.len() as u32;
            last.places.push(Place { stamp, topic, end });
        }
    }

    /// Drops the oldest chunks until another of `bytes` fits.
    fn make_room(&mut self, bytes: usize) {
        while self.size() + bytes > self.share && self.chunks.pop_front().is_some() {}
    }

    /// Drops what is too old, and what is too much.
    fn trim(&mut self) {
        let oldest = self.now.saturating_sub(limits::MOMENT_SPAN);
        while self
            .chunks
            .front()
            .is_some_and(|first| first.newest < oldest)
        {
            self.chunks.pop_front();
        }
        let found_max = self.found_max();
        while self.found.len() > found_max || self.found.front().is_some_and(|(at, _)| *at < oldest)
        {
            self.found.pop_front();
        }
        self.make_room(0);
        if self.chunks.is_empty() {
            self.topics = Vec::new();
            self.chunks = VecDeque::new();
        }
        if self.found.is_empty() {
            self.found = VecDeque::new();
        }
    }
}

/// Ring of a robot's latest messages.
#[derive(Debug)]
pub struct Ring(Mutex<Inner>);

impl Default for Ring {
    fn default() -> Self {
        Self(Mutex::new(Inner {
            share: limits::MOMENT_BYTES_OF_ROBOT_MAX,
            ..Inner::default()
        }))
    }
}

impl Ring {
    /// Appends a message.
    pub fn append_message(&self, stamp: RobotTime, topic: &RecordingTopic, payload: &[u8]) {
        self.lock().append(stamp, topic, payload);
    }

    /// Appends an estimate or event. Poses are left out: they follow from the rest.
    pub fn append(&self, item: Tapped) {
        let is_found = match &item {
            Tapped::Message { .. } | Tapped::Pose(..) => false,
            Tapped::Estimate(_) | Tapped::Change(_) | Tapped::Event { .. } => true,
        };
        if !is_found {
            return;
        }
        let mut inner = self.lock();
        let now = inner.now;
        inner.found.push_back((now, item));
        while inner.found.len() > inner.found_max() {
            inner.found.pop_front();
        }
    }

    /// Drops what is older than [`limits::MOMENT_SPAN`] at the running time `now`, and the oldest
    /// beyond `share` bytes. To be called once a second.
    pub fn tick(&self, now: Duration, share: usize) {
        let mut inner = self.lock();
        inner.now = now;
        inner.share = share;
        inner.trim();
    }

    /// Drops everything.
    pub fn clear(&self) {
        *self.lock() = Inner {
            share: limits::MOMENT_BYTES_OF_ROBOT_MAX,
            ..Inner::default()
        };
    }

    /// Returns the size in memory, bytes.
    pub fn size(&self) -> usize {
        self.lock().size()
    }

    /// Returns what it holds, without copying it.
    pub fn held(&self) -> Held {
        let inner = self.lock();
        Held {
            topics: inner.topics.clone(),
            chunks: inner.chunks.iter().cloned().collect(),
            found: inner.found.iter().map(|(_, item)| item.clone()).collect(),
        }
    }

    /// Locks the ring. It is whole after every statement, so the panic of another thread is no reason
    /// to stop.
    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Content of a ring at one time.
#[derive(Debug, Clone, Default)]
pub struct Held {
    topics: Vec<RecordingTopic>,
    chunks: Vec<Arc<Chunk>>,
    found: Vec<Tapped>,
}

/// Message that a ring holds.
#[derive(Debug, Clone, Copy)]
pub struct HeldMessage<'a> {
    /// Its header stamp.
    pub stamp: RobotTime,
    /// Its topic and type.
    pub topic: &'a RecordingTopic,
    /// Payload.
    pub payload: &'a [u8],
}

impl Held {
    /// True without any message.
    pub fn is_empty(&self) -> bool {
        self.chunks.is_empty()
    }

    /// Iterates over the messages as they came.
    pub fn messages(&self) -> impl Iterator<Item = HeldMessage<'_>> {
        self.chunks.iter().flat_map(|chunk| {
            let ends = chunk.places.iter().map(|place| place.end as usize);
            let begins = std::iter::once(0).chain(ends);
            let places = chunk.places.iter().zip(begins);
            places.filter_map(|(place, begin)| {
                Some(HeldMessage {
                    stamp: place.stamp,
                    topic: self.topics.get(usize::from(place.topic))?,
                    payload: chunk.bytes.get(begin..place.end as usize)?,
                })
            })
        })
    }

    /// Returns the estimates and events, as they came.
    pub fn found(&self) -> &[Tapped] {
        &self.found
    }
}

#[cfg(test)]
mod tests {
    use fleetcal_proto::encoding::Encoding;
    use fleetcal_proto::message_type::MessageType;

    use super::*;

    fn append(ring: &Ring, number: i64, bytes: usize) {
        let topic = RecordingTopic {
            topic: "/a/scan".to_owned(),
            message_type: MessageType::LaserScan,
            encoding: Encoding::Cdr,
        };
        ring.append_message(RobotTime(number), &topic, &vec![number as u8; bytes]);
    }

    fn stamps(ring: &Ring) -> Vec<i64> {
        ring.held().messages().map(|held| held.stamp.0).collect()
    }

    #[test]
    fn a_ring_holds_the_last_minute_and_of_a_silent_robot_nothing() {
        let ring = Ring::default();
        assert_eq!(ring.size(), 0, "nothing is allocated before there are data");
        let share = limits::MOMENT_BYTES_OF_ROBOT_MAX;
        for second in 0..100 {
            ring.tick(Duration::from_secs(second), share);
            // Each has a chunk of its own.
            append(&ring, second as i64, limits::MOMENT_CHUNK_BYTES);
        }
        assert_eq!(stamps(&ring), (39..100).collect::<Vec<i64>>());
        let held = ring.held();
        ring.tick(Duration::from_secs(99) + limits::MOMENT_SPAN, share);
        assert_eq!(stamps(&ring), [99]);
        ring.tick(Duration::from_secs(161), share);
        assert_eq!((stamps(&ring).len(), ring.size()), (0, 0));
        // What somebody holds stays whole.
        assert_eq!(held.messages().count(), 61);
        let whole = |held: HeldMessage<'_>| {
            held.payload.len() == limits::MOMENT_CHUNK_BYTES
                && held.payload.iter().all(|&byte| byte == held.stamp.0 as u8)
        };
        assert!(held.messages().all(whole));
    }

    #[test]
    fn a_ring_stays_within_its_share_and_holds_small_messages_tightly() {
        let ring = Ring::default();
        for number in 0..6_000 {
            append(&ring, number, 48);
        }
        assert_eq!(stamps(&ring).len(), 6_000);
        let size = ring.size();
        assert!(size < 6_000 * 48 * 2, "{size} bytes");
        let share = limits::MOMENT_CHUNK_BYTES * 4;
        ring.tick(Duration::ZERO, share);
        for number in 0..1_000 {
            append(&ring, number, limits::MOMENT_CHUNK_BYTES / 3);
            assert!(ring.size() <= share + limits::MOMENT_CHUNK_BYTES / 8);
        }
        assert_eq!(stamps(&ring).last(), Some(&999));
        ring.tick(Duration::ZERO, limits::MOMENT_BYTES_OF_ROBOT_MAX);
        for _ in 0..limits::MOMENT_FOUND_MAX + 5 {
            ring.append(Tapped::Event {
                stamp_ns: RobotTime(1),
                words: String::new(),
            });
        }
        assert_eq!(ring.held().found().len(), limits::MOMENT_FOUND_MAX);
    }

    #[test]
    fn rings_of_many_robots_stay_within_their_shares() {
        let robots = 2 * limits::MOMENT_BYTES_MAX / limits::MOMENT_CHUNK_BYTES;
        let share = limits::MOMENT_BYTES_MAX / robots;
        let ring = Ring::default();
        ring.tick(Duration::ZERO, share);
        append(&ring, 0, 100);
        assert!(ring.size() <= share / 2, "{} of {share} bytes", ring.size());
        for number in 1..1_000 {
            ring.append(Tapped::Event {
                stamp_ns: RobotTime(number),
                words: String::new(),
            });
            append(&ring, number, 4_000);
            ring.tick(Duration::ZERO, share);
            assert!(ring.size() <= share, "{} of {share} bytes", ring.size());
        }
        let held = ring.held();
        assert!(held.messages().count() >= 2, "{}", held.messages().count());
        assert_eq!(held.messages().last().map(|held| held.stamp.0), Some(999));
        assert!(!held.found().is_empty());
        append(&ring, 1_000, share + 1);
        assert_eq!(stamps(&ring).last(), Some(&999), "too large for its share");
    }
}
