//! Windows of motion: what drive and LiDAR say of the same 0.4 m, and how far they disagree.

use nalgebra::{Matrix3, Vector2, Vector3};

use super::evidence::{Evidence, Innovation, WINDOW_CHI2_MAX};
use crate::drive_history::{DriveHistory, DriveSegment};
use crate::estimate::Parameter;
use crate::filter::constraint::{ByParameters, LidarMotion};
use crate::filter::prediction::PredictedMotion;
use crate::filter::{
    OdometryReading, Values, apart, drive_parameters, lidar_in_base, steering_response,
};
use crate::motion_noise::MotionNoise;
use crate::stream::RobotTime;
use crate::vehicle::Vehicle;

/// A window ends after this distance, m.
const WINDOW_M: f64 = 0.4;
/// Or after this turn, rad.
const WINDOW_RAD: f64 = 0.2;

/// Least turn for each radian of steering over a window that says something about the steering.
const STEERED_MIN: f64 = 0.1;

/// What drive and LiDAR say of a window's way, before any statistics.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Track {
    /// Way of the wheels, m.
    pub driven_m: f64,
    /// Way of the body by the LiDAR, m.
    pub moved_m: f64,
    /// First steering reading, rad.
    pub steering_rad: f64,
    /// Difference between its largest and smallest reading, rad.
    pub steering_spread_rad: f64,
    /// Steering angle by which the LiDAR's turn differs from the drive's, rad.
    pub steering_error_rad: f64,
    /// Its standard deviation by the configured noise, rad.
    pub steering_sigma_rad: f64,
    /// Duration, s.
    pub duration_s: f64,
    /// How far the LiDAR is from where the wheels would have taken it, m.
    pub off_m: f64,
    /// How far it is from any point of the way there, m: wheels that slip leave it on that way.
    pub off_way_m: f64,
    /// How well the LiDAR odometry knows its way, along the direction it knows least, m (one sigma).
    pub odometry_sigma_m: f64,
}

/// One window: residual of `B X = X Z` under some parameters, linear around them.
#[derive(Debug, Clone)]
pub struct Window {
    /// LiDAR time at its beginning.
    pub begin: RobotTime,
    /// LiDAR time at its end.
    pub end: RobotTime,
    /// Measured less predicted LiDAR motion, in the LiDAR's frame.
    pub residual: Vector3<f64>,
    /// How the prediction moves with the parameters.
    pub jacobian: ByParameters,
    /// Covariance of the residual at the right parameters.
    pub covariance: Matrix3<f64>,
    /// A right perturbation of the LiDAR at the beginning, carried to the end.
    pub carry: Matrix3<f64>,
    /// What of the covariance is the motion's.
    pub motion_covariance: Matrix3<f64>,
    /// What of the covariance is the pose's at the end.
    pub end_covariance: Matrix3<f64>,
    /// The parameters the residual was taken with.
    pub values: Values,
    /// What drive and LiDAR say of its way.
    pub track: Track,
    /// What of the residual is new.
    pub innovation: Innovation,
    /// What that says about the parameters.
    pub evidence: Evidence,
}

impl Innovation {
    /// With `Cov(r_k, r_k-1) = -Ad(h^-1) R_k-1`; `own` is the window's residual as it is.
    fn after(own: Self, carry: &Matrix3<f64>, values: &Values, before: &Window) -> Option<Self> {
        let last = &before.innovation;
        let last_residual = last.residual + last.jacobian * apart(&before.values, values);
        let inverse = last.covariance.cholesky()?.inverse();
        let gain = -carry * before.end_covariance * inverse;
        Some(Self {
            residual: own.residual - gain * last_residual,
            jacobian: own.jacobian - gain * last.jacobian,
            covariance: own.covariance - gain * last.covariance * gain.transpose(),
        })
    }

    fn is_wild(&self, noise_scale: f64) -> bool {
        self.covariance.cholesky().is_none_or(|factor| {
            let square = self.residual.dot(&factor.solve(&self.residual));
            square > WINDOW_CHI2_MAX * noise_scale
        })
    }
}

/// Cuts a robot's readings into windows.
#[derive(Debug, Clone, Default)]
pub struct WindowCutter {
    begin: Option<OdometryReading>,
    /// The window before, when it ends where the next one begins and nothing wild was in it.
    before: Option<Window>,
}

impl WindowCutter {
    /// Begins again with the next reading.
    pub fn restart(&mut self) {
        *self = Self::default();
    }

