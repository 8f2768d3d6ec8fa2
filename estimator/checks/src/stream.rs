//! One stream: the number of its messages, their frames, and their stamps.

use fleetcal_model::{RobotTime, Stream};

use crate::cause::Cause;
use crate::finding::Suspicion;
use crate::stamps::StampWatch;

/// Most frames that are distinguished.
const FRAMES_MAX: usize = 4;
/// Longest name of a frame that is kept, and longest reason, bytes.
const TEXT_BYTES_MAX: usize = 200;
/// Share of refused messages that is named, and number of them.
const REFUSED_MIN_SHARE: f64 = 0.05;
const REFUSED_MIN: u64 = 10;
/// Share of the messages that a further frame has to have.
const FRAME_MIN_SHARE: f64 = 0.05;

/// Report on a stream.
#[derive(Debug, Clone, PartialEq)]
pub struct StreamReport {
    /// The stream.
    pub stream: Stream,
    /// Messages that came.
    pub messages: u64,
    /// Messages that were refused.
    pub refused: u64,
    /// Reason of the first refusal.
    pub first_refusal: Option<String>,
    /// Messages a second of arrival.
    pub rate_hz: f64,
    /// Median time between stamps, ms.
    pub period_ms: Option<f64>,
    /// Median time from stamp to arrival, ms.
    pub age_ms: Option<f64>,
    /// Distance of the latest stamps from a whole number of periods, ms: four in five are nearer.
    pub uneven_ms: Option<f64>,
    /// Messages with the stamp of the one before.
    pub repeated: u64,
    /// Messages stamped before the one before.
    pub late: u64,
    /// Waits of more than five periods and half a second.
    pub gaps: u64,
    /// The longest of them, s.
    pub longest_gap_s: f64,
    /// Names of the frames.
    pub frames: Vec<String>,
}

impl StreamReport {
    /// Adds the counts of an earlier report on the same stream.
    pub(crate) fn add(&mut self, before: &Self) {
        self.messages += before.messages;
        self.refused += before.refused;
        self.repeated += before.repeated;
        self.late += before.late;
        self.gaps += before.gaps;
        self.longest_gap_s = self.longest_gap_s.max(before.longest_gap_s);
        if let Some(reason) = &before.first_refusal {
            self.first_refusal = Some(reason.clone());
        }
    }
}

/// A stream as it comes.
#[derive(Debug, Clone)]
pub(crate) struct StreamWatch {
    stream: Stream,
    pub messages: u64,
    refused: u64,
    first_refusal: Option<String>,
    frames: Vec<(String, u64)>,
    first_arrival_ns: i64,
    pub last_arrival_ns: i64,
    pub stamps: StampWatch,
}

impl StreamWatch {
    pub fn new(stream: Stream, arrival_ns: i64) -> Self {
        Self {
            stream,
            messages: 0,
            refused: 0,
            first_refusal: None,
            frames: Vec::new(),
            first_arrival_ns: arrival_ns,
            last_arrival_ns: arrival_ns,
            stamps: StampWatch::default(),
        }
    }

    /// Adds a message that could be read.
    pub fn take(&mut self, stamp: RobotTime, frame: &str, arrival_ns: i64) {
        self.messages += 1;
        self.last_arrival_ns = arrival_ns;
        self.stamps.take(stamp, arrival_ns);
        let frame = cut(frame);
        let is_known = self.frames.iter().any(|(name, _)| name == frame);
        if !is_known && self.frames.len() == FRAMES_MAX {
            return;
        }
        match self.frames.iter_mut().find(|(name, _)| name == frame) {
            Some((_, count)) => *count += 1,
            None => self.frames.push((frame.to_owned(), 1)),
        }
    }

    /// Notes that a message was refused, be it read or not.
    pub fn refuse(&mut self, reason: &str) {
        self.refused += 1;
        self.first_refusal
            .get_or_insert_with(|| cut(reason).to_owned());
    }

    /// Returns the suspicions from this stream alone.
    pub fn suspicions(&self) -> Vec<Suspicion> {
        let name = self.stream.name();
        let mut found = self.stamps.suspicions(name);
        let all = self.messages.max(self.refused).max(1);
        if self.refused >= REFUSED_MIN && self.refused as f64 > REFUSED_MIN_SHARE * all as f64 {
            let share = 100.0 * self.refused as f64 / all as f64;
            let reason = self.first_refusal.as_deref().unwrap_or_default();
            let seen = format!("{share:.0} % of {name} are refused, the first: {reason}");
            found.push(Suspicion::new(Cause::Refused, seen));
        }
        let enough =
            |(_, count): &&(String, u64)| *count as f64 > FRAME_MIN_SHARE * self.messages as f64;
        let frames: Vec<&str> = self
            .frames
            .iter()
            .filter(enough)
            .map(|(name, _)| name.as_str())
            .collect();
        let is_lidar = matches!(self.stream, Stream::Scan | Stream::LidarOdometry);
        if is_lidar && frames.len() > 1 && self.messages >= 20 {
            let seen = format!(
                "{name} carries {} frames: {}",
                frames.len(),
                frames.join(", ")
            );
            found.push(Suspicion::new(Cause::SeveralFrames, seen));
        }
        found
    }

    /// Returns the report on it.
    pub fn report(&self) -> StreamReport {
        let span_s = away_s(self.first_arrival_ns, self.last_arrival_ns);
        let steps = self.messages.saturating_sub(1) as f64;
        let ms = |seconds: f64| 1e3 * seconds;
        StreamReport {
            stream: self.stream,
            messages: self.messages.max(self.refused),
            refused: self.refused,
            first_refusal: self.first_refusal.clone(),
            rate_hz: if span_s > 0.0 { steps / span_s } else { 0.0 },
            period_ms: self.stamps.period_s().map(ms),
            age_ms: self.stamps.age_s().map(ms),
            uneven_ms: self.stamps.unevenness_s().map(ms),
            repeated: u64::from(self.stamps.repeated),
            late: u64::from(self.stamps.late),
            gaps: u64::from(self.stamps.gaps),
            longest_gap_s: self.stamps.longest_gap_s,
            frames: self.frames.iter().map(|(name, _)| name.clone()).collect(),
        }
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        let frames: usize = self.frames.iter().map(|(name, _)| name.capacity()).sum();
        let reason = self.first_refusal.as_ref().map_or(0, String::capacity);
        frames + reason + self.stamps.memory_bytes()
    }
}

/// Time from one arrival to another, s.
pub(crate) fn away_s(from_ns: i64, to_ns: i64) -> f64 {
    to_ns.saturating_sub(from_ns) as f64 * 1e-9
}

/// The beginning of a text, as much of it as is kept.
fn cut(text: &str) -> &str {
    let end = text.floor_char_boundary(TEXT_BYTES_MAX);
    &text[..end]
}
