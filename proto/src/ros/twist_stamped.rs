//! `geometry_msgs/msg/TwistStamped` and `TwistWithCovarianceStamped`: speed of robots that send it
//! as velocities.

use serde::{Deserialize, Serialize};

use super::odometry::TwistWithCovariance;
use super::wheels::{Joints, WheelMessage, Wheels};
use super::{Header, RosMessage, Twist, Vector3};
use crate::cdr::{CdrError, CdrReader, CdrWriter};

/// Velocities in the header's frame.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TwistStamped {
    /// Stamp, and the moving frame.
    pub header: Header,
    /// Its velocities.
    pub twist: Twist,
}

impl RosMessage for TwistStamped {
    const TYPE: &'static str = "geometry_msgs/msg/TwistStamped";

    fn read(mut reader: CdrReader<'_>) -> Result<Self, CdrError> {
        let header = Header::read(&mut reader)?;
        let vector = |[x, y, z]: [f64; 3]| Vector3 { x, y, z };
        let twist = Twist {
            linear: vector(reader.f64_array("twist.linear")?),
            angular: vector(reader.f64_array("twist.angular")?),
        };
        reader.finish("twist.angular")?;
        Ok(Self { header, twist })
    }

    fn write(&self, writer: &mut CdrWriter) {
        self.header.write(writer);
        for Vector3 { x, y, z } in [self.twist.linear, self.twist.angular] {
            writer.f64_array(&[x, y, z]);
        }
    }

    fn body_bytes(&self) -> usize {
        self.header.body_bytes() + 8 + 8 * 6
    }
}

/// Speed and yaw rate of the header's frame.
impl WheelMessage for TwistStamped {
    fn wheels(self, _joints: Option<&Joints>) -> Wheels {
        self.twist.wheels_at(self.header)
    }
}

/// Velocities in the header's frame, with their covariance, which is not used.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TwistWithCovarianceStamped {
    /// Stamp, and the moving frame.
    pub header: Header,
    /// Its velocities.
    pub twist: TwistWithCovariance,
}

impl RosMessage for TwistWithCovarianceStamped {
    const TYPE: &'static str = "geometry_msgs/msg/TwistWithCovarianceStamped";

    fn read(mut reader: CdrReader<'_>) -> Result<Self, CdrError> {
        let header = Header::read(&mut reader)?;
        let vector = |[x, y, z]: [f64; 3]| Vector3 { x, y, z };
        let twist = Twist {
            linear: vector(reader.f64_array("twist.twist.linear")?),
            angular: vector(reader.f64_array("twist.twist.angular")?),
        };
        let covariance = reader.f64_array("twist.covariance")?;
        reader.finish("twist.covariance")?;
        let twist = TwistWithCovariance { twist, covariance };
        Ok(Self { header, twist })
    }

    fn write(&self, writer: &mut CdrWriter) {
        self.header.write(writer);
        for Vector3 { x, y, z } in [self.twist.twist.linear, self.twist.twist.angular] {
            writer.f64_array(&[x, y, z]);
        }
        writer.f64_array(&self.twist.covariance);
    }

    fn body_bytes(&self) -> usize {
        self.header.body_bytes() + 8 + 8 * 42
    }
}

/// Speed and yaw rate of the header's frame.
impl WheelMessage for TwistWithCovarianceStamped {
    fn wheels(self, _joints: Option<&Joints>) -> Wheels {
        self.twist.twist.wheels_at(self.header)
    }
}
