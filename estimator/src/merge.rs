//! One merger for all of a robot's streams: messages leave it in the order of their stamps.
//!
//! Streams arrive in bursts and not quite in order. The merger holds a message until message time
//! has advanced by [`WINDOW_S`], so that the order in which streams arrive inside the window cannot
//! change a single bit of the result. Only an explicit end of the session, or a note, lets out the
//! rest: messages before a note are before it, whatever its stamp.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use serde::{Deserialize, Serialize};

use crate::stream::{Dropped, Event, Note, RobotTime};

/// Time for which a message is held, in message time, s.
pub const WINDOW_S: f64 = 0.5;
/// Jump of the stamps back that starts a new session, s.
pub const JUMP_BACK_MIN_S: f64 = 5.0;
/// Jump of the stamps ahead that must be confirmed by a second message, s.
pub const JUMP_AHEAD_MIN_S: f64 = 60.0;
/// Most messages held at once. Beyond it the oldest leaves before its time.
pub const HELD_MAX: usize = 4096;

/// Order of messages with one stamp, and their place in the queue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Stream {
    /// Notes, which former versions held by their stamps. It stands in their checkpoints.
    #[serde(rename = "n")]
    Note,
    /// Drive samples.
    #[serde(rename = "d")]
    WheelOdometry,
    /// Scans.
    #[serde(rename = "s")]
    Scan,
    /// LiDAR poses.
    #[serde(rename = "p")]
    LidarPose,
}

/// Result of the merger for a message.
#[derive(Debug, Clone, PartialEq)]
pub enum Merged {
    /// Next in order.
    Event(RobotTime, Event),
    /// A note: all messages before it have left before.
    Note(Note),
    /// Left out.
    Dropped(Dropped),
    /// A new session that begins with this stamp; the held messages of the old one have left
    /// before.
    SessionStarted(RobotTime),
}

/// Orders the messages of one robot.
#[derive(Debug, Clone, Default)]
pub struct Merger {
    held: BTreeMap<(RobotTime, Stream), Event>,
    newest: Option<RobotTime>,
    /// Time of the last message that left.
    left: Option<(RobotTime, Stream)>,
    /// A message whose stamp jumped, waiting for a second one to agree.
    suspect: Option<(RobotTime, Stream, Event)>,
}

/// Position up to which a robot's messages have left a merger: those not behind it are processed
/// already, by this merger or by the one that it continues.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct MergerPosition {
    left: Option<(RobotTime, Stream)>,
}

impl MergerPosition {
    /// True if a message has left already. A note's stamp does not show that.
    pub fn covers(&self, event: &Event) -> bool {
        place(event).is_some_and(|place| self.left.is_some_and(|left| place <= left))
    }
}

impl Merger {
    /// Continues where another merger was at this stamp: of the messages that had left it, the last
    /// was of the stream `left`. Those it held have to be sent again.
    pub fn resuming(now: RobotTime, left: Option<Stream>) -> Self {
        Self {
            newest: Some(now),
            left: left.map(|stream| (now, stream)),
            ..Self::default()
        }
    }

    /// Stream of the last message that left.
    pub fn left(&self) -> Option<Stream> {
        self.left.map(|(_, stream)| stream)
    }

    /// Position up to which messages have left.
    pub fn position(&self) -> MergerPosition {
        MergerPosition { left: self.left }
    }

    /// Adds a message; puts the messages that are in order now into `out`.
    pub fn push(&mut self, event: Event, out: &mut Vec<Merged>) {
        let Some((stamp, stream)) = place(&event) else {
            self.flush(out);
            if let Event::Note(note) = event {
                out.push(Merged::Note(note));
            }
            return;
        };
        let Some(newest) = self.newest else {
            out.push(Merged::SessionStarted(stamp));
            self.hold(stamp, stream, event, out);
            return;
        };
        let ahead_s = stamp.seconds_since(newest);
        let usual = (-JUMP_BACK_MIN_S..=JUMP_AHEAD_MIN_S).contains(&ahead_s);
        if !usual {
            self.jump(stamp, stream, event, out);
            return;
        }
        if self.suspect.take().is_some() {
            // The stream goes on where it was: the jump was one message's error.
            out.push(Merged::Dropped(Dropped::Late));
        }
        self.hold(stamp, stream, event, out);
        self.release(out);
    }

