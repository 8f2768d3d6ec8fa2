//! What a filter believes before its first measurement.

use serde::{Deserialize, Serialize};

use super::{PARAMETERS, ParameterCovariance, SIDE_SLIP, Values};
use crate::estimate::Parameter;
use crate::geometry::Pose2;
use crate::settings::{EstimatorSettings, Freedom, Measurement};
use crate::vehicle::Vehicle;

/// Values, doubts and freedoms of the parameters at a filter's start.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Prior {
    /// Values, in the order of [`Parameter::ALL`], the side slip last.
    pub values: Values,
    /// Their covariance.
    pub covariance: ParameterCovariance,
    /// Which values the filter may not change.
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
        if settings.measurement == Measurement::Clone {
            sigma[SIDE_SLIP] = settings.side_slip_sigma_rad_per_mps2;
        }
        Self {
            values,
            covariance: ParameterCovariance::from_diagonal(&sigma.component_mul(&sigma)),
            held: std::array::from_fn(|i| {
                Parameter::ALL
                    .get(i)
                    .is_some_and(|&p| settings.freedom(p) != Freedom::Estimated)
            }),
            random_walk_per_sqrt_s: random_walk(settings),
        }
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
