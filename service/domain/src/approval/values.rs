//! Differences between calibration values, and their limits.

use std::f64::consts::TAU;

use fleetcal_model::{Parameter, ParameterStatus, Pose2};
use fleetcal_proto::calibration::CalibrationValues;
use fleetcal_proto::estimate::{EstimateDocument, ParameterDocument};

/// Difference between two calibrations: steering offset (rad), LiDAR x (m), y (m), yaw (rad).
pub type Change = [f64; 4];

/// Difference `to` minus `from`; the heading's takes the shorter way round.
pub fn difference(from: &CalibrationValues, to: &CalibrationValues) -> Change {
    let yaw_rad = (to.lidar_yaw_rad - from.lidar_yaw_rad).rem_euclid(TAU);
    [
        to.steering_offset_rad - from.steering_offset_rad,
        to.lidar_x_m - from.lidar_x_m,
        to.lidar_y_m - from.lidar_y_m,
        if yaw_rad > TAU / 2.0 {
            yaw_rad - TAU
        } else {
            yaw_rad
        },
    ]
}

/// Sum of the magnitudes of steps with one more.
pub(super) fn added(sum: &Change, step: &Change) -> Change {
    std::array::from_fn(|part| sum[part] + step[part].abs())
}

/// Smallest change of a scale, of the wheelbase in metres, and of a delay in seconds, that counts
/// as a large one.
const SCALE_CHANGE_MAX: f64 = 0.03;
const WHEELBASE_CHANGE_MAX_M: f64 = 0.03;
const DELAY_CHANGE_MAX_S: f64 = 0.1;

/// True if a value beside the four of a [`Change`] changes considerably. A robot that has reported
/// no scale or delay uses none; its wheelbase is unknown.
pub(super) fn differs_beside(from: &CalibrationValues, to: &CalibrationValues) -> bool {
    type Part = fn(&CalibrationValues) -> Option<f64>;
    let far = |part: Part, none: f64, most: f64| {
        let before = part(from).unwrap_or(none);
        part(to).is_some_and(|value| (value - before).abs() > most)
    };
    let wheelbase = to.wheelbase_m.is_some_and(|value| {
        let before = from.wheelbase_m;
        before.is_none_or(|before| (value - before).abs() > WHEELBASE_CHANGE_MAX_M)
    });
    wheelbase
        || far(|values| values.speed_scale, 1.0, SCALE_CHANGE_MAX)
        || far(|values| values.steering_gain, 1.0, SCALE_CHANGE_MAX)
        || far(|values| values.time_offset_s, 0.0, DELAY_CHANGE_MAX_S)
}

/// Values of a [`Change`], in its order.
pub(super) fn four(values: &CalibrationValues) -> [f64; 4] {
    [
        values.steering_offset_rad,
        values.lidar_x_m,
        values.lidar_y_m,
        values.lidar_yaw_rad,
    ]
}

/// True if any part of a change exceeds its limit.
pub fn exceeds(change: &Change, limits: &[f64; 4]) -> bool {
    change
        .iter()
        .zip(limits)
        .any(|(part, limit)| part.abs() > *limit)
}

/// True if any part of a change exceeds both its limit and `sigmas` times its sigma.
pub(super) fn exceeds_significantly(
    change: &Change,
    limits: &[f64; 4],
    sigma: &[f64; 4],
    sigmas: f64,
) -> bool {
    let parts = change.iter().zip(limits).zip(sigma);
    parts
        .into_iter()
        .any(|((part, limit), sigma)| part.abs() > *limit && part.abs() > sigmas * sigma)
}

/// Values of a robot that is built by its drawing: a steering offset of zero, and the LiDAR's pose
/// from CAD.
pub fn nominal_values(lidar_in_base: &Pose2) -> CalibrationValues {
    CalibrationValues {
        steering_offset_rad: 0.0,
        lidar_x_m: lidar_in_base.x_m,
        lidar_y_m: lidar_in_base.y_m,
        lidar_yaw_rad: lidar_in_base.yaw_rad,
        ..CalibrationValues::default()
    }
}

/// Values of an estimate and their sigmas; `None` while one of the four that every robot needs is
/// unknown.
pub fn values_and_sigmas(
    estimate: &EstimateDocument,
) -> Option<(CalibrationValues, CalibrationValues)> {
    let known = |name: Parameter| {
        let parameter = estimate.parameters.get(name);
        matches!(
            parameter.status,
            ParameterStatus::Converged | ParameterStatus::Fixed
        )
        .then_some(parameter)
    };
    let steering = known(Parameter::SteeringOffset)?;
    let x = known(Parameter::LidarX)?;
    let y = known(Parameter::LidarY)?;
    let yaw = known(Parameter::LidarYaw)?;
    let estimated = |name: Parameter| {
        let parameter = estimate.parameters.get(name);
        (parameter.status == ParameterStatus::Converged).then_some(parameter)
    };
    let collect = |part: fn(&ParameterDocument) -> f64| CalibrationValues {
        steering_offset_rad: part(steering),
        lidar_x_m: part(x),
        lidar_y_m: part(y),
        lidar_yaw_rad: part(yaw),
        speed_scale: estimated(Parameter::SpeedScale).map(part),
        wheelbase_m: estimated(Parameter::Wheelbase).map(part),
        steering_gain: estimated(Parameter::SteeringGain).map(part),
        time_offset_s: estimated(Parameter::TimeOffset).map(part),
    };
    Some((collect(|p| p.value), collect(|p| p.sigma)))
}
