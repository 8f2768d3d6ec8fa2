//! Conversion of a robot's messages into an estimator's inputs. The live path and
//! `fleetcal calibrate` both use it, so that a message is refused by both or by neither, for the
//! same reason.

use fleetcal_domain::limits::NOTE_CHARS_MAX;
use fleetcal_estimator::stream::{BEAMS_MAX, FieldRefused, ScanShape};
use fleetcal_estimator::{DriveSample, Event, LidarPose, Note, Pose2, RobotTime, Scan};
use fleetcal_model::Stream;
use fleetcal_proto::calibration::CalibrationValues;
use fleetcal_proto::encoding::DecodeError;
use fleetcal_proto::event::RobotEvent;
use fleetcal_proto::message_type::MessageType;
use fleetcal_proto::ros::{
    DriveSamples, Header, LaserScan, MeasuredDrive, Odometry, Pose, Quaternion, ScanRefused, Units,
    Unstated,
};
use nalgebra::Matrix3;
use thiserror::Error;

use crate::cloud::CloudUnusable;

/// Shortest quaternion that still defines an orientation.
const QUATERNION_LENGTH_MIN: f64 = 1e-3;

/// Reason for which a message was refused: its stream, the field, the value and the accepted
/// values.
#[derive(Debug, Error)]
pub enum MessageRefused {
    /// The payload is not a message of this kind.
    #[error("{stream}: {source}", stream = stream.name())]
    Payload {
        /// Stream of the message.
        stream: Stream,
        /// Fault of the payload.
        source: DecodeError,
    },
    /// The scan contradicts itself.
    #[error("scan: {0}")]
    Scan(#[from] ScanRefused),
    /// The cloud contradicts itself, or no scan can be made of it.
    #[error("scan: {0}")]
    Cloud(#[from] CloudUnusable),
    /// A field holds an impossible value.
    #[error("{stream}: {source}", stream = stream.name())]
    Field {
        /// Stream of the message.
        stream: Stream,
        /// Fault of the field.
        source: FieldRefused,
    },
    /// A drive sample among several holds an impossible value.
    #[error("wheel_odometry: samples[{index}]: {source}")]
    Sample {
        /// Place of the sample in its message.
        index: usize,
        /// Fault of the field.
        source: FieldRefused,
    },
    /// The quaternion is too short to define an orientation.
    #[error(
        "lidar_odometry: pose.pose.orientation: got of length {length}, expected a quaternion of \
         length 1"
    )]
    Orientation {
        /// Length of the quaternion.
        length: f64,
    },
    /// The message has a type that the stream does not accept.
    #[error("{stream}: type: got {found}, expected {accepted}", stream = stream.name())]
    Type {
        /// Stream of the message.
        stream: Stream,
        /// Type of the message.
        found: &'static str,
        /// Accepted types.
        accepted: String,
    },
    /// A joint that the robot's configuration names is missing.
    #[error("{stream}: name lacks the joint {joint:?} or its {what}, expected the joints of streams.joints", stream = stream.name())]
    Joint {
        /// Stream of the message.
        stream: Stream,
        /// Name of the joint.
        joint: String,
        /// `position` or `velocity`.
        what: &'static str,
    },
    /// A field of the message is empty.
    #[error("{stream}: {field} is empty, expected the values of the robot's joints", stream = stream.name())]
    Empty {
        /// Stream of the message.
        stream: Stream,
        /// Name of the field.
        field: &'static str,
    },
    /// The message holds joints, and the configuration does not name those that steer and drive.
    #[error("{stream}: has the state of joints, accepted where streams.joints says which joints steer and drive", stream = stream.name())]
    NoJoints {
        /// Stream of the message.
        stream: Stream,
    },
    /// Of steering and speed, which come in turn on a topic of joints, one never comes.
    #[error("{stream}: {messages} messages in a row lack the {lacks}, expected the joints of streams.joints", stream = stream.name())]
    OnePart {
        /// Stream of the message.
        stream: Stream,
        /// Number of the messages.
        messages: u32,
        /// Missing part.
        lacks: &'static str,
    },
    /// The yaw rate is no number.
    #[error("{stream}: twist.angular.z: got {1}, expected a finite number", stream = .0.name())]
    YawRate(Stream, f64),
    /// The event cannot be read.
    #[error("event: {0}, expected {{\"kind\", \"stamp_ns\", \"note\"}}")]
    Event(#[source] serde_json::Error),
    /// The event's note is too long.
    #[error("event: note: got {0} characters, expected {NOTE_CHARS_MAX} at most")]
    NoteTooLong(usize),
    /// The event lacks a time.
    #[error("event: stamp_ns: got {0}, expected a time after 1970")]
    NoteStamp(i64),
}

impl MessageRefused {
    /// Makes the refusal of a type that the stream does not accept.
    pub(super) fn of_type(stream: Stream, found: MessageType) -> Self {
        let accepted = MessageType::of_stream(stream)
            .iter()
            .map(|of| of.ros_type());
        Self::Type {
            stream,
            found: found.ros_type(),
            accepted: accepted.collect::<Vec<_>>().join(" and "),
        }
    }

