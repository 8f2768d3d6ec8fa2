//! A robot that drives what a script says, seen by a filter: for manoeuvres no route describes, such
//! as driving in reverse.

use std::collections::VecDeque;

use fleetcal_estimator::drive_history::{DriveHistory, DriveSegment};
use fleetcal_estimator::filter::follow::Follower;
use fleetcal_estimator::filter::prior::Prior;
use fleetcal_estimator::filter::{Filter, OdometryReading};
use fleetcal_estimator::geometry::Pose2;
use fleetcal_estimator::stream::FieldRefused;
use fleetcal_estimator::vehicle::{DriveParameters, DriveReading};
use fleetcal_estimator::{DriveSample, EstimatorSettings, RobotTime, Vehicle};
use nalgebra::{Matrix3, Vector3};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use rand_distr::StandardNormal;

/// Time from one drive sample to the next, ns.
const STEP_NS: i64 = 10_000_000;
/// Drive samples from one LiDAR pose to the next.
const STEPS_PER_POSE: u64 = 10;
/// Time constant of steering and drive, s.
const LAG_S: f64 = 0.1;
/// Noise of a speed (m/s), step of the steering encoder (rad).
const SPEED_SIGMA_MPS: f64 = 0.005;
const STEERING_STEP_RAD: f64 = 0.25 / 180.0 * std::f64::consts::PI;
/// Noise of the LiDAR's pose, m and rad: 3 mm and 0.03°.
const POSE_SIGMA: [f64; 3] = [0.003, 0.003, 0.000_5];

/// True parameters of a vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// Steering offset, speed scale, wheelbase, gain.
    pub parameters: DriveParameters,
    /// Delay of the wheel odometry, s.
    pub time_offset_s: f64,
    /// The mount.
    pub lidar_in_base: Pose2,
}

/// A robot, and the filter that follows it.
#[derive(Debug, Clone)]
pub struct Scripted {
    vehicle: Vehicle,
    truth: Truth,
    settings: EstimatorSettings,
    follower: Follower,
    drive: DriveHistory,
    waiting: VecDeque<OdometryReading>,
    random: StdRng,
    steps: u64,
    base: Pose2,
    speed_mps: f64,
    steering_rad: f64,
}

impl Scripted {
    /// Makes a robot at rest, whose filter knows a vehicle and a mount by CAD.
    pub fn new(seed: u64, vehicle: Vehicle, truth: Truth, cad: Pose2) -> Self {
        let settings = EstimatorSettings::default();
        let prior = Prior::cold(&vehicle, Some(cad), &settings);
        Self {
            follower: Follower::new(Filter::new(vehicle, &settings, &prior)),
            vehicle,
            truth,
            settings,
            drive: DriveHistory::new(60.0),
            waiting: VecDeque::new(),
            random: StdRng::seed_from_u64(seed),
            steps: 0,
            base: Pose2::IDENTITY,
            speed_mps: 0.0,
            steering_rad: 0.0,
        }
    }

    /// Returns the filter.
    pub fn filter(&self) -> &Filter {
        &self.follower.filter
    }

    /// Returns the configured vehicle, and the filter's settings.
    pub fn known(&self) -> (&Vehicle, &EstimatorSettings) {
        (&self.vehicle, &self.settings)
    }

    /// Drives the readings of a vehicle without errors (so their speed is that of the rear axle).
    ///
    /// # Errors
    /// Names the field of a sample that is refused.
    pub fn drive(&mut self, readings: &[DriveSegment]) -> Result<(), FieldRefused> {
        for reading in readings {
            let steps = (reading.duration_s * 1e9 / STEP_NS as f64).round() as u64;
            for _ in 0..steps {
                self.step(reading.drive)?;
            }
        }
        Ok(())
    }

    fn step(&mut self, wanted: DriveReading) -> Result<(), FieldRefused> {
        let step_s = STEP_NS as f64 * 1e-9;
        let gain = 1.0 - (-step_s / LAG_S).exp();
        self.speed_mps += gain * (wanted.speed_mps - self.speed_mps);
        self.steering_rad += gain * (wanted.steering_rad - self.steering_rad);
        let wheelbase_m = self.truth.parameters.wheelbase_m;
        let yaw_rate = self.speed_mps * self.steering_rad.tan() / wheelbase_m;
        let twist = Vector3::new(self.speed_mps, 0.0, yaw_rate);
        self.base = self.base.compose(&Pose2::exp(&(twist * step_s)));
        self.steps += 1;
        let now = RobotTime(1_760_000_000_000_000_000 + self.steps as i64 * STEP_NS);
        if self.steps.is_multiple_of(STEPS_PER_POSE) {
            self.see_lidar(now);
        }
        self.sense_drive(now)
    }

    fn see_lidar(&mut self, now: RobotTime) {
        let noise = POSE_SIGMA.map(|sigma| sigma * self.random.sample::<f64, _>(StandardNormal));
        let lidar = self.base.compose(&self.truth.lidar_in_base);
        let sigma = Vector3::from(POSE_SIGMA);
        self.waiting.push_back(OdometryReading {
            stamp: now,
            lidar_in_odom: lidar.compose(&Pose2::exp(&Vector3::from(noise))),
            covariance: Matrix3::from_diagonal(&sigma.component_mul(&sigma)),
        });
    }

    fn sense_drive(&mut self, now: RobotTime) -> Result<(), FieldRefused> {
        let DriveParameters {
            steering_offset_rad,
            speed_scale,
            steering_gain,
            ..
        } = self.truth.parameters;
        let noise: f64 = self.random.sample(StandardNormal);
        let measured_rad = self.steering_rad / steering_gain + steering_offset_rad;
        let sample = DriveSample::new(
            now.plus_seconds(self.truth.time_offset_s),
            self.speed_mps / speed_scale + SPEED_SIGMA_MPS * noise,
            (measured_rad / STEERING_STEP_RAD).round() * STEERING_STEP_RAD,
        )?;
        self.drive.push(sample);
        while let Some(reading) = self.waiting.front()
            && self.follower.drive_time(reading, &self.settings) <= sample.stamp()
        {
            self.follower.follow(reading, &self.drive, &self.settings);
            self.waiting.pop_front();
        }
        Ok(())
    }
}
