//! Joining checks of one robot: from its messages, as they come, to what is wrong with them.

use fleetcal_checks::{Checks, Described, Finding, Head, StreamReport};
use fleetcal_domain::robot::RobotConfig;
use fleetcal_estimator::lidar_odometry::OdometryPose;
use fleetcal_estimator::{Event, Scan};
use fleetcal_model::Stream;

use crate::decode::MessageRefused;
use crate::intake::Taken;
use crate::sighting::{Sighted, Sighting};

/// The joining checks of a robot.
#[derive(Debug)]
pub struct JoiningChecks {
    checks: Checks,
}

impl JoiningChecks {
    /// Checks of a robot as it was described.
    pub fn new(config: &RobotConfig) -> Self {
        let described = Described {
            model: config.model,
            wheelbase_m: config.wheelbase_m.metres(),
            nominal_yaw_rad: config.nominal_extrinsics.map(|mount| mount.pose().yaw_rad),
        };
        Self {
            checks: Checks::new(described),
        }
    }

    /// Takes a message: what it says, and what it came to. `arrival_ns` is of a clock that is the same
    /// for all streams.
    pub fn take(
        &mut self,
        stream: Stream,
        arrival_ns: i64,
        sighting: Option<&Sighting>,
        taken: &Result<Taken, MessageRefused>,
    ) {
        if let Err(refused) = taken {
            self.checks.refuse(stream, arrival_ns, &refused.to_string());
        }
        let Some(Sighting {
            stamp,
            frame,
            content,
        }) = sighting
        else {
            return;
        };
        let head = Head {
            stream,
            stamp: *stamp,
            frame,
            arrival_ns,
        };
        match *content {
            Sighted::Wheels { speed, steering } => self.checks.take_wheels(&head, speed, steering),
            Sighted::Scan { scan_time_s } => {
                if let Some(scan) = taken.as_ref().ok().and_then(scan_of) {
                    self.checks.take_scan(&head, scan, scan_time_s);
                }
            }
            Sighted::Pose { pose, tilt_rad } => self.checks.take_pose(&head, pose, tilt_rad),
        }
    }

    /// Takes the pose that LiDAR odometry gives the latest scan.
    pub fn take_odometry(&mut self, pose: &OdometryPose) {
        self.checks.take_odometry(pose);
    }

    /// Returns the result of each check.
    pub fn findings(&self) -> Vec<Finding> {
        self.checks.findings()
    }

    /// Returns a report on each stream.
    pub fn streams(&self) -> Vec<StreamReport> {
        self.checks.streams()
    }

    /// The LiDAR's way so far, m.
    pub fn way_m(&self) -> f64 {
        self.checks.way_m()
    }
}

/// The scan that a message came to.
pub fn scan_of(taken: &Taken) -> Option<&Scan> {
    taken
        .events
        .iter()
        .find_map(|decoded| match &decoded.event {
            Event::Scan(scan) => Some(scan),
            _ => None,
        })
}
