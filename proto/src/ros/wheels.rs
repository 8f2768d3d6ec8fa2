//! Steering and speed as messages state them: each message type says in its own file where they
//! are, in which unit and with which sign.

pub use super::joints::{JointValue, Joints, Units, Unstated};

use super::{Header, RosMessage};

/// Steering and speed that a message states.
#[derive(Debug, Clone, PartialEq)]
pub struct Wheels {
    /// Stamp and frame; `None` for a message without them, which counts as measured when it arrives.
    pub header: Option<Header>,
    /// Steering angle, rad, left positive.
    pub steering: Result<f64, Unstated>,
    /// Forward speed, m/s.
    pub speed: Result<f64, Unstated>,
    /// Yaw rate of the moving frame, rad/s, left positive.
    pub yaw_rate_radps: Option<f64>,
}

impl Wheels {
    /// Makes what a number without a stamp states: either.
    pub(super) fn of_number(value: f64) -> Self {
        Self {
            header: None,
            steering: Ok(value),
            speed: Ok(value),
            yaw_rate_radps: None,
        }
    }

    /// Makes what velocities state: the speed, and a turn instead of an angle.
    pub(super) fn of_speed_and_yaw_rate(
        header: Header,
        speed_mps: f64,
        yaw_rate_radps: f64,
    ) -> Self {
        Self {
            header: Some(header),
            steering: Err(Unstated::ByType),
            speed: Ok(speed_mps),
            yaw_rate_radps: Some(yaw_rate_radps),
        }
    }
}

/// Message that states steering, speed or both.
pub trait WheelMessage: RosMessage {
    /// Returns what it states; `joints` are those of the robot.
    fn wheels(self, joints: Option<&Joints>) -> Wheels;
}
