//! Messages that are heard before a robot's task begins, while another instance still has the robot.
//!
//! The task before has taken some of them. The task that begins knows which, by the state that it
//! begins with.

use fleetcal_domain::limits::{HEARD_NOTES_MAX, HEARD_SCANS_MAX, HEARD_WHEEL_ODOMETRY_MAX};
use fleetcal_model::Stream;

use super::message::Message;

/// Early messages, received before the task began, by class.
#[derive(Debug, Default)]
pub(super) struct Heard {
    pub(super) waiting: [usize; Class::COUNT],
    pub(super) bytes: usize,
    /// Early messages that were pushed out. They count as dropped once the former task is known not
    /// to have processed them.
    pub(super) pushed_out: [u64; Class::COUNT],
}

/// Class of messages that are dropped together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Class {
    WheelOdometry,
    Scan,
    Note,
}

impl Class {
    const COUNT: usize = 3;

    pub(super) const fn of(stream: Stream) -> Self {
        match stream {
            Stream::WheelOdometry | Stream::Steering | Stream::Speed => Self::WheelOdometry,
            Stream::Scan | Stream::LidarOdometry => Self::Scan,
            Stream::Event => Self::Note,
        }
    }

    pub(super) const fn heard_max(self) -> usize {
        match self {
            Self::WheelOdometry => HEARD_WHEEL_ODOMETRY_MAX,
            Self::Scan => HEARD_SCANS_MAX,
            Self::Note => HEARD_NOTES_MAX,
        }
    }
}

impl Heard {
    /// Returns the number of early messages that wait.
    pub(super) fn len(&self) -> usize {
        self.waiting.iter().sum()
    }

    /// Records that a message no longer waits.
    pub(super) fn left(&mut self, message: &Message) {
        if let Some(waiting) = self.waiting.get_mut(Class::of(message.stream) as usize) {
            *waiting = waiting.saturating_sub(1);
        }
        self.bytes = self.bytes.saturating_sub(message.payload.len());
    }
}
