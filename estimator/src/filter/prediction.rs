//! Prediction: the body's motion over drive readings, by exact arcs, with its Jacobians.

use nalgebra::{Matrix3, SMatrix, Vector3};
use serde::{Deserialize, Serialize};

use super::padded;
use crate::drive_history::DriveSegment;
use crate::geometry::Pose2;
use crate::motion_noise::MotionNoise;
use crate::vehicle::{
    BY_SPEED_LEAD, BY_STEERING_LAG, DRIVE_PARAMETERS, DriveParameters, Motion, Vehicle,
};

/// Time constant with which the twist is smoothed, s.
const TWIST_TIME_CONSTANT_S: f64 = 0.1;

/// Three standard deviations of the difference of two smoothed speeds, m/s: white noise of `along` per root
/// metre, through a low-pass of this time constant.
pub fn speed_noise_mps(noise: &MotionNoise, twist: &Vector3<f64>) -> f64 {
    let sigma_mps =
        noise.along_m_per_sqrt_m * (twist.x.abs() / (2.0 * TWIST_TIME_CONSTANT_S)).sqrt();
    3.0 * std::f64::consts::SQRT_2 * sigma_mps
}

/// Derivatives of a pose's right perturbation by the drive parameters.
pub type ByDriveParameters = SMatrix<f64, 3, DRIVE_PARAMETERS>;

/// A stretch of predicted motion: pose, Jacobians and noise, all of the right perturbation at its
/// end. Accumulated sample by sample, applied to the filter's covariance once an update.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PredictedMotion {
    /// `begin_from_end`.
    pub end_in_begin: Pose2,
    /// Derivatives by the right perturbation at the beginning.
    pub by_begin: Matrix3<f64>,
    /// Derivatives by the drive parameters.
    #[serde(deserialize_with = "padded::columns")]
    pub by_parameters: ByDriveParameters,
    /// Process noise.
    pub noise: Matrix3<f64>,
    /// Body twist (m/s, m/s, rad/s) now, of readings without noise where those are known, else smoothed:
    /// the noise of single readings must not pass for a change of speed.
    pub twist: Vector3<f64>,
    /// Distance driven, m, counted without sign.
    pub distance_m: f64,
    /// Turned angle, rad, counted without sign.
    pub turned_rad: f64,
}

impl PredictedMotion {
    /// No motion yet.
    pub fn none() -> Self {
        Self {
            end_in_begin: Pose2::IDENTITY,
            by_begin: Matrix3::identity(),
            by_parameters: ByDriveParameters::zeros(),
            noise: Matrix3::zeros(),
            twist: Vector3::zeros(),
            distance_m: 0.0,
            turned_rad: 0.0,
        }
    }

    /// Goes on by one reading: `B <- B * exp(twist * dt)`, exact for constant speed and steering.
    ///
    /// The right perturbation moves as `eta <- Ad(D^-1) eta + J_r d(twist)`, with the right
    /// Jacobian `J_r = I - ad/2` to first order in the step, which is below 0.1 rad.
    pub fn advance(
        &mut self,
        vehicle: &Vehicle,
        parameters: &DriveParameters,
        noise: &MotionNoise,
        segment: &DriveSegment,
    ) {
        let motion = vehicle.motion(segment.drive, parameters);
        let dt_s = segment.duration_s;
        let step = self.smooth_twist(&motion, dt_s);
        if let Some(reading) = segment.drive.without_noise() {
            self.twist = twist(&vehicle.motion(reading, parameters));
        }
        // (I - ad(step)/2) applied to a change of the twist.
        let carried = |by: Vector3<f64>| {
            by - 0.5
                * Vector3::new(
                    step.y * by.z - step.z * by.y,
                    step.z * by.x - step.x * by.z,
                    0.0,
                )
        };
        let mut by_parameters = ByDriveParameters::zeros();
        let by = motion
            .speed_by
            .iter()
            .zip(&motion.side_speed_by)
            .zip(&motion.yaw_rate_by);
        for (column, ((speed_by, side_by), yaw_by)) in by.enumerate() {
            let twist_by = Vector3::new(*speed_by, *side_by, *yaw_by);
            by_parameters.set_column(column, &carried(twist_by * dt_s));
        }
        let arc = Pose2::exp(&step);
        let carry = arc.inverse().adjoint();
        self.end_in_begin = self.end_in_begin.compose(&arc);
        self.by_begin = carry * self.by_begin;
        self.by_parameters = carry * self.by_parameters + by_parameters;
        self.noise = carry * self.noise * carry.transpose() + noise.of_step(&motion, segment);
        self.distance_m += (motion.speed_mps * dt_s).abs();
        self.turned_rad += (motion.yaw_rate_radps * dt_s).abs();
    }

