//! Windows of motion: what drive and LiDAR say of the same half metre, and how far they disagree.

use nalgebra::{Matrix3, Vector3};

use super::evidence::Evidence;
use crate::drive_history::DriveHistory;
use crate::estimate::Parameter;
use crate::filter::constraint::{ByParameters, LidarMotion};
use crate::filter::noise::MotionNoise;
use crate::filter::prediction::PredictedMotion;
use crate::filter::{OdometryReading, Values, drive_parameters, lidar_in_base};
use crate::stream::Stamp;
use crate::vehicle::Vehicle;

/// A window ends after this distance, m.
const WINDOW_M: f64 = 0.5;
/// Or after this turn, rad.
const WINDOW_RAD: f64 = 0.25;

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
    /// What it says about them.
    pub evidence: Evidence,
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
        measure(&begin, reading, drive, (from, to), vehicle, values, noise)
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
) -> Option<Window> {
    let parameters = drive_parameters(values);
    let mut motion = PredictedMotion::none();
    let mut twist_at_begin = None;
    for segment in drive.segments(from, to) {
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
    let jacobian = predicted.by_parameters(&motion, &twist_at_begin);
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
        evidence: Evidence::of_window(&residual, &jacobian, &covariance)?,
    })
}
