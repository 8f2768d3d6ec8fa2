//! Prior of a filter, before its first measurement.

use serde::{Deserialize, Serialize};

use super::{
    ASYMMETRY, CUBIC, PARAMETERS, ParameterCovariance, QUADRATIC, SIDE_SLIP, STEERING_LAG,
    STEERING_PLAY, STEERING_SPREAD, Values,
};
use crate::estimate::Parameter;
use crate::geometry::Pose2;
use crate::settings::{EstimatorSettings, Freedom};
use crate::vehicle::Vehicle;

/// Sigma of the asymmetry, typical by docs/assumptions.md: the gain differs by 1 % between left and
/// right.
pub(crate) const ASYMMETRY_SIGMA: f64 = 0.01;
/// Sigma of the quadratic term, typical there: the curve departs by 0.3 degrees at 20 degrees,
/// 1/rad,
pub(crate) const QUADRATIC_SIGMA_PER_RAD: f64 = 0.043;
/// and of the cubic term, 1/rad^2.
pub(crate) const CUBIC_SIGMA_PER_RAD2: f64 = 0.12;
/// Sigma of the steering's lag: the wheel is a tenth of a second behind its sensor, or before it,
/// s.
pub(crate) const STEERING_LAG_SIGMA_S: f64 = 0.1;
/// Sigma of its spread: a response as wide as that of a first-order lag of a tenth of a second,
/// s^2.
pub(crate) const STEERING_SPREAD_SIGMA_S2: f64 = 0.01;
/// Sigma of half the play: a quarter of a degree, rad.
pub(crate) const STEERING_PLAY_SIGMA_RAD: f64 = 0.0044;

/// Values, uncertainties and freedoms of the parameters at a filter's start.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Prior {
    /// Values, in the order of [`Parameter::ALL`], then those of the vehicle beyond.
    pub values: Values,
    /// Their covariance.
    pub covariance: ParameterCovariance,
    /// True for each value that the filter may not change.
    pub held: [bool; PARAMETERS],
    /// Slow drift, standard deviation per root second.
    pub random_walk_per_sqrt_s: Values,
}

impl Prior {
    /// The prior of a robot that has never driven: nominal values where there are any.
    ///
    /// The LiDAR's yaw has no useful prior without a nominal mount; the closed-form guess finds it
    /// before the filter starts.
    pub fn cold(
        vehicle: &Vehicle,
        nominal_lidar_in_base: Option<Pose2>,
        settings: &EstimatorSettings,
    ) -> Self {
        let mount = nominal_lidar_in_base.unwrap_or(Pose2::IDENTITY);
        let mut values = Values::zeros();
        let mut sigma = Values::zeros();
        for parameter in Parameter::ALL {
            let i = parameter.index();
            values[i] = match parameter {
                Parameter::LidarX => mount.x_m,
                Parameter::LidarY => mount.y_m,
                Parameter::LidarYaw => mount.yaw_rad,
                Parameter::SpeedScale | Parameter::SteeringGain => 1.0,
                Parameter::Wheelbase => vehicle.wheelbase_m,
                Parameter::SteeringOffset | Parameter::TimeOffset => 0.0,
            };
            sigma[i] = match (parameter, nominal_lidar_in_base) {
                (Parameter::LidarX | Parameter::LidarY, None) => settings.unknown_mount_sigma_m,
                (Parameter::LidarYaw, None) => std::f64::consts::PI,
                (Parameter::Wheelbase, _) => settings.prior_sigma.wheelbase * vehicle.wheelbase_m,
                _ => *settings.prior_sigma.get(parameter),
            };
            if settings.freedom(parameter) == Freedom::Off {
                sigma[i] = 0.0;
            }
        }
        sigma[SIDE_SLIP] = settings.side_slip_sigma_rad_per_mps2;
        sigma[STEERING_LAG] = STEERING_LAG_SIGMA_S;
        sigma[STEERING_SPREAD] = STEERING_SPREAD_SIGMA_S2;
        sigma[STEERING_PLAY] = STEERING_PLAY_SIGMA_RAD;
        open_curve(&mut sigma, vehicle, settings);
        Self {
            values,
            covariance: ParameterCovariance::from_diagonal(&sigma.component_mul(&sigma)),
            held: std::array::from_fn(|i| {
                Parameter::ALL
                    .get(i)
                    .is_some_and(|&p| is_held(p, vehicle, settings))
            }),
            random_walk_per_sqrt_s: random_walk(settings),
        }
    }
}

/// True if an unpublished gain is a state all the same, which it is unless a free wheelbase takes
/// its part: no linkage is without one.
fn has_hidden_gain(vehicle: &Vehicle, settings: &EstimatorSettings) -> bool {
    vehicle.has_linkage()
        && settings.freedom(Parameter::SteeringGain) == Freedom::Off
        && settings.freedom(Parameter::Wheelbase) != Freedom::Estimated
}

fn is_held(parameter: Parameter, vehicle: &Vehicle, settings: &EstimatorSettings) -> bool {
    let is_hidden = parameter == Parameter::SteeringGain && has_hidden_gain(vehicle, settings);
    settings.freedom(parameter) != Freedom::Estimated && !is_hidden
}

/// The uncertainties of the steering's curve.
fn open_curve(sigma: &mut Values, vehicle: &Vehicle, settings: &EstimatorSettings) {
    if has_hidden_gain(vehicle, settings) {
        sigma[Parameter::SteeringGain.index()] = settings.prior_sigma.steering_gain;
    }
    if vehicle.has_linkage() {
        sigma[ASYMMETRY] = ASYMMETRY_SIGMA;
        sigma[QUADRATIC] = QUADRATIC_SIGMA_PER_RAD;
        sigma[CUBIC] = CUBIC_SIGMA_PER_RAD2;
    }
}

fn random_walk(settings: &EstimatorSettings) -> Values {
    Values::from_fn(|i, _| match Parameter::ALL.get(i) {
        Some(&p) if settings.freedom(p) == Freedom::Estimated => {
            settings.drift_per_sqrt_hour.get(p) / 60.0
        }
        _ => 0.0,
    })
}
