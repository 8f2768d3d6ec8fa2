//! The LiDAR's own odometry, made up from the truth: for tests of the filter alone.

use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use super::message::LidarPose;
use super::plane::Pose2;
use super::random::{Stream, stream};

/// Noise of a pose stream.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PoseSettings {
    /// Poses in a second.
    pub rate_hz: f64,
    /// Standard deviation of each coordinate of a pose, independent from pose to pose, m.
    pub position_sigma_m: f64,
    /// Standard deviation of the heading, rad.
    pub yaw_sigma_rad: f64,
    /// Standard deviation that each motion from pose to pose adds for good, per coordinate, m.
    pub position_walk_m: f64,
    /// Standard deviation that each motion adds to the heading for good, rad.
    pub yaw_walk_rad: f64,
    /// Time from the start of the simulation to the first pose, s.
    pub phase_s: f64,
}

impl Default for PoseSettings {
    fn default() -> Self {
        Self {
            rate_hz: 10.0,
            position_sigma_m: 0.002,
            yaw_sigma_rad: 2.5e-4,
            position_walk_m: 0.0,
            yaw_walk_rad: 0.0,
            phase_s: 0.0537,
        }
    }
}

/// Sensor with the odometry's own estimate of the LiDAR's pose.
#[derive(Debug)]
pub(super) struct PoseSensor {
    settings: PoseSettings,
    /// Measured lengths over true ones.
    length_scale: f64,
    random: ChaCha8Rng,
    last_true: Option<Pose2>,
    /// Pose by the odometry, with its walk and without its white noise.
    walked: Pose2,
}

impl PoseSensor {
    pub fn new(settings: PoseSettings, range_scale: f64, seed: u64) -> Self {
        let random = stream(seed, Stream::Pose);
        Self {
            settings,
            length_scale: 1.0 + range_scale,
            random,
            last_true: None,
            walked: Pose2::default(),
        }
    }

    pub fn pose(&mut self, true_pose: Pose2, time_ns: i64) -> LidarPose {
        let PoseSettings {
            position_sigma_m,
            yaw_sigma_rad,
            position_walk_m,
            yaw_walk_rad,
            ..
        } = self.settings;
        if let Some(last) = self.last_true {
            let step = self.noise(position_walk_m, yaw_walk_rad);
            self.walked = self
                .walked
                .compose(&self.scaled(&last.between(&true_pose)))
                .compose(&step);
        }
        self.last_true = Some(true_pose);
        let noise = self.noise(position_sigma_m, yaw_sigma_rad);
        let position_m2 = position_sigma_m * position_sigma_m + position_walk_m * position_walk_m;
        let yaw_rad2 = yaw_sigma_rad * yaw_sigma_rad + yaw_walk_rad * yaw_walk_rad;
        let covariance = (position_m2 > 0.0 && yaw_rad2 > 0.0).then_some([
            [position_m2, 0.0, 0.0],
            [0.0, position_m2, 0.0],
            [0.0, 0.0, yaw_rad2],
        ]);
        LidarPose {
            stamp_ns: time_ns,
            pose: self.walked.compose(&noise),
            covariance,
        }
    }

    /// Scales a motion for an odometry whose ranges are all too long by the same share.
    fn scaled(&self, motion: &Pose2) -> Pose2 {
        Pose2::new(
            self.length_scale * motion.x_m,
            self.length_scale * motion.y_m,
            motion.yaw_rad,
        )
    }

    fn noise(&mut self, position_m: f64, yaw_rad: f64) -> Pose2 {
        let mut draw = |sigma: f64| {
            let noise: f64 = StandardNormal.sample(&mut self.random);
            sigma * noise
        };
        Pose2::new(draw(position_m), draw(position_m), draw(yaw_rad))
    }
}
