//! Recordings of real and simulated robots, by the vehicles that they are of.

use std::path::{Path, PathBuf};

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::stream::{FieldRefused, ScanShape};
use fleetcal_estimator::{
    Calibrator, DriveSample, Event, LidarOdometry, LidarPose, Pose2, RobotTime, Scan, Vehicle,
    VehicleModel,
};
use fleetcal_proto::ros::{AckermannDriveStamped, LaserScan, Odometry, RosMessage};
use fleetcal_robot::recording::{
    AskedTopics, ChosenPose, Recording, choose_scan_topic, choose_topics,
};

use super::Failure;
use super::lines::{self, Lines};

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

    /// The lines of its publications: a calibration where it has wheel odometry, else the poses of
    /// the LiDAR odometry.
    pub fn drive(&self) -> Result<String, Failure> {
        let recording = Recording::open(&self.path)?;
        match self.vehicle {
            Some((model, wheelbase_m)) => calibrated(&recording, Vehicle::new(model, wheelbase_m)),
            None => followed(&recording),
        }
    }
}

fn calibrated(recording: &Recording, vehicle: Vehicle) -> Result<String, Failure> {
    let topics = choose_topics(recording.channels(), &AskedTopics::default())?;
    let mut lines = Lines::of(Calibrator::new(CalibratorConfig::of(vehicle)));
    for message in recording.messages(&topics.names())? {
        let message = message?;
        let event = if *message.topic == *topics.wheel_odometry_topic() {
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
        };
        lines.step(event);
    }
    Ok(lines.end())
}

fn followed(recording: &Recording) -> Result<String, Failure> {
    let channel = choose_scan_topic(recording.channels(), None)?;
    let mut odometry = LidarOdometry::default();
    let mut text = String::new();
    for message in recording.messages(&[&channel.topic])? {
        let scan = scan_of(&LaserScan::from_cdr(&message?.payload)?)?;
        if let Some(pose) = odometry.process(&scan) {
            lines::of_odometry(&mut text, &pose);
        }
    }
    Ok(text)
}

fn scan_of(scan: &LaserScan) -> Result<Scan, FieldRefused> {
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
