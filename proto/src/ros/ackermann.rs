//! `ackermann_msgs/msg/AckermannDriveStamped` and `AckermannDrive`: a robot's measured speed and
//! steering.

use serde::{Deserialize, Serialize};

use super::wheels::{Joints, WheelMessage, Wheels};
use super::{Header, RosMessage};
use crate::cdr::{CdrError, CdrReader, CdrWriter};

/// Speed and steering of a car-like vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AckermannDrive {
    /// Angle of the (virtual) centre wheel, rad, left positive.
    pub steering_angle: f32,
    /// Its rate of change, rad/s.
    #[serde(default)]
    pub steering_angle_velocity: f32,
    /// Forward speed, m/s, negative in reverse.
    pub speed: f32,
    /// Forward acceleration, m/s^2.
    #[serde(default)]
    pub acceleration: f32,
    /// Forward jerk, m/s^3.
    #[serde(default)]
    pub jerk: f32,
}

/// A drive sample: it describes the interval that ends at its stamp.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AckermannDriveStamped {
    /// Stamp at the end of the interval.
    pub header: Header,
    /// Measured values.
    pub drive: AckermannDrive,
}

impl AckermannDrive {
    fn read_fields(reader: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        Ok(Self {
            steering_angle: reader.f32("drive.steering_angle")?,
            steering_angle_velocity: reader.f32("drive.steering_angle_velocity")?,
            speed: reader.f32("drive.speed")?,
            acceleration: reader.f32("drive.acceleration")?,
            jerk: reader.f32("drive.jerk")?,
        })
    }

    fn wheels_at(self, header: Option<Header>) -> Wheels {
        Wheels {
            header,
            steering: Ok(f64::from(self.steering_angle)),
            speed: Ok(f64::from(self.speed)),
            yaw_rate_radps: None,
        }
    }
}

impl RosMessage for AckermannDrive {
    const TYPE: &'static str = "ackermann_msgs/msg/AckermannDrive";

    fn read(mut reader: CdrReader<'_>) -> Result<Self, CdrError> {
        let drive = Self::read_fields(&mut reader)?;
        reader.finish("drive.jerk")?;
        Ok(drive)
    }

    fn write(&self, writer: &mut CdrWriter) {
        writer.f32(self.steering_angle);
        writer.f32(self.steering_angle_velocity);
        writer.f32(self.speed);
        writer.f32(self.acceleration);
        writer.f32(self.jerk);
    }

    fn body_bytes(&self) -> usize {
        20
    }
}

/// The angle of the (virtual) centre wheel, rad, left positive, and the forward speed, m/s; of the
/// time of arrival.
impl WheelMessage for AckermannDrive {
    fn wheels(self, _joints: Option<&Joints>) -> Wheels {
        self.wheels_at(None)
    }
}

/// The angle of the (virtual) centre wheel, rad, left positive, and the forward speed, m/s.
impl WheelMessage for AckermannDriveStamped {
    fn wheels(self, _joints: Option<&Joints>) -> Wheels {
        self.drive.wheels_at(Some(self.header))
    }
}

impl RosMessage for AckermannDriveStamped {
    const TYPE: &'static str = "ackermann_msgs/msg/AckermannDriveStamped";

    fn read(mut reader: CdrReader<'_>) -> Result<Self, CdrError> {
        let header = Header::read(&mut reader)?;
        let drive = AckermannDrive::read_fields(&mut reader)?;
        reader.finish("drive.jerk")?;
        Ok(Self { header, drive })
    }

    fn write(&self, writer: &mut CdrWriter) {
        self.header.write(writer);
        self.drive.write(writer);
    }

    fn body_bytes(&self) -> usize {
        self.header.body_bytes() + 20
    }
}
