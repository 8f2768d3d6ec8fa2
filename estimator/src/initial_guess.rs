//! A first guess of mount and steering offset, in closed form, from the first informative motions.
//!
//! The filter linearises, so it must start near the truth: a LiDAR may sit metres from the axle and
//! look any way. Over a short window the body moves by `B_i` (from the drive) and the LiDAR by
//! `Z_i` (from its odometry), with `B_i X = X Z_i`. Two steps:
//!
//! 1. The steering offset from yaw alone: both bodies turn by the same angle, whatever the mount.
//! 2. The mount from the translations, `p_i = R(theta_off) t_i + (I - R_i) l`, which is linear in
//!    `(cos theta_off, sin theta_off, x_off, y_off)`; `l` is eliminated and the angle found on the
//!    unit circle (the constraint of Censi et al., TRO 2013).

use nalgebra::{Matrix2, Matrix2x4, Matrix3, Matrix4, Vector2, Vector3, Vector4};

use crate::drive_history::{DriveHistory, DriveSegment};
use crate::estimate::Parameter;
use crate::filter::prediction::PredictedMotion;
use crate::filter::prior::Prior;
use crate::filter::{OdometryReading, ParameterCovariance, Values, drive_parameters};
use crate::geometry::{Pose2, wrap_angle_rad};
use crate::motion_noise::MotionNoise;
use crate::vehicle::{SteeringResponse, Vehicle};

/// Way (m) or turn (rad) after which a window ends.
const WINDOW_M: f64 = 0.5;
const WINDOW_RAD: f64 = 0.3;
/// Fewest windows a guess is made from.
const WINDOWS_MIN: usize = 5;
/// Noise of a window's displacement: a part that is always there, and a share of its length.
/// Several times the real one, so that the guess uses a few hundredths of the data's information,
/// which the filter then uses in full. More uncertainty would do harm: a robot that begins with
/// turns to one side leaves a direction open, the filter wanders along it by its uncertainty,
/// linearises there, and is sure of what it has not seen (y off by 46 mm with a sigma of 3 mm, from
/// a guess that was right to 0.3 mm).
const WINDOW_SIGMA_M: f64 = 0.01;
const WINDOW_SIGMA_SHARE: f64 = 0.02;
/// Noise of a window's turn, rad.
const WINDOW_SIGMA_RAD: f64 = 0.01;
/// Largest sigma of the yaw of a guess that is good enough, rad.
const YAW_SIGMA_MAX_RAD: f64 = 0.05;
/// Excess in cost by which a second orientation must fit worse (in squared sigmas).
const RIVAL_COST_MIN: f64 = 25.0;
/// Number of orientations that are tried around the circle.
const ORIENTATIONS: usize = 360;

/// One window: the LiDAR's motion, and the drive readings over it.
struct Window {
    lidar_motion: Pose2,
    segments: Vec<DriveSegment>,
}

/// Makes the filter's prior from the motions so far; `None` while they show too little.
pub fn initial_guess(
    vehicle: &Vehicle,
    prior: &Prior,
    readings: &[OdometryReading],
    drive: &DriveHistory,
) -> Option<Prior> {
    let windows = cut_windows(readings, drive);
    if windows.len() < WINDOWS_MIN {
        return None;
    }
    // 1. Steering offset from yaw.
    let (values, offset_information) = steering_offset(vehicle, &prior.values, &windows);
    // 2. Mount from translations.
    let (mount, mount_information) = mount(vehicle, &values, prior, &windows)?;

    let mut guess = prior.clone();
    guess.values = values;
    for (parameter, value) in [
        (Parameter::LidarX, mount.x_m),
        (Parameter::LidarY, mount.y_m),
        (Parameter::LidarYaw, wrap_angle_rad(mount.yaw_rad)),
    ] {
        guess.values[parameter.index()] = value;
    }
    guess.covariance = sharpened(&prior.covariance, offset_information, &mount_information)?;
    Some(guess)
}

