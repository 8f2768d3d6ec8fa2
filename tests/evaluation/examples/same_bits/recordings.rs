//! Lines of recordings.

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::{Calibrator, LidarOdometry, Vehicle};
use fleetcal_proto::ros::{LaserScan, RosMessage};
use fleetcal_robot::recording::{Recording, choose_scan_topic};

use super::Failure;
use super::lines::{self, Lines};
use super::recorded::{Drive, each_event, scan_of};

/// The lines of a recording's publications: a calibration where it has wheel odometry, else the poses of
/// the LiDAR odometry.
pub fn lines_of(drive: &Drive) -> Result<String, Failure> {
    let recording = drive.open()?;
    match drive.vehicle() {
        Some(vehicle) => calibrated(&recording, vehicle),
        None => followed(&recording),
    }
}

fn calibrated(recording: &Recording, vehicle: Vehicle) -> Result<String, Failure> {
    let mut lines = Lines::of(Calibrator::new(CalibratorConfig::of(vehicle)));
    each_event(recording, |event| lines.step(event))?;
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
