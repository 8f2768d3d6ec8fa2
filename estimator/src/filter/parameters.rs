//! State of the filter: the parameters of a calibration and what a vehicle does beyond, where each stands,
//! and what the vehicle model makes of them.

use nalgebra::{SMatrix, SVector};

use crate::estimate::Parameter;
use crate::geometry::{Pose2, wrap_angle_rad};
use crate::vehicle::{BY_SPEED_LEAD, DriveParameters, SteeringCurve, SteeringResponse};

/// Number of parameters in the filter: those of [`Parameter::ALL`], the side slip, and the steering's
/// asymmetry, quadratic and cubic term, the lag and spread of its response, and half its play.
pub const PARAMETERS: usize = Parameter::ALL.len() + 7;
/// Where the side slip stands among them. It is no calibration and is not published, but what is not
/// known of it goes into `x_off`: at a speed `v` it shifts the LiDAR by `-c |v| v`.
pub const SIDE_SLIP: usize = Parameter::ALL.len();
/// Where the steering's asymmetry stands among them.
pub const ASYMMETRY: usize = SIDE_SLIP + 1;
/// Where the quadratic term of the steering stands among them.
pub const QUADRATIC: usize = SIDE_SLIP + 2;
/// Where the cubic term of the steering stands among them.
pub const CUBIC: usize = SIDE_SLIP + 3;
/// Where the steering's lag behind its sensor stands among them.
pub const STEERING_LAG: usize = SIDE_SLIP + 4;
/// Where the spread of the steering's response stands among them.
pub const STEERING_SPREAD: usize = SIDE_SLIP + 5;
/// Where half the play of the steering stands among them.
pub const STEERING_PLAY: usize = SIDE_SLIP + 6;
/// Where the parameters stand, in the order in which checkpoints hold them: that in which they came to be known.
/// Stored numbers have no names but their place, so a new one comes last here, published or not.
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
/// No wheel is further behind its sensor, or before it, s.
const STEERING_LAG_MAX_S: f64 = 0.5;
/// Nor is its response wider, s^2.
const STEERING_SPREAD_MAX_S2: f64 = 0.25;
/// Where the drive parameters stand among the parameters.
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

/// Values of the parameters, in the order of [`Parameter::ALL`], then what the vehicle does beyond.
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

/// The steering's response as far as readings take it in: samples are kept and waited for that long,
/// and what a sensor smoothed cannot be made out of it again.
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
