//! Planar LiDAR odometry: the LiDAR's pose in its own odometry frame, sweep by sweep.

use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use crate::geometry::Pose2;
use crate::stream::{Stamp, Sweep};

/// Whether the pose can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Tracking {
    /// The sweep fits the map.
    Tracking,
    /// It fits, but a direction is unconstrained or the fit is poor.
    Degraded,
    /// It does not fit: the pose is a guess, and its covariance says so.
    Lost,
    /// The first sweep that fits again after a loss.
    Recovered,
}

/// What LiDAR odometry says of one sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct OdometryPose {
    /// The sweep's reference time.
    pub stamp: Stamp,
    /// The LiDAR's pose in the odometry frame at that time.
    pub lidar_in_odom: Pose2,
    /// Covariance of (x, y, yaw) in the LiDAR's own frame (a right perturbation), m and rad.
    pub covariance: Matrix3<f64>,
    /// Direction in the LiDAR's frame that the scene leaves open (a corridor's axis), rad.
    pub unconstrained_rad: Option<f64>,
    /// Share of the used beams that lie on the map, 0 to 1.
    pub fitness: f64,
    /// Whether the pose can be trusted.
    pub tracking: Tracking,
    /// Whether the map was begun anew with this sweep: poses before and after do not compare.
    pub map_restarted: bool,
}

/// LiDAR odometry of one robot.
#[derive(Debug, Clone, Default)]
pub struct LidarOdometry {
    last: Option<Stamp>,
}

impl LidarOdometry {
    /// Takes one sweep and says where the LiDAR is; `None` when the sweep has too few returns.
    pub fn process(&mut self, sweep: &Sweep) -> Option<OdometryPose> {
        self.last = Some(sweep.reference_stamp());
        None
    }
}
