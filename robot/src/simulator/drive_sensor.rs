//! Speed and steering as the robot measures them: averages over the interval that ends at the stamp.

use std::collections::VecDeque;

use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use super::imperfections::VehicleImperfections;
use super::message::DriveSample;
use super::random::{Stream, stream};
use super::steering_curve::SteeringCurve;
use super::vehicle::{Motion, VehicleTruth};

/// Speed below which the wheels stand and an encoder shows no noise, m/s.
const STANDSTILL_MPS: f64 = 1e-3;

/// The wheel odometry's settings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DriveSettings {
    /// Samples in a second; the interval must be a whole number of milliseconds.
    pub rate_hz: f64,
    /// Standard deviation of a speed, m/s; 0 at rest.
    pub speed_sigma_mps: f64,
    /// Standard deviation of a steering angle before it is quantised, rad.
    pub steering_sigma_rad: f64,
    /// Step of the steering encoder, rad; 0 for a continuous one.
    pub steering_step_rad: f64,
}

impl Default for DriveSettings {
    fn default() -> Self {
        Self {
            rate_hz: 100.0,
            speed_sigma_mps: 0.005,
            steering_sigma_rad: 0.0,
            steering_step_rad: 0.25_f64.to_radians(),
        }
    }
}

/// Sensor that averages an interval's motion and measures it.
#[derive(Debug)]
pub(super) struct DriveSensor {
    settings: DriveSettings,
    random: ChaCha8Rng,
    speed_sum_mps: f64,
    steering_sum_rad: f64,
    steps: u32,
    /// Shown angles of the steps still in delay, the oldest first, rad.
    delayed_rad: VecDeque<f64>,
    delay_steps: usize,
}

impl DriveSensor {
    /// Makes the sensor; `delay_steps` is the delay of an angle, in steps of the motion.
    pub fn new(settings: DriveSettings, delay_steps: usize, seed: u64) -> Self {
        Self {
            settings,
            random: stream(seed, Stream::WheelOdometry),
            speed_sum_mps: 0.0,
            steering_sum_rad: 0.0,
            steps: 0,
            delayed_rad: VecDeque::new(),
            delay_steps,
        }
    }

    /// Adds one step of the motion.
    pub fn gather(
        &mut self,
        vehicle: &VehicleTruth,
        imperfections: &VehicleImperfections,
        motion: &Motion,
    ) {
        self.speed_sum_mps += vehicle.measured_speed_mps(imperfections, motion);
        let curve = SteeringCurve::new(vehicle.steering_gain, imperfections);
        let shown_rad = curve.shown_rad(motion.step_sensor_side_rad) + vehicle.steering_offset_rad;
        self.steering_sum_rad += self.late(shown_rad);
        self.steps += 1;
    }

    /// Returns the angle that shows now: the one of `delay_steps` ago, or the first one until then.
    fn late(&mut self, shown_rad: f64) -> f64 {
        self.delayed_rad.push_back(shown_rad);
        if self.delayed_rad.len() > self.delay_steps {
            return self.delayed_rad.pop_front().unwrap_or(shown_rad);
        }
        self.delayed_rad.front().copied().unwrap_or(shown_rad)
    }

    /// Returns the sample of the interval that ends at `time_ns` of simulated time.
    pub fn sample(&mut self, vehicle: &VehicleTruth, time_ns: i64) -> DriveSample {
        let steps = f64::from(self.steps.max(1));
        let speed_mps = self.speed_sum_mps / steps;
        let steering_rad = self.steering_sum_rad / steps;
        (self.speed_sum_mps, self.steering_sum_rad, self.steps) = (0.0, 0.0, 0);
        let speed_noise: f64 = StandardNormal.sample(&mut self.random);
        let steering_noise: f64 = StandardNormal.sample(&mut self.random);
        let moving = speed_mps.abs() > STANDSTILL_MPS;
        let speed_sigma_mps = if moving {
            self.settings.speed_sigma_mps
        } else {
            0.0
        };
        let noisy_rad = steering_rad + self.settings.steering_sigma_rad * steering_noise;
        DriveSample {
            stamp_ns: time_ns + (vehicle.time_offset_s * 1e9).round() as i64,
            speed_mps: speed_mps + speed_sigma_mps * speed_noise,
            steering_rad: quantise(noisy_rad, self.settings.steering_step_rad),
        }
    }
}

fn quantise(value: f64, step: f64) -> f64 {
    if step > 0.0 {
        (value / step).round() * step
    } else {
        value
    }
}
