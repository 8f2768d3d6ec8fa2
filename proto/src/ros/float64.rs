//! `std_msgs/msg/Float64`: a steering angle or a speed alone, without a stamp.

use serde::{Deserialize, Serialize};

use super::RosMessage;
use super::wheels::{Joints, WheelMessage, Wheels};
use crate::cdr::{CdrError, CdrReader, CdrWriter};

/// A number without a stamp.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Float64 {
    /// The number.
    pub data: f64,
}

impl RosMessage for Float64 {
    const TYPE: &'static str = "std_msgs/msg/Float64";

    fn read(mut reader: CdrReader<'_>) -> Result<Self, CdrError> {
        let data = reader.f64("data")?;
        reader.finish("data")?;
        Ok(Self { data })
    }

    fn write(&self, writer: &mut CdrWriter) {
        writer.f64(self.data);
    }

    fn body_bytes(&self) -> usize {
        8
    }
}

/// As of a `Float32`.
impl WheelMessage for Float64 {
    fn wheels(self, _joints: Option<&Joints>) -> Wheels {
        Wheels::of_number(self.data)
    }
}
