//! Errors of motions against a reference.

use fleetcal_estimator::geometry::wrap_angle_rad;
use fleetcal_estimator::lidar_odometry::OdometryPose;
use fleetcal_estimator::{Pose2, RobotTime};
use fleetcal_proto::ros::LaserScan;

/// Largest difference of stamps of one moment, s.
const SAME_S: f64 = 1e-3;

/// Pairs each odometry pose with the reference of its moment, if there is one. Both are in order.
pub fn matched(
    poses: &[(&LaserScan, OdometryPose)],
    reference: &[(RobotTime, Pose2)],
) -> Vec<(Pose2, Pose2)> {
    let mut rest = reference;
    let mut pairs = Vec::new();
    for (_, pose) in poses {
        while let Some(((stamp, truth), tail)) = rest.split_first() {
            let later_s = stamp.seconds_since(pose.stamp);
            if later_s > SAME_S {
                break;
            }
            rest = tail;
            if later_s >= -SAME_S {
                pairs.push((pose.lidar_in_odom, *truth));
                break;
            }
        }
    }
    pairs
}

/// Returns the median error of the motion over `lag` poses: of both coordinates together, m, and of
/// the yaw, degrees.
pub fn median_over(pairs: &[(Pose2, Pose2)], lag: usize) -> (f64, f64) {
    let (mut metres, mut degrees) = (Vec::new(), Vec::new());
    for ((from, true_from), (to, true_to)) in pairs.iter().zip(pairs.iter().skip(lag)) {
        let (motion, truth) = (from.between(to), true_from.between(true_to));
        metres.push((motion.x_m - truth.x_m).abs());
        metres.push((motion.y_m - truth.y_m).abs());
        degrees.push(
            wrap_angle_rad(motion.yaw_rad - truth.yaw_rad)
                .abs()
                .to_degrees(),
        );
    }
    (median(metres), median(degrees))
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
