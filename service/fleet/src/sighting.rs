//! Content of a message before it is checked: what the joining checks look at.

use fleetcal_model::{Pose2, RobotTime};
use fleetcal_proto::ros::{Header, MeasuredDrive, Pose, Units};

/// Content of a message, unchecked.
#[derive(Debug, Clone, PartialEq)]
pub struct Sighting {
    /// Its header stamp, or that of the last drive sample in it.
    pub stamp: RobotTime,
    /// Name of its frame: of an `Odometry`, the frame that is at the pose.
    pub frame: String,
    /// Name of the frame that is at a pose; `None` of a message that does not state it.
    pub child_frame: Option<String>,
    /// Its content.
    pub content: Sighted,
}

/// Content of a message.
#[derive(Debug, Clone, PartialEq)]
pub enum Sighted {
    /// Speed and steering angle as they were sent.
    Wheels {
        /// Speed, in the sender's unit.
        speed: Option<f64>,
        /// Steering angle, in the sender's unit.
        steering: Option<f64>,
    },
    /// Drive samples of one message, in the order of their stamps.
    Samples(Vec<MeasuredDrive>),
    /// A scan or cloud.
    Scan {
        /// Time from one scan to the next that it states, s; 0 for none.
        scan_time_s: f64,
    },
    /// A pose of the LiDAR.
    Pose {
        /// The pose in the plane.
        pose: Pose2,
        /// Tilt of its z axis, rad.
        tilt_rad: f64,
    },
}

impl Sighting {
    pub(crate) fn of(header: &Header, content: Sighted) -> Self {
        Self {
            stamp: RobotTime(header.stamp.as_ns()),
            frame: header.frame_id.clone(),
            child_frame: None,
            content,
        }
    }

    pub(crate) fn of_wheels(header: &Header, speed: Option<f64>, steering: Option<f64>) -> Self {
        Self::of(header, Sighted::Wheels { speed, steering })
    }

    /// The stamp is that of the last sample, which is measured when the message is sent.
    pub(crate) fn of_samples(samples: &[MeasuredDrive], units: &Units) -> Self {
        let in_units = |sample: &MeasuredDrive| MeasuredDrive {
            steering_angle: units.steering_rad(sample.steering_angle.into()) as f32,
            speed: units.speed_mps(sample.speed.into()) as f32,
            ..*sample
        };
        let stamp = samples.last().map_or(0, |sample| sample.stamp.as_ns());
        Self {
            stamp: RobotTime(stamp),
            frame: String::new(),
            child_frame: None,
            content: Sighted::Samples(samples.iter().map(in_units).collect()),
        }
    }

    pub(crate) fn of_pose(header: &Header, child_frame: Option<&str>, pose: &Pose) -> Self {
        let (q, at) = (&pose.orientation, &pose.position);
        let length = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w;
        let upright = 1.0 - 2.0 * (q.x * q.x + q.y * q.y) / length;
        let content = Sighted::Pose {
            pose: Pose2::new(at.x, at.y, q.yaw_rad()),
            tilt_rad: upright.clamp(-1.0, 1.0).acos(),
        };
        Self {
            frame: child_frame.unwrap_or(&header.frame_id).to_owned(),
            child_frame: child_frame.map(str::to_owned),
            ..Self::of(header, content)
        }
    }
}

#[cfg(test)]
mod tests {
    use fleetcal_model::Stream;
    use fleetcal_proto::message_type::{Form, MessageType};
    use fleetcal_proto::ros::{Odometry, PoseStamped, RosMessage};

    use super::*;
    use crate::reading::{Message, ReadingSettings};

    fn sighted<M: RosMessage>(message: &M) -> Sighting {
        let form = Form {
            message_type: MessageType::of_ros_type(M::TYPE),
            ..Form::default()
        };
        let message = Message {
            stream: Stream::LidarOdometry,
            form,
            payload: &message.to_cdr(),
            arrived: RobotTime(0),
        };
        message.sight(&ReadingSettings::default()).unwrap()
    }

    #[test]
    fn the_frame_of_a_pose_stamped_is_not_the_one_at_the_pose() {
        let mut stamped = PoseStamped::default();
        "base_link".clone_into(&mut stamped.header.frame_id);
        assert_eq!(sighted(&stamped).child_frame, None);
        let mut odometry = Odometry::default();
        "odom".clone_into(&mut odometry.header.frame_id);
        "base_link".clone_into(&mut odometry.child_frame_id);
        let child_frame = sighted(&odometry).child_frame;
        assert_eq!(child_frame.as_deref(), Some("base_link"));
    }
}
