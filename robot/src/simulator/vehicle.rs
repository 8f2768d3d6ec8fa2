//! The vehicle as it really is, and how it moves.

use fleetcal_model::VehicleModel;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use super::imperfections::VehicleImperfections;
use super::message::TrueParameters;
use super::plane::Pose2;
use super::random::{Stream, stream};
use super::steering_curve::SteeringCurve;

/// Fastest turn of the steered wheel, rad/s.
const STEERING_RATE_MAX_RAD_PER_S: f64 = 1.2;
/// Time constant of the longitudinal slip's random walk, s.
const SLIP_CORRELATION_S: f64 = 1.0;
/// Time constant of the drive motor, s.
const DRIVE_LAG_S: f64 = 0.1;
/// Half the distance between the rear wheels, over the wheelbase.
const HALF_TRACK: f64 = 0.4;

/// Slip of the wheels.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Slip {
    /// Standard deviation of the true speed's relative deviation from the wheel's, wandering with a
    /// time constant of 1 s.
    pub longitudinal_sigma: f64,
    /// Slip angle of the rear axle for each m/s² of lateral acceleration, outwards, rad.
    pub lateral_rad_per_mps2: f64,
}

/// True parameters of a vehicle, with all its errors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct VehicleTruth {
    /// Steering geometry.
    pub model: VehicleModel,
    /// Distance between the axles, m.
    pub wheelbase_m: f64,
    /// Pose of the LiDAR in `base`.
    pub lidar_in_base: Pose2,
    /// Reading of the steering sensor when the wheel points straight ahead, rad.
    pub steering_offset_rad: f64,
    /// True steering angle over the measured one less its offset.
    pub steering_gain: f64,
    /// True speed over measured speed.
    pub speed_scale: f64,
    /// Delay of a motion in the wheel odometry against the LiDAR's, s.
    pub time_offset_s: f64,
    /// Time constant of the steering actuator, s.
    pub steering_lag_s: f64,
    /// Largest true steering angle, rad.
    pub steering_limit_rad: f64,
    /// Slip of its wheels.
    pub slip: Slip,
}

impl Default for VehicleTruth {
    /// Makes a tugger whose calibration is perfect and whose LiDAR sits at x = +0.434 m.
    fn default() -> Self {
        Self {
            model: VehicleModel::Bicycle,
            wheelbase_m: 1.2,
            lidar_in_base: Pose2::new(0.434, 0.0, 0.0),
            steering_offset_rad: 0.0,
            steering_gain: 1.0,
            speed_scale: 1.0,
            time_offset_s: 0.0,
            steering_lag_s: 0.08,
            steering_limit_rad: 0.9,
            slip: Slip {
                longitudinal_sigma: 0.002,
                lateral_rad_per_mps2: 0.0,
            },
        }
    }
}

impl VehicleTruth {
    /// Returns the parameters that a calibration estimates.
    pub const fn parameters(&self) -> TrueParameters {
        TrueParameters {
            steering_offset_rad: self.steering_offset_rad,
            lidar_in_base: self.lidar_in_base,
            speed_scale: self.speed_scale,
            wheelbase_m: self.wheelbase_m,
            time_offset_s: self.time_offset_s,
            steering_gain: self.steering_gain,
        }
    }

    /// Returns the reading of the speed sensor without noise, m/s, for the turning of the wheels in
    /// the last step. At the steered wheel: `v_front = v / cos(steering)`.
    pub(super) fn measured_speed_mps(
        &self,
        imperfections: &VehicleImperfections,
        motion: &Motion,
    ) -> f64 {
        let rear_speed_mps = motion.step_wheel_speed_mps;
        let (middle_mps, wheel_sizes) = match self.model {
            VehicleModel::Bicycle | VehicleModel::RearSteered => {
                (rear_speed_mps, imperfections.wheel_sizes)
            }
            VehicleModel::Tricycle => (rear_speed_mps / motion.step_steering_rad.cos(), 0.0),
        };
        // The encoders' mean of a wheel too large on the left and one too small on the right:
        // ((v - h·w)/(1 + e) + (v + h·w)/(1 - e))/2 = (v + e·h·w)/(1 - e²).
        let half_track_m = HALF_TRACK * self.wheelbase_m;
        let left_m = imperfections.speed_encoder_y_m - wheel_sizes * half_track_m;
        let at_sensor_mps = middle_mps - left_m * motion.step_yaw_rate_rad_per_s;
        at_sensor_mps / (1.0 - wheel_sizes * wheel_sizes) / self.speed_scale
    }
}

/// Command of the controller to the actuators.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Command {
    pub speed_mps: f64,
    /// Commanded reading of the steering sensor, rad.
    pub measured_steering_rad: f64,
}

/// The vehicle's motion, integrated on exact arcs.
#[derive(Debug)]
pub(super) struct Motion {
    pub base: Pose2,
    /// Mean speed of the rear axle over the last step, as its wheels turn, m/s.
    pub step_wheel_speed_mps: f64,
    /// Mean true steering angle over the last step, rad.
    pub step_steering_rad: f64,
    /// Mean angle over the last step of the side of the play that the sensor is on, rad.
    pub step_sensor_side_rad: f64,
    /// Yaw rate over the last step, rad/s.
    pub step_yaw_rate_rad_per_s: f64,
    /// Speed of the rear axle over ground, m/s.
    pub speed_mps: f64,
    pub steering_rad: f64,
    /// Angle on the sensor's side of lag and play, rad.
    sensor_side_rad: f64,
    /// Angle behind the lag and before the play, rad.
    lagging_rad: f64,
    wheel_speed_mps: f64,
    slip: f64,
    random: ChaCha8Rng,
}

