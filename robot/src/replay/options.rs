//! Options of a replay.

use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

use fleetcal_proto::{Keys, RobotId};
use thiserror::Error;

use crate::connection::Connection;
use crate::recording::AskedTopics;

/// Speed of a replay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rate {
    /// Multiple of the recorded speed.
    Times(f64),
    /// Speed at which the service processes.
    Max,
}

/// Reason for which a text is not a rate.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("rate: got {text:?}, expected a number from 0.001 to 1000000, or max")]
pub struct RateRefused {
    /// The text.
    pub text: String,
}

impl Rate {
    /// Returns the delay after the first message for one that was logged this much later; `None`
    /// without a wait.
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

/// Pacing of a sender.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Pacing {
    /// The sender never runs further ahead than the robot's mailbox holds.
    #[default]
    ByProgress,
    /// The sender never waits, and the service drops the excess.
    Unpaced,
}

/// Options of a replay.
#[derive(Debug, Clone)]
pub struct ReplayOptions {
    /// The MCAP file.
    pub recording: PathBuf,
    /// Connection to the service.
    pub connect: Connection,
    /// Id of the robot; the first chunk of the wheel odometry topic if `None`.
    pub robot: Option<RobotId>,
    /// Speed of the replay.
    pub rate: Rate,
    /// Pacing of the replay.
    pub pacing: Pacing,
    /// Topics to send, if more than one is suitable.
    pub topics: AskedTopics,
    /// Keys to send under.
    pub keys: Keys,
    /// Wait for the connection, and for subscribers.
    pub connect_timeout: Duration,
    /// Time without progress of the service after which the replay is abandoned.
    pub stall_timeout: Duration,
}

impl ReplayOptions {
    /// Makes a paced replay at the recorded speed, under the default keys.
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
