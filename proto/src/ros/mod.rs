//! The ROS 2 messages that robots send and that recordings have, in CDR and in JSON with the same field names.
//!
//! Fields, units and meaning are those of the public message definitions; what a field may hold
//! physically is checked where it is used, not here.

mod ackermann;
mod drive_samples;
mod dynamic_joint_state;
mod estimate;
mod float32;
mod float64;
mod header;
mod joint_state;
mod joints;
mod laser_scan;
mod log;
mod multi_echo_laser_scan;
mod odometry;
mod point_cloud2;
mod pose_stamped;
mod serde_forms;
mod steering_controller_status;
mod string;
mod tf_message;
mod twist_stamped;
mod vehicle_report;
mod vesc_state;
mod wheels;

pub use ackermann::{AckermannDrive, AckermannDriveStamped};
pub use drive_samples::{
    DRIVE_SAMPLES_MAX, DRIVE_SAMPLES_SPAN_MAX_NS, DriveSamples, MeasuredDrive, SamplesRefused,
};
pub use dynamic_joint_state::{DynamicJointState, InterfaceValue};
pub use estimate::{Estimate, ParameterEstimate};
pub use float32::Float32;
pub use float64::Float64;
pub use header::{Header, Time};
pub use joint_state::JointState;
pub use laser_scan::{LaserScan, ScanRefused};
pub use log::Log;
pub use multi_echo_laser_scan::{LaserEcho, MultiEchoLaserScan};
pub use odometry::{
    Covariance, Odometry, Pose, PoseWithCovariance, Quaternion, Twist, TwistWithCovariance, Vector3,
};
pub use point_cloud2::{CloudRefused, Column, PointCloud2, PointDatatype, PointField};
pub use pose_stamped::PoseStamped;
pub use steering_controller_status::SteeringControllerStatus;
pub use string::StringMessage;
pub use tf_message::{TRANSFORMS_MAX, TfMessage, Transform, TransformStamped};
pub use twist_stamped::{TwistStamped, TwistWithCovarianceStamped};
pub use vehicle_report::{SteeringReport, VelocityReport};
pub use vesc_state::{VescState, VescStateStamped};
pub use wheels::{JointValue, Joints, Units, Unstated, WheelMessage, Wheels};

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::cdr::{CdrError, CdrReader, CdrWriter};
use crate::encoding::{DecodeError, Encoding};

/// A ROS 2 message that travels in CDR or JSON.
pub trait RosMessage: Sized + Serialize + DeserializeOwned {
    /// Its type, `sensor_msgs/msg/LaserScan`.
    const TYPE: &'static str;

    /// Reads its fields and checks that nothing follows them.
    ///
    /// # Errors
    /// Names the field that is missing or has an impossible value.
    fn read(reader: CdrReader<'_>) -> Result<Self, CdrError>;

    /// Writes its fields.
    fn write(&self, writer: &mut CdrWriter);

    /// Returns the approximate number of bytes that [`Self::write`] is going to write.
    fn body_bytes(&self) -> usize;

    /// Reads a payload in CDR of either byte order.
    ///
    /// # Errors
    /// Names the field that is missing or has an impossible value.
    fn from_cdr(payload: &[u8]) -> Result<Self, DecodeError> {
        let refused = |reason| DecodeError::Cdr {
            message: Self::TYPE,
            reason,
        };
        CdrReader::new(payload)
            .and_then(Self::read)
            .map_err(refused)
    }

    /// Writes the message in little-endian CDR, with its four bytes of header.
    fn to_cdr(&self) -> Vec<u8> {
        let mut writer = CdrWriter::with_capacity(self.body_bytes());
        self.write(&mut writer);
        writer.into_bytes()
    }

    /// Reads a payload in JSON.
    ///
    /// # Errors
    /// Names the field that is missing, unknown or of another type.
    fn from_json(payload: &[u8]) -> Result<Self, DecodeError> {
        let mut json = serde_json::Deserializer::from_slice(payload);
        let message: Self = serde_path_to_error::deserialize(&mut json).map_err(|error| {
            DecodeError::json(Self::TYPE, &error.path().to_string(), error.inner())
        })?;
        json.end()
            .map_err(|error| DecodeError::json(Self::TYPE, ".", &error))?;
        Ok(message)
    }

    /// Writes the message in JSON.
    ///
    /// # Errors
    /// Never for the messages of this crate; serde's signature has one.
    fn to_json(&self) -> Result<Vec<u8>, serde_json::Error> {
        serde_json::to_vec(self)
    }

    /// Reads a payload in the form that its encoding names.
    ///
    /// # Errors
    /// Names the field that is missing or has an impossible value.
    fn decode(encoding: Encoding, payload: &[u8]) -> Result<Self, DecodeError> {
        match encoding {
            Encoding::Cdr => Self::from_cdr(payload),
            Encoding::Json => Self::from_json(payload),
        }
    }
}

#[cfg(test)]
mod tests;