impl Motion {
    pub fn new(base: Pose2, seed: u64) -> Self {
        Self {
            base,
            step_wheel_speed_mps: 0.0,
            step_steering_rad: 0.0,
            step_sensor_side_rad: 0.0,
            step_yaw_rate_rad_per_s: 0.0,
            speed_mps: 0.0,
            steering_rad: 0.0,
            sensor_side_rad: 0.0,
            lagging_rad: 0.0,
            wheel_speed_mps: 0.0,
            slip: 0.0,
            random: stream(seed, Stream::Slip),
        }
    }

    /// Advances by `step_s`: actuators first, then one arc with the step's mean speed and steering.
    pub fn advance(
        &mut self,
        vehicle: &VehicleTruth,
        imperfections: &VehicleImperfections,
        command: &Command,
        step_s: f64,
    ) {
        let steering_before_rad = self.steering_rad;
        let sensor_side_before_rad = self.sensor_side_rad;
        self.turn_steering(vehicle, imperfections, command, step_s);
        self.turn_wheel(imperfections, step_s);
        let speed_before_mps = self.wheel_speed_mps;
        let gain = 1.0 - (-step_s / DRIVE_LAG_S).exp();
        self.wheel_speed_mps += gain * (command.speed_mps - self.wheel_speed_mps);
        self.wander_slip(vehicle.slip.longitudinal_sigma, step_s);

        self.step_steering_rad = 0.5 * (steering_before_rad + self.steering_rad);
        self.step_sensor_side_rad = 0.5 * (sensor_side_before_rad + self.sensor_side_rad);
        self.step_wheel_speed_mps = 0.5 * (speed_before_mps + self.wheel_speed_mps);
        self.speed_mps = self.step_wheel_speed_mps * (1.0 + self.slip);
        self.step_yaw_rate_rad_per_s = self.yaw_rate_rad_per_s(vehicle, imperfections);
        let side_slip = vehicle.slip.lateral_rad_per_mps2 + imperfections.side_slip_rad_per_mps2;
        let slip_angle_rad = -side_slip * self.speed_mps * self.step_yaw_rate_rad_per_s;
        let forward_m = self.speed_mps * step_s;
        // The lateral acceleration points into the bend forwards and backwards alike.
        let arc = Pose2::arc(
            forward_m,
            forward_m.abs() * slip_angle_rad.tan(),
            self.step_yaw_rate_rad_per_s * step_s,
        );
        self.base = self.base.compose(&arc);
    }

    /// Returns the yaw rate. A front axle that drifts outwards by more than the rear one widens a
    /// bend that is driven forwards. Backwards it follows, and drifting outwards it narrows the
    /// bend: `yaw_rate = v·tan(steering)/(wheelbase + understeer·|v|·v)`.
    fn yaw_rate_rad_per_s(
        &self,
        vehicle: &VehicleTruth,
        imperfections: &VehicleImperfections,
    ) -> f64 {
        let understeer_m =
            imperfections.understeer_rad_per_mps2 * self.speed_mps.abs() * self.speed_mps;
        let turn_m = vehicle.model.steered_ahead() * (vehicle.wheelbase_m + understeer_m);
        self.speed_mps * self.step_steering_rad.tan() / turn_m
    }

    fn turn_steering(
        &mut self,
        vehicle: &VehicleTruth,
        imperfections: &VehicleImperfections,
        command: &Command,
        step_s: f64,
    ) {
        let limit_rad = vehicle.steering_limit_rad;
        let wanted_rad = SteeringCurve::new(vehicle.steering_gain, imperfections)
            .wheel_rad(command.measured_steering_rad - vehicle.steering_offset_rad)
            .clamp(-limit_rad, limit_rad);
        let gain = if vehicle.steering_lag_s > 0.0 {
            1.0 - (-step_s / vehicle.steering_lag_s).exp()
        } else {
            1.0
        };
        let most_rad = STEERING_RATE_MAX_RAD_PER_S * step_s;
        let turn_rad = gain * (wanted_rad - self.sensor_side_rad);
        self.sensor_side_rad += turn_rad.clamp(-most_rad, most_rad);
    }

    /// Turns the wheel behind lag and play: 1. a first-order lag, 2. the play pushes it along.
    fn turn_wheel(&mut self, imperfections: &VehicleImperfections, step_s: f64) {
        let lag_s = imperfections.steering_lag_s;
        if lag_s > 0.0 {
            let gain = 1.0 - (-step_s / lag_s).exp();
            self.lagging_rad += gain * (self.sensor_side_rad - self.lagging_rad);
        } else {
            self.lagging_rad = self.sensor_side_rad;
        }
        let half_play_rad = 0.5 * imperfections.backlash_rad;
        self.steering_rad = self.steering_rad.clamp(
            self.lagging_rad - half_play_rad,
            self.lagging_rad + half_play_rad,
        );
    }

    /// Advances the slip, a first-order Gauss-Markov process.
    fn wander_slip(&mut self, sigma: f64, step_s: f64) {
        if sigma <= 0.0 {
            return;
        }
        let keep = 1.0 - step_s / SLIP_CORRELATION_S;
        let noise: f64 = StandardNormal.sample(&mut self.random);
        self.slip = keep * self.slip + sigma * (2.0 * step_s / SLIP_CORRELATION_S).sqrt() * noise;
    }
}
