//! Path following as the robot does it: with the calibration it believes in.

use std::f64::consts::TAU;

use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::config::{Applied, LocalisationNoise, SimulationConfig, SpeedProfile};
use super::plane::{Pose2, wrap_angle_rad};
use super::random::{Stream, stream};
use super::route::Route;
use super::vehicle::Command;

/// Curvature for each metre beside the route, 1/m².
const LATERAL_GAIN_PER_M2: f64 = 0.8;
/// Curvature for each radian off its heading, 1/m: critically damped along the way.
const HEADING_GAIN_PER_M: f64 = 1.8;
/// Largest error that is corrected at once, m.
const LATERAL_ERROR_MAX_M: f64 = 0.6;
/// Preview of the route's own curvature against the actuator's lag, s.
const PREVIEW_S: f64 = 0.1;
/// Largest lateral acceleration on a route, m/s².
const LATERAL_ACCELERATION_MAX_MPS2: f64 = 0.7;
/// Distances ahead at which the curvature limits the speed, m.
const CURVATURE_AHEAD_M: [f64; 3] = [0.0, 0.6, 1.2];

/// Fastest speed backwards, m/s.
const REVERSE_SPEED_MAX_MPS: f64 = 0.5;
/// Distance from a turning point within which a robot has reached it, m.
const THERE_M: f64 = 0.02;
/// Speed below which a robot stands, m/s.
const STANDS_MPS: f64 = 0.02;

/// Commands from one fix of the localisation to the next.
const COMMANDS_PER_LOCALISATION: u32 = 5;

/// Direction of the robot along its route.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Gear {
    Forwards,
    /// Backwards to a place on the route, m.
    Backwards {
        to_m: f64,
    },
}

/// Follower of a route: its curvature fed forward, lateral and heading error fed back. There is no
/// integral part, so that a steering offset keeps the robot beside its route.
#[derive(Debug)]
pub(super) struct Controller {
    route: Route,
    profile: SpeedProfile,
    wheelbase_m: f64,
    /// Sign of the steering to the left: -1 where the steered axle is at the rear.
    steered_ahead: f64,
    steering_limit_rad: f64,
    speed_mps: f64,
    gear: Gear,
    /// Stretches driven backwards so far.
    reversals: usize,
    noise: LocalisationNoise,
    random: ChaCha8Rng,
    commands: u32,
    /// Present error of the localisation, in the LiDAR's frame.
    off: Pose2,
    believed_along_m: f64,
    believed_left_m: f64,
    true_along_m: f64,
    true_left_m: f64,
}

impl Controller {
    pub fn new(config: &SimulationConfig) -> Self {
        Self {
            route: config.route.clone(),
            profile: config.speed,
            wheelbase_m: config.configured_wheelbase_m(),
            steered_ahead: config.vehicle.model.steered_ahead(),
            steering_limit_rad: config.vehicle.steering_limit_rad,
            speed_mps: 0.0,
            gear: Gear::Forwards,
            reversals: 0,
            noise: config.localisation,
            random: stream(config.seed, Stream::Localisation),
            commands: 0,
            off: Pose2::default(),
            believed_along_m: 0.0,
            believed_left_m: 0.0,
            true_along_m: 0.0,
            true_left_m: 0.0,
        }
    }

    /// Returns the robot's own estimate of its distance to the left of its route, m.
    pub fn believed_left_m(&self) -> f64 {
        self.believed_left_m
    }

    /// Returns its true distance to the left of its route, m.
    pub fn true_left_m(&self) -> f64 {
        self.true_left_m
    }