fn cut_windows(readings: &[OdometryReading], drive: &DriveHistory) -> Vec<Window> {
    let mut windows = Vec::new();
    let mut rest = readings.iter();
    let Some(mut begin) = rest.next() else {
        return windows;
    };
    for reading in rest {
        if !drive.covers(begin.stamp, reading.stamp) {
            begin = reading;
            continue;
        }
        let lidar_motion = begin.lidar_in_odom.between(&reading.lidar_in_odom);
        let segments: Vec<_> = drive
            .segments(begin.stamp, reading.stamp, SteeringResponse::default())
            .collect();
        let driven_m: f64 = segments
            .iter()
            .map(|s| s.drive.speed_mps.abs() * s.duration_s)
            .sum();
        if driven_m >= WINDOW_M || lidar_motion.yaw_rad.abs() >= WINDOW_RAD {
            windows.push(Window {
                lidar_motion,
                segments,
            });
            begin = reading;
        }
    }
    windows
}

/// Gauss-Newton on the one unknown of `sum of (turn_i(delta_off) - turn_i of the LiDAR)^2`.
fn steering_offset(vehicle: &Vehicle, start: &Values, windows: &[Window]) -> (Values, f64) {
    let index = Parameter::SteeringOffset.index();
    let mut values = *start;
    let mut information = 0.0;
    for _ in 0..8 {
        let mut gradient = 0.0;
        information = 0.0;
        for window in windows {
            let motion = predict(vehicle, &values, window);
            let residual =
                wrap_angle_rad(window.lidar_motion.yaw_rad - motion.end_in_begin.yaw_rad);
            let slope = motion.by_parameters[(2, 0)];
            let weight = 1.0 / (WINDOW_SIGMA_RAD.powi(2) + (0.1 * residual).powi(2));
            gradient += weight * slope * residual;
            information += weight * slope * slope;
        }
        if information <= 0.0 {
            break;
        }
        values[index] = (values[index] + gradient / information).clamp(-0.5, 0.5);
    }
    (values, information)
}

fn predict(vehicle: &Vehicle, values: &Values, window: &Window) -> PredictedMotion {
    let parameters = drive_parameters(values);
    let noise = MotionNoise::default();
    let mut motion = PredictedMotion::none();
    for segment in &window.segments {
        motion.advance(vehicle, &parameters, &noise, segment);
    }
    motion
}

/// The mount and its information matrix over (x, y, yaw), without the prior's.
fn mount(
    vehicle: &Vehicle,
    values: &Values,
    prior: &Prior,
    windows: &[Window],
) -> Option<(Pose2, Matrix3<f64>)> {
    let mut normal = Matrix4::<f64>::zeros();
    let mut right = Vector4::<f64>::zeros();
    for window in windows {
        let body = predict(vehicle, values, window).end_in_begin;
        let t = window.lidar_motion.translation();
        let turn = Pose2::new(0.0, 0.0, window.lidar_motion.yaw_rad).rotation();
        let lever = Matrix2::identity() - turn;
        let row = Matrix2x4::new(
            t.x, -t.y, lever.m11, lever.m12, //
            t.y, t.x, lever.m21, lever.m22,
        );
        let sigma = WINDOW_SIGMA_M + WINDOW_SIGMA_SHARE * body.translation().norm();
        let weight = 1.0 / (sigma * sigma);
        normal += row.transpose() * row * weight;
        right += row.transpose() * body.translation() * weight;
    }

    // The lever's prior makes it solvable where the robot has only driven straight.
    let x = Parameter::LidarX.index();
    let lever_prior = prior.covariance.fixed_view::<2, 2>(x, x).try_inverse()?;
    let lever_values = prior.values.fixed_rows::<2>(x).into_owned();
    let lever_normal = normal.fixed_view::<2, 2>(2, 2) + lever_prior;
    let lever_right = right.fixed_rows::<2>(2) + lever_prior * lever_values;
    let lever_inverse = lever_normal.try_inverse()?;
    let coupling = normal.fixed_view::<2, 2>(2, 0).into_owned();
    let reduced = normal.fixed_view::<2, 2>(0, 0) - coupling.transpose() * lever_inverse * coupling;
    let reduced_right =
        right.fixed_rows::<2>(0) - coupling.transpose() * lever_inverse * lever_right;

    let yaw_rad = best_orientation(&reduced, &reduced_right)?;
    let direction = Vector2::new(yaw_rad.cos(), yaw_rad.sin());
    let lever = lever_inverse * (lever_right - coupling * direction);

    // Information over (x, y, yaw): the direction's derivative by yaw is its perpendicular.
    let across = Vector2::new(-yaw_rad.sin(), yaw_rad.cos());
    let with_yaw = coupling * across;
    let mut information = Matrix3::zeros();
    information
        .fixed_view_mut::<2, 2>(0, 0)
        .copy_from(&normal.fixed_view::<2, 2>(2, 2));
    information
        .fixed_view_mut::<2, 1>(0, 2)
        .copy_from(&with_yaw);
    information
        .fixed_view_mut::<1, 2>(2, 0)
        .copy_from(&with_yaw.transpose());
    information[(2, 2)] = across.dot(&(normal.fixed_view::<2, 2>(0, 0) * across));
    Some((Pose2::new(lever.x, lever.y, yaw_rad), information))
}

