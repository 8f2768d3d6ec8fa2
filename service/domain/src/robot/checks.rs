//! Report of a robot's joining checks: its streams as they come, and the result of each check.

use serde::{Deserialize, Serialize};

/// Share of a stream's messages that may be left out for one reason without a warning.
const LEFT_OUT_MAX_SHARE: f64 = 0.05;
/// Messages left out for one reason from which it is warned of.
const LEFT_OUT_MIN: u64 = 50;

/// Report of the joining checks of one robot.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ChecksReport {
    /// Way of the LiDAR while its motion was looked at, m.
    pub way_m: f64,
    /// True while the motion is not looked at, because nothing was found.
    pub resting: bool,
    /// Streams as they come.
    pub streams: Vec<CheckedStream>,
    /// Every cause that is named, and an entry for each check that names none.
    pub findings: Vec<CheckFinding>,
}

/// A stream as it comes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CheckedStream {
    /// Name of the stream: `wheel_odometry`, `steering`, `speed`, `scan` or `lidar_odometry`.
    pub stream: String,
    /// Its topic.
    pub topic: String,
    /// Messages that came.
    pub messages: u64,
    /// Messages that were refused.
    pub refused: u64,
    /// Reason of the first refusal.
    pub first_refusal: Option<String>,
    /// Messages that were not used, by reason.
    pub left_out: Vec<LeftOut>,
    /// Messages a second.
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

/// Messages of a stream that were not used, for one reason.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct LeftOut {
    /// Reason: `refused`, `late`, `duplicate`, `unusable`, `unpaired` or `mailbox_full`.
    pub reason: String,
    /// Number of these messages.
    pub messages: u64,
    /// Share of the stream's messages, 0 to 1.
    pub share: f64,
}

/// Result of a check.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CheckFinding {
    /// Name of the check: `steering` and so on.
    pub check: String,
    /// State of the check.
    pub state: CheckState,
    /// Name of the cause, where one is named: `steering_degrees` and so on.
    pub cause: Option<String>,
    /// Evidence, or the missing motion.
    pub seen: String,
    /// Remedy, where a cause is named.
    pub advice: Option<String>,
    /// Way of the LiDAR until the cause was named, m.
    pub after_m: Option<f64>,
    /// Time until the cause was named, s.
    pub after_s: Option<f64>,
    /// True if what is estimated from the messages cannot be right.
    pub spoils_values: bool,
}

/// State of a joining check.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum CheckState {
    /// The evidence goes together.
    Ok,
    /// A cause is named.
    Wrong,
    /// The evidence has more than one explanation.
    Unsure,
    /// Too little was seen so far.
    NotYet,
}

impl CheckState {
    /// Every state.
    pub const ALL: [Self; 4] = [Self::Ok, Self::Wrong, Self::Unsure, Self::NotYet];

    /// The name in documents and in `/metrics`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Wrong => "wrong",
            Self::Unsure => "unsure",
            Self::NotYet => "not_yet",
        }
    }
}

impl CheckFinding {
    /// Evidence and remedy as one text.
    pub fn in_words(&self) -> String {
        let advice = self.advice.as_deref().unwrap_or_default();
        format!("{}: {}. {advice}", self.check, self.seen)
            .trim_end()
            .to_owned()
    }
}

impl ChecksReport {
    /// Findings that name a cause, those that are certain first.
    pub fn named(&self) -> impl Iterator<Item = &CheckFinding> {
        let of = |state| self.findings.iter().filter(move |one| one.state == state);
        of(CheckState::Wrong).chain(of(CheckState::Unsure))
    }

    /// Report of the named causes alone.
    #[must_use]
    pub fn of_causes(&self) -> Self {
        Self {
            findings: self.named().cloned().collect(),
            ..Self::default()
        }
    }

    /// First finding that is certain.
    pub fn wrong(&self) -> Option<&CheckFinding> {
        self.findings
            .iter()
            .find(|one| one.state == CheckState::Wrong)
    }

    /// First finding for which no value that is estimated can be right.
    pub fn spoiling(&self) -> Option<&CheckFinding> {
        self.findings.iter().find(|one| one.spoils_values)
    }

    /// Streams of which many messages are left out, each with the reason. Refusals are a check of
    /// their own.
    pub fn much_left_out(&self) -> impl Iterator<Item = (&str, &LeftOut)> {
        self.streams.iter().flat_map(|stream| {
            let is_much = |one: &&LeftOut| {
                one.reason != "refused"
                    && one.messages >= LEFT_OUT_MIN
                    && one.share > LEFT_OUT_MAX_SHARE
            };
            let much = stream.left_out.iter().filter(is_much);
            much.map(|one| (stream.stream.as_str(), one))
        })
    }
}
