//! Recordings of real and simulated robots, by the vehicles that they are of.

use std::path::{Path, PathBuf};

use fleetcal_estimator::stream::{FieldRefused, ScanShape};
use fleetcal_estimator::{
    DriveSample, Event, LidarPose, Pose2, RobotTime, Scan, Vehicle, VehicleModel,
};
use fleetcal_proto::ros::{AckermannDriveStamped, LaserScan, Odometry, RosMessage};
use fleetcal_robot::recording::{AskedTopics, ChosenPose, Recording, choose_topics};

use super::Failure;

/// Recordings, and the vehicles of those with wheel odometry: model and wheelbase, m.
const RECORDINGS: [(&str, Option<(VehicleModel, f64)>); 6] = [
    ("figure_eight", Some((VehicleModel::Bicycle, 1.2))),
    ("remounted", Some((VehicleModel::Bicycle, 1.2))),
    (
        "sapienza_tricycle",
        Some((VehicleModel::Tricycle, 1.547_57)),
    ),
    ("dart_right", Some((VehicleModel::Bicycle, 0.173_5))),
    ("unsw_ugv", None),
    ("freiburg_079", None),
];

/// A recording of the corpus.
#[derive(Debug)]
pub struct Drive {
    path: PathBuf,
    name: &'static str,
    vehicle: Option<(VehicleModel, f64)>,
}

/// Recordings of a folder.
pub fn of(data: &Path) -> impl Iterator<Item = Drive> + Send + use<> {
    let data = data.to_owned();
    RECORDINGS.into_iter().map(move |(name, vehicle)| Drive {
        path: data.join(format!("{name}.mcap")),
        name,
        vehicle,
    })
}

impl Drive {
    /// Its name.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// The vehicle of a recording with wheel odometry.
    pub fn vehicle(&self) -> Option<Vehicle> {
        let (model, wheelbase_m) = self.vehicle?;
        Some(Vehicle::new(model, wheelbase_m))
    }

    /// Opens it.
    pub fn open(&self) -> Result<Recording, Failure> {
        Ok(Recording::open(&self.path)?)
    }
}

/// Takes the messages of a robot with wheel odometry as events of the estimator.
pub fn each_event(recording: &Recording, mut take: impl FnMut(Event)) -> Result<(), Failure> {
    let topics = choose_topics(recording.channels(), &AskedTopics::default())?;
    for message in recording.messages(&topics.names())? {
        let message = message?;
        take(if *message.topic == *topics.wheel_odometry_topic() {
            let sample = AckermannDriveStamped::from_cdr(&message.payload)?;
            Event::WheelOdometry(DriveSample::new(
                RobotTime(sample.header.stamp.as_ns()),
                f64::from(sample.drive.speed),
                f64::from(sample.drive.steering_angle),
            )?)
        } else if matches!(topics.pose, ChosenPose::Scan(_)) {
            Event::Scan(scan_of(&LaserScan::from_cdr(&message.payload)?)?)
        } else {
            Event::LidarPose(pose_of(&Odometry::from_cdr(&message.payload)?)?)
        });
    }
    Ok(())
}

/// Converts a scan.
pub fn scan_of(scan: &LaserScan) -> Result<Scan, FieldRefused> {
    let shape = ScanShape {
        angle_min_rad: f64::from(scan.angle_min),
        angle_increment_rad: f64::from(scan.angle_increment),
        time_increment_s: f64::from(scan.time_increment),
        range_min_m: f64::from(scan.range_min),
        range_max_m: f64::from(scan.range_max),
    };
    let stamp = RobotTime(scan.header.stamp.as_ns());
    Scan::new(stamp, shape, scan.ranges.clone())
}

fn pose_of(odometry: &Odometry) -> Result<LidarPose, FieldRefused> {
    let pose = &odometry.pose.pose;
    LidarPose::new(
        RobotTime(odometry.header.stamp.as_ns()),
        Pose2::new(pose.position.x, pose.position.y, pose.orientation.yaw_rad()),
        None,
    )
}
