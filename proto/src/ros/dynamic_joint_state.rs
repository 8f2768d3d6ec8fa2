//! `control_msgs/msg/DynamicJointState`: all interfaces of the joints under `ros2_control`.

use serde::{Deserialize, Serialize};

use super::wheels::{Joints, WheelMessage, Wheels};
use super::{Header, RosMessage, serde_forms};
use crate::cdr::{CdrError, CdrReader, CdrWriter, STRINGS_MAX};

/// Interfaces of one joint and their values.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InterfaceValue {
    /// Names: `position`, `velocity`, `effort` and others.
    #[serde(deserialize_with = "serde_forms::names")]
    pub interface_names: Vec<String>,
    /// A value for each of them, rad, rad/s and so on.
    pub values: Vec<f64>,
}

/// Joints and their interfaces.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DynamicJointState {
    /// Stamp of the measurement.
    pub header: Header,
    /// Names of the joints, at most [`STRINGS_MAX`].
    #[serde(deserialize_with = "serde_forms::names")]
    pub joint_names: Vec<String>,
    /// Interfaces of each joint, in the same order.
    #[serde(deserialize_with = "serde_forms::at_most::<_, STRINGS_MAX, _>")]
    pub interface_values: Vec<InterfaceValue>,
}

impl DynamicJointState {
    /// Returns a value of a joint, if the message has it.
    pub fn value_of(&self, joint: &str, interface: &str) -> Option<f64> {
        let at = self.joint_names.iter().position(|name| name == joint)?;
        let of = self.interface_values.get(at)?;
        let at = of.interface_names.iter().position(|it| it == interface)?;
        of.values.get(at).copied()
    }
}

impl RosMessage for DynamicJointState {
    const TYPE: &'static str = "control_msgs/msg/DynamicJointState";

    fn read(mut reader: CdrReader<'_>) -> Result<Self, CdrError> {
        let message = Self {
            header: Header::read(&mut reader)?,
            joint_names: reader.string_sequence("joint_names")?,
            interface_values: reader.sequence("interface_values", 8, STRINGS_MAX, |reader| {
                Ok(InterfaceValue {
                    interface_names: reader.string_sequence("interface_values.interface_names")?,
                    values: reader.f64_sequence("interface_values.values")?,
                })
            })?,
        };
        reader.finish("interface_values")?;
        Ok(message)
    }

    fn write(&self, writer: &mut CdrWriter) {
        self.header.write(writer);
        writer.string_sequence(&self.joint_names);
        writer.sequence_length(self.interface_values.len());
        for of in &self.interface_values {
            writer.string_sequence(&of.interface_names);
            writer.f64_sequence(&of.values);
        }
    }

    fn body_bytes(&self) -> usize {
        let names = |names: &[String]| names.iter().map(|name| name.len() + 8).sum::<usize>();
        let of = |of: &InterfaceValue| names(&of.interface_names) + 8 * of.values.len() + 16;
        let values: usize = self.interface_values.iter().map(of).sum();
        self.header.body_bytes() + names(&self.joint_names) + values + 16
    }
}

/// Interfaces `position` and `velocity` of the joints by name, rad and rad/s.
impl WheelMessage for DynamicJointState {
    fn wheels(self, joints: Option<&Joints>) -> Wheels {
        let (steering, speed) =
            Joints::wheels_by_name(joints, |name, value| self.value_of(name, value.name()));
        Wheels {
            header: Some(self.header),
            steering,
            speed,
            yaw_rate_radps: None,
        }
    }
}
