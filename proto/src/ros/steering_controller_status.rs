//! `control_msgs/msg/SteeringControllerStatus`: state of a steering controller of `ros2_control`.

use serde::{Deserialize, Serialize};

use super::wheels::{Joints, Unstated, WheelMessage, Wheels};
use super::{Header, RosMessage};
use crate::cdr::{CdrError, CdrReader, CdrWriter};

/// Wheels of a steering controller, without names: one or two of each kind.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SteeringControllerStatus {
    /// Stamp of the measurement.
    pub header: Header,
    /// Positions of the driven wheels, rad, where they are driven by position.
    #[serde(default)]
    pub traction_wheels_position: Vec<f64>,
    /// Velocities of the driven wheels, rad/s.
    #[serde(default)]
    pub traction_wheels_velocity: Vec<f64>,
    /// Positions of the steered joints, rad.
    #[serde(default)]
    pub steer_positions: Vec<f64>,
    /// Commanded velocities, rad/s.
    #[serde(default)]
    pub linear_velocity_command: Vec<f64>,
    /// Commanded angles, rad.
    #[serde(default)]
    pub steering_angle_command: Vec<f64>,
}

impl RosMessage for SteeringControllerStatus {
    const TYPE: &'static str = "control_msgs/msg/SteeringControllerStatus";

    fn read(mut reader: CdrReader<'_>) -> Result<Self, CdrError> {
        let message = Self {
            header: Header::read(&mut reader)?,
            traction_wheels_position: reader.f64_sequence("traction_wheels_position")?,
            traction_wheels_velocity: reader.f64_sequence("traction_wheels_velocity")?,
            steer_positions: reader.f64_sequence("steer_positions")?,
            linear_velocity_command: reader.f64_sequence("linear_velocity_command")?,
            steering_angle_command: reader.f64_sequence("steering_angle_command")?,
        };
        reader.finish("steering_angle_command")?;
        Ok(message)
    }

    fn write(&self, writer: &mut CdrWriter) {
        self.header.write(writer);
        for values in [
            &self.traction_wheels_position,
            &self.traction_wheels_velocity,
            &self.steer_positions,
            &self.linear_velocity_command,
            &self.steering_angle_command,
        ] {
            writer.f64_sequence(values);
        }
    }

    fn body_bytes(&self) -> usize {
        let numbers = self.traction_wheels_position.len()
            + self.traction_wheels_velocity.len()
            + self.steer_positions.len()
            + self.linear_velocity_command.len()
            + self.steering_angle_command.len();
        self.header.body_bytes() + 40 + 8 * numbers
    }
}

/// The measured positions of one or two steered joints, rad, and the mean velocity of the driven
/// wheels; the commands are not used.
impl WheelMessage for SteeringControllerStatus {
    fn wheels(self, joints: Option<&Joints>) -> Wheels {
        let steering = match *self.steer_positions.as_slice() {
            [angle] => Ok(Joints::angle_rad(joints, &[angle])),
            [right, left] => Ok(Joints::angle_rad(joints, &[left, right])),
            _ => Err(Unstated::Field("steer_positions")),
        };
        let speed = match self.traction_wheels_velocity.as_slice() {
            [] => Err(Unstated::Field("traction_wheels_velocity")),
            velocities => Joints::speed_mps(joints, velocities),
        };
        Wheels {
            header: Some(self.header),
            steering,
            speed,
            yaw_rate_radps: None,
        }
    }
}
