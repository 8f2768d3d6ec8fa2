//! `autoware_vehicle_msgs/msg/SteeringReport` and `VelocityReport`: measurements of a vehicle under
//! Autoware.

use serde::{Deserialize, Serialize};

use super::wheels::{Joints, Unstated, WheelMessage, Wheels};
use super::{Header, RosMessage, Time};
use crate::cdr::{CdrError, CdrReader, CdrWriter};

/// Steering angle.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SteeringReport {
    /// Stamp of the measurement.
    pub stamp: Time,
    /// Angle of the (virtual) centre wheel, rad, left positive.
    pub steering_tire_angle: f32,
}

impl RosMessage for SteeringReport {
    const TYPE: &'static str = "autoware_vehicle_msgs/msg/SteeringReport";

    fn read(mut reader: CdrReader<'_>) -> Result<Self, CdrError> {
        let stamp = Time::read(&mut reader, "stamp.sec", "stamp.nanosec")?;
        let steering_tire_angle = reader.f32("steering_tire_angle")?;
        reader.finish("steering_tire_angle")?;
        Ok(Self {
            stamp,
            steering_tire_angle,
        })
    }

    fn write(&self, writer: &mut CdrWriter) {
        writer.i32(self.stamp.sec);
        writer.u32(self.stamp.nanosec);
        writer.f32(self.steering_tire_angle);
    }

    fn body_bytes(&self) -> usize {
        12
    }
}

/// The angle, rad, left positive.
impl WheelMessage for SteeringReport {
    fn wheels(self, _joints: Option<&Joints>) -> Wheels {
        Wheels {
            header: Some(Header {
                stamp: self.stamp,
                frame_id: String::new(),
            }),
            steering: Ok(f64::from(self.steering_tire_angle)),
            speed: Err(Unstated::ByType),
            yaw_rate_radps: None,
        }
    }
}

/// Velocities of `base_link`, which Autoware has on the rear axle.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VelocityReport {
    /// Stamp of the measurement, and the moving frame.
    pub header: Header,
    /// Forward speed, m/s.
    pub longitudinal_velocity: f32,
    /// Speed to the left, m/s.
    pub lateral_velocity: f32,
    /// Yaw rate, rad/s, left positive.
    pub heading_rate: f32,
}

impl RosMessage for VelocityReport {
    const TYPE: &'static str = "autoware_vehicle_msgs/msg/VelocityReport";

    fn read(mut reader: CdrReader<'_>) -> Result<Self, CdrError> {
        let message = Self {
            header: Header::read(&mut reader)?,
            longitudinal_velocity: reader.f32("longitudinal_velocity")?,
            lateral_velocity: reader.f32("lateral_velocity")?,
            heading_rate: reader.f32("heading_rate")?,
        };
        reader.finish("heading_rate")?;
        Ok(message)
    }

    fn write(&self, writer: &mut CdrWriter) {
        self.header.write(writer);
        writer.f32(self.longitudinal_velocity);
        writer.f32(self.lateral_velocity);
        writer.f32(self.heading_rate);
    }

    fn body_bytes(&self) -> usize {
        self.header.body_bytes() + 12
    }
}

/// The forward speed, m/s, and the yaw rate, rad/s.
impl WheelMessage for VelocityReport {
    fn wheels(self, _joints: Option<&Joints>) -> Wheels {
        let (speed_mps, yaw_rate_radps) = (self.longitudinal_velocity, self.heading_rate);
        Wheels::of_speed_and_yaw_rate(self.header, speed_mps.into(), yaw_rate_radps.into())
    }
}
