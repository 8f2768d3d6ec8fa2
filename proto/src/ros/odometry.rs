//! `nav_msgs/msg/Odometry`: a pose from a LiDAR odometry that runs on the robot.

use serde::{Deserialize, Serialize};

use super::wheels::{Joints, WheelMessage, Wheels};
use super::{Header, RosMessage, serde_forms};
use crate::cdr::{CdrError, CdrReader, CdrWriter};

/// Covariance of (x, y, z, roll, pitch, yaw), row by row; all zeros if the sender has none.
pub type Covariance = [f64; 36];

const NO_COVARIANCE: Covariance = [0.0; 36];

/// Three numbers along x, y and z.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vector3 {
    /// Along x.
    pub x: f64,
    /// Along y.
    pub y: f64,
    /// Along z.
    #[serde(default)]
    pub z: f64,
}

/// A rotation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Quaternion {
    /// Vector part along x.
    #[serde(default)]
    pub x: f64,
    /// Vector part along y.
    #[serde(default)]
    pub y: f64,
    /// Vector part along z.
    pub z: f64,
    /// Scalar part.
    pub w: f64,
}

impl Default for Quaternion {
    fn default() -> Self {
        Self {
            x: 0.0,
            y: 0.0,
            z: 0.0,
            w: 1.0,
        }
    }
}

impl Quaternion {
    /// Makes a turn by `yaw_rad` about z.
    pub fn from_yaw(yaw_rad: f64) -> Self {
        let (z, w) = (0.5 * yaw_rad).sin_cos();
        Self {
            x: 0.0,
            y: 0.0,
            z,
            w,
        }
    }

    /// Returns the turn about z, rad in `[-pi, pi]`. The quaternion need not be of length one; one
    /// of zeros gives 0, and not-a-number stays so.
    pub fn yaw_rad(&self) -> f64 {
        let sine = 2.0 * (self.w * self.z + self.x * self.y);
        let cosine = self.w * self.w + self.x * self.x - self.y * self.y - self.z * self.z;
        sine.atan2(cosine)
    }
}

/// Position, m, and orientation.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pose {
    /// Position, m.
    pub position: Vector3,
    /// Orientation.
    pub orientation: Quaternion,
}

/// A pose and its covariance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseWithCovariance {
    /// The pose.
    pub pose: Pose,
    /// Its covariance, m and rad.
    #[serde(
        default = "no_covariance",
        serialize_with = "serde_forms::long_array",
        deserialize_with = "serde_forms::long_array_of"
    )]
    pub covariance: Covariance,
}

/// Velocities.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Twist {
    /// Linear velocity, m/s.
    pub linear: Vector3,
    /// Angular velocity, rad/s.
    pub angular: Vector3,
}

/// Velocities and their covariance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TwistWithCovariance {
    /// The velocities, in the child frame.
    pub twist: Twist,
    /// Their covariance.
    #[serde(
        default = "no_covariance",
        serialize_with = "serde_forms::long_array",
        deserialize_with = "serde_forms::long_array_of"
    )]
    pub covariance: Covariance,
}

/// A pose of `child_frame_id` in `header.frame_id`, and its velocities.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Odometry {
    /// Stamp, and the frame of the pose.
    pub header: Header,
    /// The moving frame.
    #[serde(default)]
    pub child_frame_id: String,
    /// Its pose.
    pub pose: PoseWithCovariance,
    /// Its velocities.
    #[serde(default)]
    pub twist: TwistWithCovariance,
}

fn no_covariance() -> Covariance {
    NO_COVARIANCE
}

impl Default for PoseWithCovariance {
    fn default() -> Self {
        Self {
            pose: Pose::default(),
            covariance: NO_COVARIANCE,
        }
    }
}

impl Default for TwistWithCovariance {
    fn default() -> Self {
        Self {
            twist: Twist::default(),
            covariance: NO_COVARIANCE,
        }
    }
}

fn vector(values: [f64; 3]) -> Vector3 {
    let [x, y, z] = values;
    Vector3 { x, y, z }
}

impl Pose {
    pub(super) fn read(
        reader: &mut CdrReader<'_>,
        [position, orientation]: [&'static str; 2],
    ) -> Result<Self, CdrError> {
        let position = vector(reader.f64_array(position)?);
        let [x, y, z, w] = reader.f64_array(orientation)?;
        Ok(Self {
            position,
            orientation: Quaternion { x, y, z, w },
        })
    }

    pub(super) fn write(&self, writer: &mut CdrWriter) {
        let Self {
            position,
            orientation,
        } = self;
        writer.f64_array(&[position.x, position.y, position.z]);
        writer.f64_array(&[orientation.x, orientation.y, orientation.z, orientation.w]);
    }
}

impl RosMessage for Odometry {
    const TYPE: &'static str = "nav_msgs/msg/Odometry";

    fn read(mut reader: CdrReader<'_>) -> Result<Self, CdrError> {
        let header = Header::read(&mut reader)?;
        let child_frame_id = reader.string("child_frame_id")?;
        let position = vector(reader.f64_array("pose.pose.position")?);
        let [x, y, z, w] = reader.f64_array("pose.pose.orientation")?;
        let pose = Pose {
            position,
            orientation: Quaternion { x, y, z, w },
        };
        let pose = PoseWithCovariance {
            pose,
            covariance: reader.f64_array("pose.covariance")?,
        };
        let linear = vector(reader.f64_array("twist.twist.linear")?);
        let angular = vector(reader.f64_array("twist.twist.angular")?);
        let twist = Twist { linear, angular };
        let twist = TwistWithCovariance {
            twist,
            covariance: reader.f64_array("twist.covariance")?,
        };
        reader.finish("twist.covariance")?;
        Ok(Self {
            header,
            child_frame_id,
            pose,
            twist,
        })
    }

    fn write(&self, writer: &mut CdrWriter) {
        self.header.write(writer);
        writer.string(&self.child_frame_id);
        let Pose {
            position,
            orientation,
        } = self.pose.pose;
        writer.f64_array(&[position.x, position.y, position.z]);
        writer.f64_array(&[orientation.x, orientation.y, orientation.z, orientation.w]);
        writer.f64_array(&self.pose.covariance);
        let Twist { linear, angular } = self.twist.twist;
        writer.f64_array(&[linear.x, linear.y, linear.z]);
        writer.f64_array(&[angular.x, angular.y, angular.z]);
        writer.f64_array(&self.twist.covariance);
    }

    fn body_bytes(&self) -> usize {
        self.header.body_bytes() + self.child_frame_id.len() + 16 + 8 * (7 + 36 + 6 + 36)
    }
}

impl Twist {
    /// The forward speed, m/s, and the yaw rate, rad/s, left positive, of the moving frame.
    pub(super) fn wheels_at(&self, header: Header) -> Wheels {
        Wheels::of_speed_and_yaw_rate(header, self.linear.x, self.angular.z)
    }
}

/// Speed and yaw rate of the child frame.
impl WheelMessage for Odometry {
    fn wheels(self, _joints: Option<&Joints>) -> Wheels {
        self.twist.twist.wheels_at(self.header)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_yaw_survives_the_quaternion() {
        for yaw_rad in [-3.1, -1.0, 0.0, 0.5, 3.1] {
            assert!((Quaternion::from_yaw(yaw_rad).yaw_rad() - yaw_rad).abs() < 1e-12);
        }
        let doubled = Quaternion {
            x: 0.0,
            y: 0.0,
            z: 1.0,
            w: 1.0,
        };
        assert!((doubled.yaw_rad() - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    }
}
