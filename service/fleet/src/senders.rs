//! Detection of two senders that use one robot's id.
//!
//! Zenoh does not say who put a sample, and stamps do not either: those of one robot may stand still,
//! go back, or come at two steps in turn. Two things tell:
//! - Origins that take turns. A robot that connects again does not come back to the connection before,
//!   but for what was on its way; and what two bridges of one robot bring comes twice.
//! - A steering angle that jumps to and fro between two rows, each of them smooth: no wheel does that.
//!
//! Where both are silent, everything is used, as in `fleetcal calibrate`.

use std::collections::VecDeque;
use std::f64::consts::TAU;

use fleetcal_estimator::RobotTime;
use fleetcal_model::Stream;

/// Messages of one stream whose origins are compared: for wheel odometry, two seconds.
const TURNS_WINDOW: usize = 200;
/// Returns of an origin after another one, among the messages of the window, from which on there
/// are two senders. Only messages newer than all before count, which a robot sends over its latest
/// connection alone.
const RETURNS_MIN: usize = 5;
/// Same limit for messages of any stamp, after as many as a slower bridge would have repeated: some
/// may have been in flight when a robot connected again.
const LATE_RETURNS_MIN: usize = 30;
/// Steering angles of one stream that are compared.
const ANGLES_WINDOW: usize = 20;
/// Least distance of two series of angles, rad.
const ROWS_APART_RAD: f64 = 0.1;
/// Largest share of the distance to the other series that the steps of a smooth series may have.
const SMOOTH_SHARE: f64 = 0.25;
/// Changes between the series within the window from which on there are two senders.
const CHANGES_MIN: u32 = 8;
/// Messages without a sign of two senders after which there is one again.
const CALM_MESSAGES: u32 = 400;
/// Same limit after a detection by angles, which show nothing while both robots drive straight
/// ahead.
const CALM_MESSAGES_BY_ANGLES: u32 = 4_000;
/// Messages of one stream whose stamps serve to count the missing ones.
const STEPS_WINDOW: usize = 20;
/// Shortest pause that counts as one, ns: a robot that stopped sending has lost nothing.
const PAUSE_NS: i64 = 10_000_000_000;

/// Connection that a message came by, while it lasts, and its publisher, where the message names
/// one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Origin(pub u64);

/// Evidence of a message's sender.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sent {
    /// Its stamp.
    pub stamp: RobotTime,
    /// Hash of its bytes.
    pub content: u64,
    /// Origin, where that is known.
    pub origin: Option<Origin>,
    /// Steering angle in the message, rad.
    pub steering_rad: Option<f64>,
}

/// Message and its origin.
#[derive(Debug, Clone, Copy)]
struct Brought {
    stamp: RobotTime,
    content: u64,
    origin: Origin,
    /// True if another origin sent the same message.
    is_shared: bool,
}

/// One stream's latest messages of known origin.
#[derive(Debug, Default)]
struct Turns {
    messages: VecDeque<Brought>,
}

impl Turns {
    /// Adds a message; returns whether origins take turns.
    fn take(&mut self, sent: &Sent, origin: Origin) -> bool {
        let mut message = Brought {
            stamp: sent.stamp,
            content: sent.content,
            origin,
            is_shared: false,
        };
        let is_other = self
            .messages
            .back()
            .is_some_and(|last| last.origin != origin);
        for twin in &mut self.messages {
            let is_same = (twin.stamp, twin.content) == (message.stamp, message.content);
            if is_same && twin.origin != origin {
                twin.is_shared = true;
                message.is_shared = true;
            }
        }
        self.messages.push_back(message);
        if self.messages.len() > TURNS_WINDOW {
            self.messages.pop_front();
        }
        is_other && self.are_taken()
    }

    /// True if the latest messages came from more than one origin.
    fn are_of_several(&self) -> bool {
        let mut origins = self.messages.iter().map(|message| message.origin);
        let first = origins.next();
        origins.any(|origin| Some(origin) != first)
    }

    fn are_taken(&self) -> bool {
        let own = || self.messages.iter().filter(|message| !message.is_shared);
        let mut newest = None;
        let newer = own().filter(|message| {
            let is_newer = Some(message.stamp) > newest;
            newest = newest.max(Some(message.stamp));
            is_newer
        });
        let newer = returns(newer);
        let all = returns(own());
        // Of two bridges each loses a message now and then that the other brings.
        let shared = (self.messages.len() - own().count()) / 2;
        let is_full = self.messages.len() == TURNS_WINDOW;
        newer >= RETURNS_MIN && newer > shared || is_full && all >= LATE_RETURNS_MIN && all > shared
    }
}

/// Counts the returns of an origin after another one.
fn returns<'m>(messages: impl Iterator<Item = &'m Brought>) -> usize {
    let (mut last, mut known, mut returns) = (None, Vec::new(), 0);
    for message in messages {
        let is_known = known.contains(&message.origin);
        returns += usize::from(is_known && last != Some(message.origin));
        if !is_known {
            known.push(message.origin);
        }
        last = Some(message.origin);
    }
    returns
}

