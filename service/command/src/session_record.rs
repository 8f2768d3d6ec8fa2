//! Record of a calibration's course, for the report and the exported session.

use fleetcal_estimator::{Effect, Pose2, RobotTime};
use fleetcal_fleet::document::estimate_document;
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::EstimateDocument;

/// Estimates, one a second, and the trajectory of the rear axle.
#[derive(Debug, Default)]
pub struct SessionRecord {
    /// The estimates, oldest first.
    pub estimates: Vec<EstimateDocument>,
    /// Poses of `base` in the filter's odometry frame.
    pub path: Vec<(RobotTime, Pose2)>,
}

impl SessionRecord {
    /// Adds the estimates among the effects of a step.
    pub fn take(&mut self, robot: &RobotId, effects: &[Effect]) {
        for effect in effects {
            if let Effect::Estimate(estimate) = effect {
                self.estimates.push(estimate_document(robot, estimate));
            }
        }
    }
}
