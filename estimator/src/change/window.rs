//! Windows of motion: what drive and LiDAR say of the same half metre, and how far they disagree.

use nalgebra::{Matrix3, SMatrix, Vector3};

use crate::drive_history::DriveHistory;
use crate::estimate::Parameter;
use crate::filter::noise::MotionNoise;
use crate::filter::prediction::PredictedMotion;
use crate::filter::{OdometryReading, PARAMETERS, Values, drive_parameters, lidar_in_base};
use crate::stream::Stamp;
use crate::vehicle::Vehicle;

/// A window ends after this distance, m.
const WINDOW_M: f64 = 0.5;
/// Or after this turn, rad.
const WINDOW_RAD: f64 = 0.25;

/// Derivatives of a window's residual by the parameters.
pub type WindowJacobian = SMatrix<f64, 3, PARAMETERS>;

/// One window: residual of `B X = X Z` under some parameters, linear around them.
#[derive(Debug, Clone)]
pub struct Window {
    /// LiDAR time at its beginning.
    pub begin: Stamp,
    /// LiDAR time at its end.
    pub end: Stamp,
    /// Measured less predicted LiDAR motion, in the LiDAR's frame.
    pub residual: Vector3<f64>,
    /// How the prediction moves with the parameters.
    pub jacobian: WindowJacobian,
    /// Covariance of the residual at the right parameters.
    pub covariance: Matrix3<f64>,
    /// The parameters the residual was taken with.
    pub values: Values,
}

/// Cuts a robot's readings into windows.
#[derive(Debug, Clone, Default)]
pub struct WindowCutter {
    begin: Option<OdometryReading>,
}

impl WindowCutter {
    /// Begins anew with the next reading.
    pub fn restart(&mut self) {
        self.begin = None;
    }

    /// Takes a reading; gives the window that it completes.
    pub fn push(
        &mut self,
        reading: &OdometryReading,
        drive: &DriveHistory,
        vehicle: &Vehicle,
        values: &Values,
        noise: &MotionNoise,
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
        if !drive.covers(from, to) {
            self.begin = Some(*reading);
            return None;
        }
        let moved = begin
            .lidar_in_odom
            .between(&reading.lidar_in_odom)
            .wrapped();
        let driven_m: f64 = drive
            .segments(from, to)
            .map(|segment| segment.drive.speed_mps.abs() * segment.duration_s)
            .sum();
        let long = driven_m.max(moved.translation().norm()) >= WINDOW_M;
        if !long && moved.yaw_rad.abs() < WINDOW_RAD {
            return None;
        }
        self.begin = Some(*reading);
        Some(measure(
            &begin,
            reading,
            drive,
            (from, to),
            vehicle,
            values,
            noise,
        ))
    }
}

fn measure(
    begin: &OdometryReading,
    end: &OdometryReading,
    drive: &DriveHistory,
    (from, to): (Stamp, Stamp),
    vehicle: &Vehicle,
    values: &Values,
    noise: &MotionNoise,
) -> Window {
    let parameters = drive_parameters(values);
    let mut motion = PredictedMotion::none();
    let mut twist_at_begin = None;
    for segment in drive.segments(from, to) {
        motion.advance(vehicle, &parameters, noise, &segment);
        twist_at_begin.get_or_insert(motion.twist);
    }
    let x = lidar_in_base(values);
    let body = motion.end_in_begin;
    let h = x.inverse().compose(&body).compose(&x);
    let z = begin.lidar_in_odom.between(&end.lidar_in_odom);

    let lidar_from_base = x.inverse().adjoint();
    let back = h.inverse().adjoint();
    let mut jacobian = WindowJacobian::zeros();
    for (column, parameter) in [
        Parameter::SteeringOffset,
        Parameter::SpeedScale,
        Parameter::Wheelbase,
        Parameter::SteeringGain,
    ]
    .iter()
    .enumerate()
    {
        jacobian.set_column(
            parameter.index(),
            &(lidar_from_base * motion.by_parameters.column(column)),
        );
    }
    let (s, c) = x.yaw_rad.sin_cos();
    let turned = Matrix3::new(c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0);
    jacobian
        .fixed_view_mut::<3, 3>(0, Parameter::LidarX.index())
        .copy_from(&((Matrix3::identity() - back) * turned));
    let moved = motion.twist - body.inverse().adjoint() * twist_at_begin.unwrap_or(motion.twist);
    jacobian.set_column(Parameter::TimeOffset.index(), &(lidar_from_base * moved));

    let covariance = lidar_from_base * motion.noise * lidar_from_base.transpose()
        + back * begin.covariance * back.transpose()
        + end.covariance;
    Window {
        begin: begin.stamp,
        end: end.stamp,
        residual: h.between(&z).log(),
        jacobian,
        covariance,
        values: *values,
    }
}