    /// Makes the refusal of a message that does not state its steering or its speed.
    pub(super) fn of_wheels(stream: Stream, of: MessageType, unstated: Unstated) -> Self {
        match unstated {
            Unstated::ByType => Self::of_type(stream, of),
            Unstated::NoJoints => Self::NoJoints { stream },
            Unstated::Joint { joint, what, .. } => Self::Joint {
                stream,
                joint,
                what,
            },
            Unstated::Field(field) => Self::Empty { stream, field },
        }
    }
}

/// Accepted message.
#[derive(Debug, Clone, PartialEq)]
pub struct Decoded {
    /// Its header stamp.
    pub stamp: RobotTime,
    /// Event for the estimator.
    pub event: Event,
    /// Note for the robot's history, if the message is one.
    pub note: Option<RobotEvent>,
}

/// Extracts the drive samples from their message, in the order of their stamps.
///
/// # Errors
/// Names the field of the sample that holds an impossible value.
pub fn drive_samples(
    message: &DriveSamples,
    units: &Units,
) -> Result<Vec<DriveSample>, MessageRefused> {
    let sample = |(index, measured): (usize, &MeasuredDrive)| {
        let stamp = RobotTime(measured.stamp.as_ns());
        let speed_mps = units.speed_mps(measured.speed.into());
        let steering_rad = units.steering_rad(measured.steering_angle.into());
        DriveSample::new(stamp, speed_mps, steering_rad)
            .map_err(|source| MessageRefused::Sample { index, source })
    };
    message.samples().iter().enumerate().map(sample).collect()
}

/// Restores the drive sample that the sensors measured, for a robot that applies `values` before it
/// sends: `steering_sent = steering_gain (steering_measured - steering_offset)` and `speed_sent =
/// speed_scale speed_measured`.
///
/// # Errors
/// Names the field that becomes an impossible value.
pub fn added_back(
    sample: &DriveSample,
    values: &CalibrationValues,
) -> Result<DriveSample, MessageRefused> {
    let gain = values.steering_gain.unwrap_or(1.0);
    let scale = values.speed_scale.unwrap_or(1.0);
    let steering_rad = sample.steering_rad() / gain + values.steering_offset_rad;
    let speed_mps = sample.speed_mps() / scale;
    DriveSample::new(sample.stamp(), speed_mps, steering_rad).map_err(|source| {
        MessageRefused::Field {
            stream: Stream::WheelOdometry,
            source,
        }
    })
}

/// Extracts a scan from its message; of more beams than an estimator takes, every second, third and
/// so on.
///
/// # Errors
/// Names the field that holds an impossible value, or the number of beams that contradicts the
/// angles.
pub fn scan(message: LaserScan) -> Result<Scan, MessageRefused> {
    message.check_beams()?;
    let every = message.ranges.len().div_ceil(BEAMS_MAX).max(1);
    let step = every as f64;
    let shape = ScanShape {
        angle_min_rad: f64::from(message.angle_min),
        angle_increment_rad: step * f64::from(message.angle_increment),
        time_increment_s: step * f64::from(message.time_increment),
        range_min_m: f64::from(message.range_min),
        range_max_m: f64::from(message.range_max),
    };
    let ranges_m = match every {
        1 => message.ranges,
        _ => message.ranges.iter().copied().step_by(every).collect(),
    };
    Scan::new(RobotTime(message.header.stamp.as_ns()), shape, ranges_m).map_err(|source| {
        MessageRefused::Field {
            stream: Stream::Scan,
            source,
        }
    })
}

/// Extracts a LiDAR pose from its message. A covariance of zeros counts as absent.
///
/// # Errors
/// Names the field that holds an impossible value.
pub fn lidar_pose(message: &Odometry) -> Result<LidarPose, MessageRefused> {
    let covariance = planar_covariance(&message.pose.covariance);
    pose_in_odom(&message.header, &message.pose.pose, covariance)
}

/// Extracts a LiDAR pose from the pose of a message, in any fixed frame.
///
/// # Errors
/// Names the field that holds an impossible value.
pub fn pose_in_odom(
    header: &Header,
    pose: &Pose,
    covariance: Option<Matrix3<f64>>,
) -> Result<LidarPose, MessageRefused> {
    let Quaternion { x, y, z, w } = pose.orientation;
    let length = (x * x + y * y + z * z + w * w).sqrt();
    if length < QUATERNION_LENGTH_MIN {
        return Err(MessageRefused::Orientation { length });
    }
    let lidar_in_odom = Pose2::new(pose.position.x, pose.position.y, pose.orientation.yaw_rad());
    LidarPose::new(RobotTime(header.stamp.as_ns()), lidar_in_odom, covariance).map_err(|source| {
        MessageRefused::Field {
            stream: Stream::LidarOdometry,
            source,
        }
    })
}

/// Reduces the covariance of (x, y, z, roll, pitch, yaw) to that of (x, y, yaw).
fn planar_covariance(spatial: &[f64; 36]) -> Option<Matrix3<f64>> {
    let [
        xx,
        xy,
        _,
        _,
        _,
        xa,
        yx,
        yy,
        _,
        _,
        _,
        ya,
        ..,
        ax,
        ay,
        _,
        _,
        _,
        aa,
    ] = *spatial;
    let planar = Matrix3::new(xx, xy, xa, yx, yy, ya, ax, ay, aa);
    (planar != Matrix3::zeros()).then_some(planar)
}

/// Reads and checks a robot's event.
///
/// # Errors
/// It is no event, its note is too long, or its time is before 1970.
pub fn event(payload: &[u8]) -> Result<Decoded, MessageRefused> {
    let message: RobotEvent = serde_json::from_slice(payload).map_err(MessageRefused::Event)?;
    let chars = message.note.chars().count();
    if chars > NOTE_CHARS_MAX {
        return Err(MessageRefused::NoteTooLong(chars));
    }
    if message.stamp_ns.0 <= 0 {
        return Err(MessageRefused::NoteStamp(message.stamp_ns.0));
    }
    let note = note(&message);
    Ok(Decoded {
        stamp: note.stamp,
        event: Event::Note(note),
        note: Some(message),
    })
}

/// Converts a robot's event to the estimator's note.
pub fn note(message: &RobotEvent) -> Note {
    Note {
        stamp: message.stamp_ns,
        kind: message.kind,
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use fleetcal_model::NoteKind;
    use fleetcal_proto::Encoding;
    use fleetcal_proto::ros::{AckermannDriveStamped, RosMessage, Time};

    use super::*;
    use crate::reading::testing::decoded;

    fn header() -> Header {
        Header {
            stamp: Time {
                sec: 1_700_000_000,
                nanosec: 5,
            },
            frame_id: "laser".to_owned(),
        }
    }

    fn scan() -> LaserScan {
        LaserScan {
            header: header(),
            angle_min: -1.5,
            angle_max: 1.5,
            angle_increment: 0.5,
            time_increment: 0.0,
            scan_time: 0.1,
            range_min: 0.05,
            range_max: 30.0,
            ranges: Arc::from([1.0, f32::NAN, f32::INFINITY, -1.0, 0.0, 99.0, 2.0]),
            intensities: Arc::from([]),
        }
    }

    fn decode_cdr(stream: Stream, payload: &[u8]) -> Result<Decoded, MessageRefused> {
        decoded(stream, Encoding::Cdr.into(), payload)
    }

    fn refusal(stream: Stream, payload: &[u8]) -> String {
        decode_cdr(stream, payload)
            .expect_err("must be refused")
            .to_string()
    }

    #[test]
    fn a_scan_with_every_kind_of_range_is_accepted() {
        let read = decode_cdr(Stream::Scan, &scan().to_cdr()).expect("normal input");
        assert_eq!(read.stamp, RobotTime(1_700_000_000_000_000_005));
        let json = scan().to_json().expect("json");
        let form = Encoding::Json.into();
        assert!(decoded(Stream::Scan, form, &json).is_ok());
    }

    #[test]
    fn a_scan_whose_length_contradicts_its_angles_is_refused_by_field() {
        let longer = LaserScan {
            ranges: vec![1.0; 900].into(),
            ..scan()
        };
        let reason = refusal(Stream::Scan, &longer.to_cdr());
        assert!(reason.contains("ranges has 900 beams"), "{reason}");
    }

    #[test]
    fn each_field_that_cannot_be_is_named() {
        let cases: [(&str, LaserScan); 6] = [
            (
                "angle_min",
                LaserScan {
                    angle_min: f32::NAN,
                    ..scan()
                },
            ),
            (
                "angle_increment",
                LaserScan {
                    angle_increment: 0.0,
                    ..scan()
                },
            ),
            (
                "time_increment",
                LaserScan {
                    time_increment: -1.0,
                    ..scan()
                },
            ),
            (
                "range_min",
                LaserScan {
                    range_min: f32::NEG_INFINITY,
                    ..scan()
                },
            ),
            (
                "range_max",
                LaserScan {
                    range_max: f32::NAN,
                    ..scan()
                },
            ),
            (
                "header.stamp",
                LaserScan {
                    header: Header::default(),
                    ..scan()
                },
            ),
        ];
        for (field, message) in cases {
            let reason = refusal(Stream::Scan, &message.to_cdr());
            assert!(
                reason.starts_with("scan: ") && reason.contains(field),
                "{reason}"
            );
        }
        for (field, speed, steering_angle) in [
            ("drive.speed", f32::INFINITY, 0.0),
            ("drive.speed", 51.0, 0.0),
            ("drive.steering_angle", 0.0, f32::NAN),
            ("drive.steering_angle", 0.0, -4.0),
        ] {
            let mut message = AckermannDriveStamped {
                header: header(),
                ..Default::default()
            };
            message.drive.speed = speed;
            message.drive.steering_angle = steering_angle;
            let reason = refusal(Stream::WheelOdometry, &message.to_cdr());
            assert!(
                reason.contains(field) && reason.contains("expected"),
                "{reason}"
            );
        }
    }

    #[test]
    fn a_pose_keeps_its_planar_covariance() {
        let mut message = Odometry {
            header: header(),
            ..Default::default()
        };
        message.pose.pose.orientation = Quaternion::from_yaw(0.3);
        assert_eq!(
            lidar_pose(&message).expect("no covariance").covariance(),
            None
        );
        for (at, value) in [
            (0, 1.0),
            (1, 0.1),
            (6, 0.1),
            (7, 2.0),
            (35, 3.0),
            (5, 0.2),
            (30, 0.2),
        ] {
            message.pose.covariance[at] = value;
        }
        let pose = lidar_pose(&message).expect("a covariance");
        let wanted = Matrix3::new(1.0, 0.1, 0.2, 0.1, 2.0, 0.0, 0.2, 0.0, 3.0);
        assert_eq!(pose.covariance(), Some(&wanted));
        message.pose.covariance[0] = -1.0;
        let reason = lidar_pose(&message).expect_err("not positive").to_string();
        assert!(reason.contains("pose.covariance"), "{reason}");
        message.pose.pose.orientation = Quaternion {
            x: 0.0,
            y: 0.0,
            z: 0.0,
            w: 0.0,
        };
        let reason = lidar_pose(&message).expect_err("no direction").to_string();
        assert!(reason.contains("orientation"), "{reason}");
    }

    #[test]
    fn an_event_is_json_with_known_keys() {
        let payload = br#"{"kind": "reassembled", "stamp_ns": 7, "note": "new bracket"}"#;
        let decoded = decode_cdr(Stream::Event, payload).expect("documented");
        assert_eq!(
            decoded.event,
            Event::Note(Note {
                stamp: RobotTime(7),
                kind: NoteKind::Reassembled
            })
        );
        assert!(
            refusal(Stream::Event, br#"{"kind": "exploded", "stamp_ns": 7}"#).contains("exploded")
        );
        assert!(
            refusal(Stream::Event, br#"{"kind": "power_on", "stamp_ns": 0}"#).contains("stamp_ns")
        );
    }
}