    /// Takes a reading; gives the window that it completes.
    pub fn push(
        &mut self,
        reading: &OdometryReading,
        drive: &DriveHistory,
        vehicle: &Vehicle,
        values: &Values,
        (noise, noise_scale): (&MotionNoise, f64),
    ) -> Option<Window> {
        let Some(begin) = self.begin else {
            self.begin = Some(*reading);
            return None;
        };
        let offset_s = values[Parameter::TimeOffset.index()].clamp(-0.25, 0.25);
        let (from, to) = (
            begin.stamp.plus_seconds(offset_s),
            reading.stamp.plus_seconds(offset_s),
        );
        let response = steering_response(values);
        if !drive.covers(from, to) {
            self.restart();
            self.begin = Some(*reading);
            return None;
        }
        let moved = begin
            .lidar_in_odom
            .between(&reading.lidar_in_odom)
            .wrapped();
        let driven_m = drive.driven_m(from, to);
        let long = driven_m.max(moved.translation().norm()) >= WINDOW_M;
        if !long && moved.yaw_rad.abs() < WINDOW_RAD {
            return None;
        }
        self.begin = Some(*reading);
        let ways = drive.segments(from, to, response);
        let mut window = measure(&begin, reading, ways, vehicle, values, noise)?;
        if let Some(before) = self.before.take()
            && let Some(new) = Innovation::after(window.innovation, &window.carry, values, &before)
        {
            window.innovation = new;
            window.evidence = Evidence::of_window(&new)?;
        }
        self.before = Some(window.clone()).filter(|window| !window.innovation.is_wild(noise_scale));
        Some(window)
    }
}

/// One sigma of a position along the direction it is known least in, m.
fn largest_sigma_m(covariance: &Matrix3<f64>) -> f64 {
    let position = covariance.fixed_view::<2, 2>(0, 0).into_owned();
    position.symmetric_eigenvalues().max().max(0.0).sqrt()
}

/// Distance of a point from the straight way that leads from the origin to `end`, m.
fn distance_from_way_m(end: Vector2<f64>, point: Vector2<f64>) -> f64 {
    let length2_m2 = end.norm_squared().max(f64::MIN_POSITIVE);
    let part = (end.dot(&point) / length2_m2).clamp(0.0, 1.0);
    (point - end * part).norm()
}

fn measure(
    begin: &OdometryReading,
    end: &OdometryReading,
    ways: impl Iterator<Item = DriveSegment>,
    vehicle: &Vehicle,
    values: &Values,
    noise: &MotionNoise,
) -> Option<Window> {
    let parameters = drive_parameters(values);
    let mut motion = PredictedMotion::none();
    let mut twist_at_begin = None;
    let (mut least_rad, mut most_rad) = (f64::INFINITY, f64::NEG_INFINITY);
    for segment in ways {
        least_rad = least_rad.min(segment.drive.steering_rad);
        most_rad = most_rad.max(segment.drive.steering_rad);
        motion.advance(vehicle, &parameters, noise, &segment);
        twist_at_begin.get_or_insert(motion.twist);
    }
    let predicted = LidarMotion::new(&lidar_in_base(values), &motion.end_in_begin);
    let measured = begin.lidar_in_odom.between(&end.lidar_in_odom);
    let twist_at_begin = twist_at_begin.unwrap_or(motion.twist);
    let motion_covariance = predicted.by_body * motion.noise * predicted.by_body.transpose();
    let covariance = motion_covariance
        + predicted.carry * begin.covariance * predicted.carry.transpose()
        + end.covariance;
    let residual = predicted.end_in_begin.between(&measured).log();
    let jacobian = predicted.by_parameters(&motion, &twist_at_begin, noise);
    let mount = lidar_in_base(values);
    let body = mount.compose(&measured).compose(&mount.inverse());
    let turn_by_steering = jacobian[(2, Parameter::SteeringOffset.index())]
        .abs()
        .max(STEERED_MIN);
    let track = Track {
        driven_m: motion.distance_m,
        moved_m: body.translation().norm(),
        steering_rad: least_rad,
        steering_spread_rad: most_rad - least_rad,
        steering_error_rad: residual.z / turn_by_steering,
        steering_sigma_rad: covariance[(2, 2)].sqrt() / turn_by_steering,
        duration_s: end.stamp.seconds_since(begin.stamp),
        off_m: residual.xy().norm(),
        off_way_m: distance_from_way_m(
            predicted.end_in_begin.translation(),
            measured.translation(),
        ),
        odometry_sigma_m: largest_sigma_m(&(covariance - motion_covariance)),
    };
    let innovation = Innovation {
        residual,
        jacobian,
        covariance,
    };
    Some(Window {
        begin: begin.stamp,
        end: end.stamp,
        residual,
        jacobian,
        covariance,
        carry: predicted.carry,
        motion_covariance,
        end_covariance: end.covariance,
        values: *values,
        track,
        innovation,
        evidence: Evidence::of_window(&innovation)?,
    })
}