/// Minimises `q' M q - 2 g' q` over the unit circle; `None` when the minimum is flat or not alone.
fn best_orientation(m: &Matrix2<f64>, g: &Vector2<f64>) -> Option<f64> {
    let cost = |yaw: f64| {
        let q = Vector2::new(yaw.cos(), yaw.sin());
        q.dot(&(m * q)) - 2.0 * g.dot(&q)
    };
    let step = std::f64::consts::TAU / ORIENTATIONS as f64;
    let costs: Vec<f64> = (0..ORIENTATIONS).map(|i| cost(i as f64 * step)).collect();
    let best = (0..ORIENTATIONS).min_by(|&a, &b| costs[a].total_cmp(&costs[b]))?;
    let rival = (0..ORIENTATIONS)
        .filter(|&i| is_local_minimum(&costs, i) && far_apart(i, best))
        .map(|i| costs[i])
        .fold(f64::INFINITY, f64::min);
    if rival - costs[best] < RIVAL_COST_MIN {
        return None;
    }
    let mut yaw = best as f64 * step;
    for _ in 0..5 {
        let h = 1e-4;
        let slope = (cost(yaw + h) - cost(yaw - h)) / (2.0 * h);
        let curvature = (cost(yaw + h) - 2.0 * cost(yaw) + cost(yaw - h)) / (h * h);
        if curvature <= 0.0 {
            return None;
        }
        // Half the curvature is the information on yaw.
        if (2.0 / curvature).sqrt() > YAW_SIGMA_MAX_RAD {
            return None;
        }
        yaw -= (slope / curvature).clamp(-step, step);
    }
    Some(yaw)
}

fn is_local_minimum(costs: &[f64], i: usize) -> bool {
    let n = costs.len();
    costs[i] <= costs[(i + 1) % n] && costs[i] <= costs[(i + n - 1) % n]
}

fn far_apart(i: usize, j: usize) -> bool {
    let apart = i.abs_diff(j);
    apart.min(ORIENTATIONS - apart) > ORIENTATIONS / 36
}

/// The prior's covariance sharpened by the windows.
fn sharpened(
    prior: &ParameterCovariance,
    offset_information: f64,
    mount_information: &Matrix3<f64>,
) -> Option<ParameterCovariance> {
    let mut covariance = *prior;
    let offset = Parameter::SteeringOffset.index();
    let variance = prior[(offset, offset)];
    covariance[(offset, offset)] = variance / (1.0 + variance * offset_information);

    let x = Parameter::LidarX.index();
    let mount_prior = prior.fixed_view::<3, 3>(x, x).into_owned();
    let sharpened = (mount_prior.try_inverse()? + mount_information).try_inverse()?;
    covariance
        .fixed_view_mut::<3, 3>(x, x)
        .copy_from(&sharpened);
    Some(covariance)
}

/// True if a nominal mount is plausible beside a guess that did not use it: within four sigmas.
pub fn agrees_with(nominal: &Prior, guess: &Prior) -> bool {
    let x = Parameter::LidarX.index();
    let mut apart: Vector3<f64> =
        guess.values.fixed_rows::<3>(x) - nominal.values.fixed_rows::<3>(x);
    apart.z = wrap_angle_rad(apart.z);
    let covariance =
        nominal.covariance.fixed_view::<3, 3>(x, x) + guess.covariance.fixed_view::<3, 3>(x, x);
    covariance
        .cholesky()
        .is_some_and(|factor| apart.dot(&factor.solve(&apart)) < 16.0)
}