    /// Lets out everything that is held: the next messages, if any, come after it.
    pub fn flush(&mut self, out: &mut Vec<Merged>) {
        while let Some((key, event)) = self.held.pop_first() {
            self.left = Some(key);
            out.push(Merged::Event(key.0, event));
        }
    }

    fn jump(&mut self, stamp: RobotTime, stream: Stream, event: Event, out: &mut Vec<Merged>) {
        let confirmed = self
            .suspect
            .as_ref()
            .is_some_and(|(first, ..)| stamp.seconds_since(*first).abs() < JUMP_BACK_MIN_S);
        if !confirmed {
            if self.suspect.replace((stamp, stream, event)).is_some() {
                out.push(Merged::Dropped(Dropped::Late));
            }
            return;
        }
        let back = self.newest.is_some_and(|newest| stamp < newest);
        self.flush(out);
        if let Some((first, first_stream, first_event)) = self.suspect.take() {
            if back {
                self.left = None;
                out.push(Merged::SessionStarted(first.min(stamp)));
            }
            self.newest = Some(first);
            self.hold(first, first_stream, first_event, out);
        }
        self.hold(stamp, stream, event, out);
        self.release(out);
    }

    fn hold(&mut self, stamp: RobotTime, stream: Stream, event: Event, out: &mut Vec<Merged>) {
        self.newest = self.newest.max(Some(stamp));
        if self.left.is_some_and(|left| (stamp, stream) <= left) {
            let again = self.left == Some((stamp, stream));
            out.push(Merged::Dropped(if again {
                Dropped::Duplicate
            } else {
                Dropped::Late
            }));
        } else if let Entry::Vacant(place) = self.held.entry((stamp, stream)) {
            place.insert(event);
        } else {
            out.push(Merged::Dropped(Dropped::Duplicate));
        }
    }

    fn release(&mut self, out: &mut Vec<Merged>) {
        let Some(newest) = self.newest else { return };
        while let Some(entry) = self.held.first_entry() {
            let key = *entry.key();
            let due = newest.seconds_since(key.0) >= WINDOW_S;
            if !due && self.held.len() <= HELD_MAX {
                return;
            }
            if let Some((key, event)) = self.held.pop_first() {
                self.left = Some(key);
                out.push(Merged::Event(key.0, event));
            }
        }
    }
}

