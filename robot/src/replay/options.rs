//! Options of a replay.

use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

use fleetcal_proto::{Keys, RobotId};
use thiserror::Error;

use crate::connection::Connection;
use crate::recording::AskedTopics;

/// How fast a recording is sent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rate {
    /// So many times as fast as it was recorded.
    Times(f64),
    /// As fast as the service works.
    Max,
}

/// Why a text is no rate.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("rate: got {text:?}, expected a number from 0.001 to 1000000, or max")]
pub struct RateRefused {
    /// The text.
    pub text: String,
}

impl Rate {
    /// How long after the first message one follows that was logged so much later; `None` when it
    /// need not wait.
    pub(super) fn after(self, logged_later: Duration) -> Option<Duration> {
        match self {
            Self::Max => None,
            Self::Times(rate) => Some(
                Duration::try_from_secs_f64(logged_later.as_secs_f64() / rate).unwrap_or_default(),
            ),
        }
    }
}

impl FromStr for Rate {
    type Err = RateRefused;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if text == "max" {
            return Ok(Self::Max);
        }
        match text.parse() {
            Ok(rate) if (0.001..=1e6).contains(&rate) => Ok(Self::Times(rate)),
            _ => Err(RateRefused {
                text: text.to_owned(),
            }),
        }
    }
}

/// Whether a sender waits for the service.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Pacing {
    /// It never runs further ahead than the robot's mailbox holds.
    #[default]
    ByProgress,
    /// It sends on, and the service drops what it can't hold.
    Unpaced,
}

/// What to send where.
#[derive(Debug, Clone)]
pub struct ReplayOptions {
    /// The MCAP file.
    pub recording: PathBuf,
    /// Where the service is.
    pub connect: Connection,
    /// As which robot; the first chunk of the wheel odometry topic when `None`.
    pub robot: Option<RobotId>,
    /// How fast.
    pub rate: Rate,
    /// Whether to wait for the service.
    pub pacing: Pacing,
    /// The topics to send, where more than one would do.
    pub topics: AskedTopics,
    /// The keys to send under.
    pub keys: Keys,
    /// How long to wait for the connection, and for somebody who listens.
    pub connect_timeout: Duration,
    /// How long the service may work through nothing before the replay is given up.
    pub stall_timeout: Duration,
}

impl ReplayOptions {
    /// A paced replay at the speed it was recorded, under the default keys.
    pub fn new(recording: PathBuf, connect: impl Into<Connection>) -> Self {
        Self {
            recording,
            connect: connect.into(),
            robot: None,
            rate: Rate::Times(1.0),
            pacing: Pacing::ByProgress,
            topics: AskedTopics::default(),
            keys: Keys::default(),
            connect_timeout: Duration::from_secs(10),
            stall_timeout: Duration::from_secs(30),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_numbers_or_max() {
        assert_eq!("max".parse(), Ok(Rate::Max));
        assert_eq!("50".parse(), Ok(Rate::Times(50.0)));
        for text in ["", "0", "-1", "NaN", "inf", "fast", "1e9"] {
            let sentence = text.parse::<Rate>().unwrap_err().to_string();
            assert!(sentence.contains(&format!("{text:?}")), "{sentence}");
        }
        let after = Rate::Times(50.0).after(Duration::from_secs(100));
        assert_eq!(after, Some(Duration::from_secs(2)));
    }
}
