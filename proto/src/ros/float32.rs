//! `std_msgs/msg/Float32`: a steering angle or a speed alone, without a stamp.

use serde::{Deserialize, Serialize};

use super::RosMessage;
use super::wheels::{Joints, WheelMessage, Wheels};
use crate::cdr::{CdrError, CdrReader, CdrWriter};

/// A number without a stamp.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Float32 {
    /// The number.
    pub data: f32,
}

impl RosMessage for Float32 {
    const TYPE: &'static str = "std_msgs/msg/Float32";

    fn read(mut reader: CdrReader<'_>) -> Result<Self, CdrError> {
        let data = reader.f32("data")?;
        reader.finish("data")?;
        Ok(Self { data })
    }

    fn write(&self, writer: &mut CdrWriter) {
        writer.f32(self.data);
    }

    fn body_bytes(&self) -> usize {
        4
    }
}

/// An angle or a speed in the sender's unit: `steering_gear`, `steering_zero` and `speed_gear` of
/// the robot's streams say which.
impl WheelMessage for Float32 {
    fn wheels(self, _joints: Option<&Joints>) -> Wheels {
        Wheels::of_number(f64::from(self.data))
    }
}
