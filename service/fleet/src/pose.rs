//! Pose of a robot's rear axle, published once for each time at which it is known.

use fleetcal_estimator::{Calibrator, Pose2, RobotTime};

/// Pose that was published last.
#[derive(Debug, Default)]
pub struct LatestPose {
    told: Option<RobotTime>,
}

impl LatestPose {
    /// Returns the time and the pose of the rear axle in the filter's odometry frame; `None` if it
    /// was published already.
    pub fn advance(&mut self, calibrator: &Calibrator) -> Option<(RobotTime, Pose2)> {
        let (stamp, pose) = calibrator.base_pose()?;
        if self.told == Some(stamp) {
            return None;
        }
        self.told = Some(stamp);
        Some((stamp, pose))
    }
}
