//! `sensor_msgs/msg/JointState`: steering and wheels of robots that send them as joints.

use serde::{Deserialize, Serialize};

use super::wheels::{JointValue, Joints, WheelMessage, Wheels};
use super::{Header, RosMessage, serde_forms};
use crate::cdr::{CdrError, CdrReader, CdrWriter};

/// State of some joints. Each array has one entry for each joint, or is empty.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointState {
    /// Stamp of the measurement.
    pub header: Header,
    /// Names of the joints, at most [`crate::cdr::STRINGS_MAX`].
    #[serde(deserialize_with = "serde_forms::names")]
    pub name: Vec<String>,
    /// Positions, rad or m.
    #[serde(default)]
    pub position: Vec<f64>,
    /// Velocities, rad/s or m/s.
    #[serde(default)]
    pub velocity: Vec<f64>,
    /// Efforts, Nm or N.
    #[serde(default)]
    pub effort: Vec<f64>,
}

impl JointState {
    /// Returns the position of a joint, if the message has it.
    pub fn position_of(&self, joint: &str) -> Option<f64> {
        self.position.get(self.index_of(joint)?).copied()
    }

    /// Returns the velocity of a joint, if the message has it.
    pub fn velocity_of(&self, joint: &str) -> Option<f64> {
        self.velocity.get(self.index_of(joint)?).copied()
    }

    fn index_of(&self, joint: &str) -> Option<usize> {
        self.name.iter().position(|name| name == joint)
    }
}

impl RosMessage for JointState {
    const TYPE: &'static str = "sensor_msgs/msg/JointState";

    fn read(mut reader: CdrReader<'_>) -> Result<Self, CdrError> {
        let message = Self {
            header: Header::read(&mut reader)?,
            name: reader.string_sequence("name")?,
            position: reader.f64_sequence("position")?,
            velocity: reader.f64_sequence("velocity")?,
            effort: reader.f64_sequence("effort")?,
        };
        reader.finish("effort")?;
        Ok(message)
    }

    fn write(&self, writer: &mut CdrWriter) {
        self.header.write(writer);
        writer.string_sequence(&self.name);
        writer.f64_sequence(&self.position);
        writer.f64_sequence(&self.velocity);
        writer.f64_sequence(&self.effort);
    }

    fn body_bytes(&self) -> usize {
        let names: usize = self.name.iter().map(|name| name.len() + 8).sum();
        let numbers = self.position.len() + self.velocity.len() + self.effort.len();
        self.header.body_bytes() + 28 + names + 8 * numbers
    }
}

/// Positions and velocities of the joints by name, rad and rad/s.
impl WheelMessage for JointState {
    fn wheels(self, joints: Option<&Joints>) -> Wheels {
        let (steering, speed) = Joints::wheels_by_name(joints, |name, value| match value {
            JointValue::Position => self.position_of(name),
            JointValue::Velocity => self.velocity_of(name),
        });
        Wheels {
            header: Some(self.header),
            steering,
            speed,
            yaw_rate_radps: None,
        }
    }
}
