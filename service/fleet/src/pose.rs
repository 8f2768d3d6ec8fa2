//! Pose of a robot's rear axle, published once for each time at which it is known.

use fleetcal_estimator::{Calibrator, Pose2, RobotTime};

/// The pose that was told last.
#[derive(Debug, Default)]
pub struct LatestPose {
    told: Option<RobotTime>,
}

impl LatestPose {
    /// Where the rear axle is in the filter's odometry frame, and when; `None` when that was told.
    pub fn advance(&mut self, calibrator: &Calibrator) -> Option<(RobotTime, Pose2)> {
        let (stamp, pose) = calibrator.base_pose()?;
        if self.told == Some(stamp) {
            return None;
        }
        self.told = Some(stamp);
        Some((stamp, pose))
    }
}