    /// Returns the command for the next interval. The robot knows its LiDAR's pose and computes its
    /// base by the applied mount; it corrects the steering by the applied offset.
    pub fn command(
        &mut self,
        base: &Pose2,
        lidar: &Pose2,
        applied: &Applied,
        time_s: f64,
        step_s: f64,
    ) -> Command {
        let true_place = self.route.nearest(base.point(), self.true_along_m);
        (self.true_along_m, self.true_left_m) = (true_place.along_m, true_place.left_m);
        self.localise();
        let believed = lidar
            .compose(&self.off)
            .compose(&applied.lidar_in_base.inverse());
        let place = self.route.nearest(believed.point(), self.believed_along_m);
        (self.believed_along_m, self.believed_left_m) = (place.along_m, place.left_m);

        let heading_rad = wrap_angle_rad(believed.yaw_rad - self.route.heading_at(place.along_m));
        let left_m = place
            .left_m
            .clamp(-LATERAL_ERROR_MAX_M, LATERAL_ERROR_MAX_M);
        let preview_m = PREVIEW_S * self.speed_mps;
        self.shift();
        // Along the way back the heading acts on the lateral error with the other sign.
        let heading_gain_per_m = match self.gear {
            Gear::Forwards => HEADING_GAIN_PER_M,
            Gear::Backwards { .. } => -HEADING_GAIN_PER_M,
        };
        let curvature = self.route.curvature_at(place.along_m + preview_m)
            - LATERAL_GAIN_PER_M2 * left_m
            - heading_gain_per_m * heading_rad;
        let steering_rad = (self.steered_ahead * self.wheelbase_m * curvature)
            .atan()
            .clamp(-self.steering_limit_rad, self.steering_limit_rad);
        self.speed_mps = self.next_speed_mps(time_s, step_s);
        Command {
            speed_mps: self.speed_mps,
            measured_steering_rad: steering_rad + applied.steering_offset_rad,
        }
    }

    fn localise(&mut self) {
        if self.commands.is_multiple_of(COMMANDS_PER_LOCALISATION) {
            let mut draw = |sigma: f64| {
                let noise: f64 = StandardNormal.sample(&mut self.random);
                sigma * noise
            };
            let LocalisationNoise {
                position_sigma_m,
                yaw_sigma_rad,
            } = self.noise;
            self.off = Pose2::new(
                draw(position_sigma_m),
                draw(position_sigma_m),
                draw(yaw_sigma_rad),
            );
        }
        self.commands = self.commands.wrapping_add(1);
    }

    /// Returns the remaining way to where the robot turns back or continues, m; 0 on arrival.
    fn until_shift_m(&self) -> Option<f64> {
        let left_m = match self.gear {
            Gear::Forwards => self.route.reversal(self.reversals)?.at_m - self.believed_along_m,
            Gear::Backwards { to_m } => self.believed_along_m - to_m,
        };
        Some(if left_m < THERE_M { 0.0 } else { left_m })
    }

    /// Changes the gear of a robot that stands at its turning point.
    fn shift(&mut self) {
        let there = self.until_shift_m().is_some_and(|left_m| left_m <= 0.0);
        if !there || self.speed_mps.abs() > STANDS_MPS {
            return;
        }
        if let (Gear::Forwards, Some(reversal)) = (self.gear, self.route.reversal(self.reversals)) {
            let to_m = reversal.at_m - reversal.length_m;
            self.gear = Gear::Backwards { to_m };
        } else {
            self.reversals += 1;
            self.gear = Gear::Forwards;
        }
    }

    fn next_speed_mps(&self, time_s: f64, step_s: f64) -> f64 {
        let SpeedProfile {
            rest_s,
            min_mps,
            max_mps,
            period_s,
            acceleration_mps2,
        } = self.profile;
        let wave = 0.5 - 0.5 * (TAU * (time_s - rest_s) / period_s).cos();
        let mut wanted_mps = min_mps + wave * (max_mps - min_mps);
        for ahead_m in CURVATURE_AHEAD_M {
            let curvature = self
                .route
                .curvature_at(self.believed_along_m + ahead_m)
                .abs();
            wanted_mps =
                wanted_mps.min((LATERAL_ACCELERATION_MAX_MPS2 / curvature.max(1e-3)).sqrt());
        }
        if !self.route.is_closed() {
            let left_m = (self.route.length_m() - self.believed_along_m).max(0.0);
            wanted_mps = wanted_mps.min((2.0 * acceleration_mps2 * left_m).sqrt());
        }
        if let Some(left_m) = self.until_shift_m() {
            wanted_mps = wanted_mps.min((2.0 * acceleration_mps2 * left_m).sqrt());
        }
        if let Gear::Backwards { .. } = self.gear {
            wanted_mps = -wanted_mps.min(REVERSE_SPEED_MAX_MPS);
        }
        if time_s < rest_s {
            wanted_mps = 0.0;
        }
        let most_mps = acceleration_mps2 * step_s;
        self.speed_mps + (wanted_mps - self.speed_mps).clamp(-most_mps, most_mps)
    }
}