/// Place of a message in time; `None` of one that stands where it arrives: a note, and the end of a
/// session.
fn place(event: &Event) -> Option<(RobotTime, Stream)> {
    match event {
        Event::WheelOdometry(sample) => Some((sample.stamp(), Stream::WheelOdometry)),
        Event::Scan(scan) => Some((scan.reference_stamp(), Stream::Scan)),
        Event::LidarPose(pose) => Some((pose.stamp(), Stream::LidarPose)),
        Event::Note(_) | Event::EndOfSession => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::DriveSample;
    use proptest::prelude::*;

    fn drive(ms: i64) -> Event {
        let stamp = RobotTime(1_000_000_000_000 + ms * 1_000_000);
        Event::WheelOdometry(DriveSample::new(stamp, 1.0, 0.0).unwrap())
    }

    fn order(messages_ms: &[i64]) -> (Vec<i64>, usize, usize) {
        let mut merger = Merger::default();
        let mut out = Vec::new();
        for &ms in messages_ms {
            merger.push(drive(ms), &mut out);
        }
        merger.push(Event::EndOfSession, &mut out);
        let mut sessions = 0;
        let mut dropped = 0;
        let mut stamps = Vec::new();
        for merged in out {
            match merged {
                Merged::Event(stamp, _) => stamps.push((stamp.0 - 1_000_000_000_000) / 1_000_000),
                Merged::Dropped(_) => dropped += 1,
                Merged::Note(_) => {}
                Merged::SessionStarted(_) => sessions += 1,
            }
        }
        (stamps, dropped, sessions)
    }

    proptest! {
        #[test]
        fn any_order_inside_the_window_gives_the_same_result(seed in any::<u64>()) {
            let straight: Vec<i64> = (0..200).map(|i| i * 10).collect();
            let mut mixed = straight.clone();
            let mut state = seed;
            // Rotating stretches of 0.4 s stays inside the window of 0.5 s.
            for stretch in mixed.chunks_mut(40) {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                stretch.rotate_left((state >> 33) as usize % stretch.len());
            }
            prop_assert_eq!(order(&mixed), order(&straight));
        }
    }

    #[test]
    fn what_goes_on_from_a_stamp_takes_nothing_twice() {
        let mut out = Vec::new();
        let mut before = Merger::default();
        for event in [drive(0), drive(10), drive(600), drive(700)] {
            before.push(event, &mut out);
        }
        let position = before.position();
        assert!(position.covers(&drive(0)) && position.covers(&drive(10)));
        assert!(!position.covers(&drive(600)) && !position.covers(&drive(700)));

        let now = RobotTime(1_000_000_000_000 + 10_000_000);
        let mut after = Merger::resuming(now, before.left());
        out.clear();
        for event in [drive(10), drive(600), drive(700), drive(1_300)] {
            after.push(event, &mut out);
        }
        after.flush(&mut out);
        let mut expected = vec![Merged::Dropped(Dropped::Duplicate)];
        expected.extend([drive(600), drive(700), drive(1_300)].map(left));
        assert_eq!(out, expected);
    }

    fn left(event: Event) -> Merged {
        Merged::Event(place(&event).unwrap().0, event)
    }

    proptest! {
        /// Stamps of notes are set by people: before, inside and far beyond those that the robot
        /// has sent, by whatever clock, and twice the same.
        #[test]
        fn a_note_with_any_stamp_leaves_where_it_comes(
            stamps in prop::collection::vec(
                prop_oneof![Just(7), Just(1_000_000_050_000_000), any::<i64>()], 0..6),
            at in prop::collection::vec(0_usize..60, 6),
        ) {
            let notes: Vec<_> = stamps.iter().zip(&at).map(|(stamp, at)| {
                let kind = crate::stream::NoteKind::Reassembled;
                (*at, Note { stamp: RobotTime(*stamp), kind })
            }).collect();
            let mut merger = Merger::default();
            let mut out = Vec::new();
            for i in 0..60 {
                for (_, note) in notes.iter().filter(|(at, _)| *at == i) {
                    merger.push(Event::Note(note.clone()), &mut out);
                }
                merger.push(drive(i as i64 * 10), &mut out);
            }
            merger.flush(&mut out);
            let mut expected = Vec::new();
            for i in 0..60 {
                let of_now = notes.iter().filter(|(at, _)| *at == i);
                expected.extend(of_now.map(|(_, note)| Merged::Note(note.clone())));
                if i == 0 {
                    let first = place(&drive(0)).unwrap().0;
                    expected.push(Merged::SessionStarted(first));
                }
                expected.push(left(drive(i as i64 * 10)));
            }
            prop_assert_eq!(out, expected);
        }
    }

    #[test]
    fn late_and_double_messages_are_dropped_and_counted() {
        assert_eq!(
            order(&[0, 10, 10, 600, 700, 5]),
            (vec![0, 10, 600, 700], 2, 1)
        );
    }

    #[test]
    fn one_wild_stamp_is_dropped_and_two_start_a_session() {
        let (stamps, dropped, sessions) = order(&[0, 10, 90_000_000, 20, 30]);
        assert_eq!((stamps, dropped, sessions), (vec![0, 10, 20, 30], 1, 1));
        let (stamps, dropped, sessions) = order(&[10_000, 10_010, 0, 10, 20]);
        assert_eq!(
            (stamps, dropped, sessions),
            (vec![10_000, 10_010, 0, 10, 20], 0, 2)
        );
    }

    #[test]
    fn a_long_gap_is_no_new_session() {
        let (stamps, dropped, sessions) = order(&[0, 10, 100_000, 100_010]);
        assert_eq!(
            (stamps, dropped, sessions),
            (vec![0, 10, 100_000, 100_010], 0, 1)
        );
    }
}