    /// Brings a motion into the smoothed twist; the twist over `dt_s`, as a step.
    fn smooth_twist(&mut self, motion: &Motion, dt_s: f64) -> Vector3<f64> {
        let twist = twist(motion);
        let share = dt_s / (dt_s + TWIST_TIME_CONSTANT_S);
        self.twist += (twist - self.twist) * share;
        twist * dt_s
    }
}

/// Changes of a motion by a shift of the drive's time, as its right perturbation over the shift in
/// seconds: those by a lead of the speed, and the reverse of those by a lag of the steering. Made
/// of those two, it contains nothing of the shift that they don't: where the speed is constant, a
/// shift and a lag are one.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ByTimeShift {
    speed: Vector3<f64>,
    steering: Vector3<f64>,
}

impl ByTimeShift {
    /// Changes of a motion that began exactly known.
    pub fn of(motion: &PredictedMotion) -> Self {
        Self::default().after(motion)
    }

    /// Changes of the motion before and one that followed.
    #[must_use]
    pub fn after(&self, motion: &PredictedMotion) -> Self {
        let (carry, by) = (&motion.by_begin, &motion.by_parameters);
        Self {
            speed: carry * self.speed + by.column(BY_SPEED_LEAD),
            steering: carry * self.steering - by.column(BY_STEERING_LAG),
        }
    }

    /// Changes by both together, for speeds at both ends. Where these differ by no more than
    /// `speed_noise_mps` they count as equal: speed alone distinguishes a shift from a lag of the
    /// steering, and its noise must not pass for knowledge of that.
    pub fn between(&self, speeds_mps: (f64, f64), speed_noise_mps: f64) -> Vector3<f64> {
        if (speeds_mps.1 - speeds_mps.0).abs() <= speed_noise_mps {
            self.steering
        } else {
            self.speed + self.steering
        }
    }
}

/// The body twist of a motion (m/s, m/s, rad/s).
pub fn twist(motion: &Motion) -> Vector3<f64> {
    Vector3::new(
        motion.speed_mps,
        motion.side_speed_mps,
        motion.yaw_rate_radps,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::{DriveReading, SteeringCurve, SteeringResponse, VehicleModel};

    fn parameters(offset: f64, scale: f64) -> DriveParameters {
        DriveParameters {
            steering_offset_rad: offset,
            speed_scale: scale,
            wheelbase_m: 1.2,
            steering_gain: 1.0,
            side_slip_rad_per_mps2: 0.004,
            curve: SteeringCurve::default(),
            response: SteeringResponse::default(),
            half_play_rad: 0.0,
        }
    }

    fn drive_curve(offset: f64, scale: f64) -> PredictedMotion {
        let vehicle = Vehicle::new(VehicleModel::Bicycle, 1.2);
        let mut motion = PredictedMotion::none();
        for i in 0..200 {
            let drive = DriveReading {
                speed_mps: 1.0,
                steering_rad: 0.2 + 0.001 * f64::from(i),
                ..DriveReading::default()
            };
            let segment = DriveSegment {
                duration_s: 0.01,
                drive,
                held_m: 0.0,
                steering_step_rad: 0.0,
            };
            motion.advance(
                &vehicle,
                &parameters(offset, scale),
                &MotionNoise::default(),
                &segment,
            );
        }
        motion
    }

    #[test]
    fn parameter_jacobians_match_differences() {
        let here = drive_curve(0.02, 1.0);
        let h = 1e-6;
        for (column, up, down) in [
            (0, drive_curve(0.02 + h, 1.0), drive_curve(0.02 - h, 1.0)),
            (1, drive_curve(0.02, 1.0 + h), drive_curve(0.02, 1.0 - h)),
        ] {
            let numeric = (here.end_in_begin.between(&up.end_in_begin).log()
                - here.end_in_begin.between(&down.end_in_begin).log())
                / (2.0 * h);
            let analytic = here.by_parameters.column(column).into_owned();
            assert!((numeric - analytic).norm() < 1e-4, "{numeric} {analytic}");
        }
    }

    #[test]
    fn a_full_circle_comes_back_exactly() {
        let vehicle = Vehicle::new(VehicleModel::Bicycle, 1.2);
        let p = parameters(0.0, 1.0);
        let steering_rad = (1.2f64 * std::f64::consts::TAU / 10.0).atan();
        let segment = DriveSegment {
            duration_s: 0.1,
            drive: DriveReading {
                speed_mps: 1.0,
                steering_rad,
                ..DriveReading::default()
            },
            held_m: 0.0,
            steering_step_rad: 0.0,
        };
        let mut motion = PredictedMotion::none();
        for _ in 0..100 {
            motion.advance(&vehicle, &p, &MotionNoise::default(), &segment);
        }
        assert!(motion.end_in_begin.translation().norm() < 1e-9);
    }
}
