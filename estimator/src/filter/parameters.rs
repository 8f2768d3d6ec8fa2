//! State of the filter: the parameters of a calibration and those of the vehicle beyond, their
//! places, and the vehicle model's parameters made of them.

use nalgebra::{SMatrix, SVector};

use crate::estimate::Parameter;
use crate::geometry::{Pose2, wrap_angle_rad};
use crate::vehicle::{BY_SPEED_LEAD, DriveParameters, SteeringCurve, SteeringResponse};

/// Number of parameters in the filter: those of [`Parameter::ALL`], the side slip, and the steering's
/// asymmetry, quadratic and cubic term, the lag and spread of its response, and half its play.
pub const PARAMETERS: usize = Parameter::ALL.len() + 7;
/// Index of the side slip among them. It is no calibration and is not published, but its
/// uncertainty goes into `x_off`: at a speed `v` it shifts the LiDAR by `-c |v| v`.
pub const SIDE_SLIP: usize = Parameter::ALL.len();
/// Index of the steering's asymmetry among them.
pub const ASYMMETRY: usize = SIDE_SLIP + 1;
/// Index of the quadratic term of the steering among them.
pub const QUADRATIC: usize = SIDE_SLIP + 2;
/// Index of the cubic term of the steering among them.
pub const CUBIC: usize = SIDE_SLIP + 3;
/// Index of the steering's lag behind its sensor among them.
pub const STEERING_LAG: usize = SIDE_SLIP + 4;
/// Index of the spread of the steering's response among them.
pub const STEERING_SPREAD: usize = SIDE_SLIP + 5;
/// Index of half the play of the steering among them.
pub const STEERING_PLAY: usize = SIDE_SLIP + 6;
/// Indices of what the steering has beyond its offset, with its response and play.
pub const CURVE: [usize; 7] = [
    Parameter::SteeringGain.index(),
    ASYMMETRY,
    QUADRATIC,
    CUBIC,
    STEERING_LAG,
    STEERING_SPREAD,
    STEERING_PLAY,
];
/// Indices of the parameters, in the order in which checkpoints hold them: that in which they came
/// to be known. Stored numbers have no names but their place, so a new one comes last here,
/// published or not.
pub(super) const STORED: [usize; PARAMETERS] = [
    Parameter::SteeringOffset.index(),
    Parameter::LidarX.index(),
    Parameter::LidarY.index(),
    Parameter::LidarYaw.index(),
    Parameter::SpeedScale.index(),
    Parameter::Wheelbase.index(),
    Parameter::TimeOffset.index(),
    Parameter::SteeringGain.index(),
    SIDE_SLIP,
    ASYMMETRY,
    QUADRATIC,
    CUBIC,
    STEERING_LAG,
    STEERING_SPREAD,
    STEERING_PLAY,
];
/// Largest lag of a wheel behind its sensor, or before it, s.
const STEERING_LAG_MAX_S: f64 = 0.5;
/// Largest spread of its response, s^2.
const STEERING_SPREAD_MAX_S2: f64 = 0.25;
/// Indices of the drive parameters among the parameters.
pub const DRIVE_PARAMETER: [usize; BY_SPEED_LEAD] = [
    Parameter::SteeringOffset.index(),
    Parameter::SpeedScale.index(),
    Parameter::Wheelbase.index(),
    Parameter::SteeringGain.index(),
    SIDE_SLIP,
    ASYMMETRY,
    QUADRATIC,
    CUBIC,
    STEERING_LAG,
    STEERING_SPREAD,
    STEERING_PLAY,
];

/// Values of the parameters, in the order of [`Parameter::ALL`], then those of the vehicle beyond.
pub type Values = SVector<f64, PARAMETERS>;
/// Their covariance.
pub type ParameterCovariance = SMatrix<f64, PARAMETERS, PARAMETERS>;

/// `values - from`, the yaw the short way round.
pub fn apart(values: &Values, from: &Values) -> Values {
    let mut apart = values - from;
    let yaw = &mut apart[Parameter::LidarYaw.index()];
    *yaw = wrap_angle_rad(*yaw);
    apart
}

/// `lidar_in_base` out of the parameters.
pub fn lidar_in_base(values: &Values) -> Pose2 {
    Pose2::new(
        values[Parameter::LidarX.index()],
        values[Parameter::LidarY.index()],
        values[Parameter::LidarYaw.index()],
    )
}

/// The steering's response as far as readings include it: samples are kept and awaited for that
/// long, and a sensor's smoothing cannot be undone.
pub fn steering_response(values: &Values) -> SteeringResponse {
    SteeringResponse {
        lag_s: values[STEERING_LAG].clamp(-STEERING_LAG_MAX_S, STEERING_LAG_MAX_S),
        spread_s2: values[STEERING_SPREAD].clamp(0.0, STEERING_SPREAD_MAX_S2),
    }
}

/// The vehicle model's parameters out of the parameters.
pub fn drive_parameters(values: &Values) -> DriveParameters {
    DriveParameters {
        steering_offset_rad: values[Parameter::SteeringOffset.index()],
        speed_scale: values[Parameter::SpeedScale.index()],
        wheelbase_m: values[Parameter::Wheelbase.index()],
        steering_gain: values[Parameter::SteeringGain.index()],
        side_slip_rad_per_mps2: values[SIDE_SLIP],
        curve: SteeringCurve {
            asymmetry: values[ASYMMETRY],
            quadratic_per_rad: values[QUADRATIC],
            cubic_per_rad2: values[CUBIC],
        },
        response: SteeringResponse {
            lag_s: values[STEERING_LAG],
            spread_s2: values[STEERING_SPREAD],
        },
        half_play_rad: values[STEERING_PLAY],
    }
}
