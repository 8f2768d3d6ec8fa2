//! Planar LiDAR odometry: the LiDAR's pose in its own odometry frame, sweep by sweep.

mod beam_filter;
mod motion;
mod point_to_line;
mod submap;

use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use crate::geometry::Pose2;
use crate::stream::{Stamp, Sweep};
use beam_filter::{BeamFilter, SweepPoints};
use motion::Motion;
use point_to_line::{Fit, LocalMotion, linearise};
use submap::{FreeSpace, LocalOrigin, Submap};

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

/// Fewest usable returns of a sweep.
const POINTS_MIN: usize = 20;
/// Most Gauss-Newton iterations.
const ITERATIONS_MAX: usize = 6;
/// The iteration ends when a step is smaller than this, m and rad.
const STEP_MIN: f64 = 5e-5;
/// The map is updated when the LiDAR has moved this far, m.
const UPDATE_DISTANCE_M: f64 = 0.12;
/// The map is updated when the LiDAR has turned this far, rad.
const UPDATE_ANGLE_RAD: f64 = 0.06;
/// The map is updated at the latest after this time, s.
const UPDATE_PERIOD_S: f64 = 2.0;
/// So many sweeps after the first all go into the map.
const UPDATES_AT_START: u32 = 5;

/// LiDAR odometry of one robot.
#[derive(Debug, Clone)]
pub struct LidarOdometry {
    beam_filter: BeamFilter,
    points: SweepPoints,
    submap: Submap,
    free_space: FreeSpace,
    motion: Option<Motion>,
    last_stamp: Stamp,
    range_noise_m: f32,
    map_pose: Pose2,
    map_stamp: Stamp,
}

impl Default for LidarOdometry {
    fn default() -> Self {
        Self {
            beam_filter: BeamFilter::default(),
            points: SweepPoints::default(),
            submap: Submap::default(),
            free_space: FreeSpace::default(),
            motion: None,
            last_stamp: Stamp::default(),
            range_noise_m: 0.02,
            map_pose: Pose2::IDENTITY,
            map_stamp: Stamp::default(),
        }
    }
}

impl LidarOdometry {
    /// Takes one sweep and says where the LiDAR is; `None` when the sweep has too few returns.
    pub fn process(&mut self, sweep: &Sweep) -> Option<OdometryPose> {
        let stamp = sweep.reference_stamp();
        self.beam_filter.filter(sweep, &mut self.points);
        if self.points.len() < POINTS_MIN {
            return None;
        }
        let Some(last) = self.motion.clone() else {
            let motion = Motion::starting_at(Pose2::IDENTITY);
            self.last_stamp = stamp;
            self.update_map(&motion, stamp);
            self.motion = Some(motion.clone());
            return Some(OdometryPose {
                stamp,
                lidar_in_odom: motion.pose,
                covariance: motion.covariance.fixed_view::<3, 3>(0, 0).into_owned(),
                unconstrained_rad: None,
                fitness: 1.0,
                tracking: Tracking::Tracking,
                map_restarted: true,
            });
        };
        let dt = stamp.seconds_since(self.last_stamp);
        if dt <= 0.0 {
            return None;
        }
        self.last_stamp = stamp;
        let predicted = last.predicted(dt);
        let (motion, fit) = self.align(&predicted)?;
        self.learn_noise(&fit);
        if self.update_is_due(&motion, stamp) {
            self.update_map(&motion, stamp);
        }
        let covariance = motion.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let pose = OdometryPose {
            stamp,
            lidar_in_odom: motion.pose,
            covariance,
            unconstrained_rad: None,
            fitness: fit.fitness(),
            tracking: Tracking::Tracking,
            map_restarted: false,
        };
        self.motion = Some(motion);
        Some(pose)
    }

    fn align(&self, predicted: &Motion) -> Option<(Motion, Fit)> {
        let information = predicted.information()?;
        let origin = LocalOrigin::near(predicted.pose.x_m, predicted.pose.y_m);
        let mut motion = predicted.clone();
        let mut fit = Fit::default();
        for iteration in 0..ITERATIONS_MAX {
            let local = LocalMotion::new(&motion, origin);
            let stride = if iteration == 0 { 2 } else { 1 };
            let equations = linearise(
                &self.points,
                &self.submap,
                &local,
                self.range_noise_m,
                stride,
            );
            let (correction, covariance) = predicted.step(&information, &motion, &equations)?;
            motion.correct(&correction);
            motion.covariance = covariance;
            fit = equations.fit;
            if iteration > 0 && correction.fixed_rows::<3>(0).amax() < STEP_MIN {
                break;
            }
        }
        Some((motion, fit))
    }

    fn learn_noise(&mut self, fit: &Fit) {
        if fit.on_map < 50.0 {
            return;
        }
        let ratio = (fit.chi2 / fit.on_map).clamp(0.25, 4.0);
        self.range_noise_m = (self.range_noise_m * ratio.powf(0.05)).clamp(0.003, 0.06);
    }

    fn update_is_due(&self, motion: &Motion, stamp: Stamp) -> bool {
        let moved = self.map_pose.between(&motion.pose);
        self.submap.updates() < UPDATES_AT_START
            || moved.translation().norm() > UPDATE_DISTANCE_M
            || moved.yaw_rad.abs() > UPDATE_ANGLE_RAD
            || stamp.seconds_since(self.map_stamp) > UPDATE_PERIOD_S
    }

    fn update_map(&mut self, motion: &Motion, stamp: Stamp) {
        self.map_pose = motion.pose;
        self.map_stamp = stamp;
        let origin = LocalOrigin::near(motion.pose.x_m, motion.pose.y_m);
        let local = LocalMotion::new(motion, origin);
        let from = local.position();
        let (centre, _, _) = origin.locate(from.0, from.1);
        self.submap.begin_update(centre, self.range_noise_m);
        self.free_space.follow(centre);
        let positions = self
            .points
            .x
            .iter()
            .zip(&self.points.y)
            .zip(&self.points.tau);
        for (index, ((&px, &py), &tau)) in positions.enumerate() {
            let (qx, qy) = local.deskew(px, py, tau);
            let point = local.transform(qx, qy);
            let (cell, _, _) = origin.locate(point.0, point.1);
            if index % submap::RAY_STRIDE == 0 {
                self.free_space.pass(origin, from, point, &mut self.submap);
            }
            let is_static = !self.free_space.was_free(cell);
            self.free_space.hit(cell);
            if is_static {
                self.submap.insert(origin, point.0, point.1, 1.0);
            }
        }
        self.submap.end_update();
    }
}

impl LidarOdometry {
    /// Bytes held for this robot.
    pub fn memory_bytes(&self) -> usize {
        self.submap.memory_bytes() + self.free_space.memory_bytes()
    }

    /// The scanner's range noise as measured so far, m (one sigma).
    pub fn range_noise_m(&self) -> f64 {
        f64::from(self.range_noise_m)
    }
}