/// One stream's latest steering angles, rad.
#[derive(Debug, Default)]
struct Angles {
    latest: VecDeque<f64>,
}

impl Angles {
    /// Adds an angle; returns whether the latest ones form two series.
    fn take(&mut self, angle_rad: f64) -> bool {
        self.latest.push_back(angle_rad);
        if self.latest.len() <= ANGLES_WINDOW {
            return false;
        }
        self.latest.pop_front();
        self.are_two_rows()
    }

    fn are_two_rows(&self) -> bool {
        let Some(&first) = self.latest.front() else {
            return false;
        };
        let mut others = self.latest.iter();
        let Some(&second) = others.find(|angle| apart_rad(**angle, first) >= ROWS_APART_RAD) else {
            return false;
        };
        // Each angle goes on with the row whose last one is nearer.
        let (mut first_row, mut second_row) = (first, second);
        let (mut was_first, mut changes) = (true, 0);
        for &angle in &self.latest {
            let (to_first, to_second) = (apart_rad(angle, first_row), apart_rad(angle, second_row));
            let is_first = to_first <= to_second;
            let (own, other) = if is_first {
                (to_first, to_second)
            } else {
                (to_second, to_first)
            };
            if other < ROWS_APART_RAD || own > SMOOTH_SHARE * other {
                return false;
            }
            changes += u32::from(is_first != was_first);
            was_first = is_first;
            *if is_first {
                &mut first_row
            } else {
                &mut second_row
            } = angle;
        }
        changes >= CHANGES_MIN
    }
}

/// Returns the angle between two directions of a wheel, rad; a whole turn counts as zero.
fn apart_rad(a: f64, b: f64) -> f64 {
    let turned = (a - b).rem_euclid(TAU);
    turned.min(TAU - turned)
}

/// One stream's latest stamps, ns.
#[derive(Debug, Default)]
struct Stamps {
    latest: VecDeque<i64>,
}

impl Stamps {
    fn take(&mut self, stamp: RobotTime) {
        self.latest.push_back(stamp.0);
        if self.latest.len() > STEPS_WINDOW {
            self.latest.pop_front();
        }
    }

    /// Returns the number of messages missing before the newest, by the usual step of those before
    /// it.
    fn missing(&self) -> u64 {
        if self.latest.len() < STEPS_WINDOW {
            return 0;
        }
        let both = self.latest.iter().zip(self.latest.iter().skip(1));
        let mut steps: Vec<i64> = both.map(|(one, next)| next.saturating_sub(*one)).collect();
        let Some(newest) = steps.pop() else {
            return 0;
        };
        steps.sort_unstable();
        let usual = steps.get(steps.len() / 2).copied().unwrap_or_default();
        if usual <= 0 || newest >= PAUSE_NS || newest.saturating_mul(2) < usual.saturating_mul(3) {
            return 0;
        }
        ((newest + usual / 2) / usual - 1).max(0).unsigned_abs()
    }
}

/// One stream's latest messages.
#[derive(Debug, Default)]
struct Latest {
    turns: Turns,
    angles: Angles,
    stamps: Stamps,
}

impl Latest {
    /// Adds a message; returns the number of messages from now on that count as sent by two
    /// senders.
    fn take(&mut self, sent: &Sent) -> u32 {
        self.stamps.take(sent.stamp);
        let turns = sent
            .origin
            .is_some_and(|origin| self.turns.take(sent, origin));
        let rows = sent
            .steering_rad
            .is_some_and(|angle| self.angles.take(angle));
        match (turns, rows) {
            (false, false) => 0,
            // Two origins go on telling while both drive straight ahead.
            (false, true) if !self.turns.are_of_several() => CALM_MESSAGES_BY_ANGLES,
            _ => CALM_MESSAGES,
        }
    }
}

/// Detector of two senders, from a robot's messages.
#[derive(Debug, Default)]
pub struct Senders {
    latest: [Latest; Stream::COUNT],
    /// Messages until there is one sender again, unless another sign of two comes before; 0 while
    /// there is one.
    calm_after: u32,
}

impl Senders {
    /// Adds a message; returns whether two senders use the id.
    pub fn take(&mut self, stream: Stream, sent: &Sent) -> bool {
        if stream != Stream::Event
            && let Some(latest) = self.latest.get_mut(stream.index())
        {
            let told = latest.take(sent);
            self.calm_after = self.calm_after.saturating_sub(1).max(told);
        }
        self.are_two()
    }

    /// Returns the number of messages of a stream missing before the last one.
    pub fn missing(&self, stream: Stream) -> u64 {
        let latest = self.latest.get(stream.index());
        latest
            .filter(|_| !self.are_two())
            .map_or(0, |latest| latest.stamps.missing())
    }

    /// True if two senders use the id.
    pub const fn are_two(&self) -> bool {
        self.calm_after > 0
    }
}

#[cfg(test)]
mod tests;
