//! Manoeuvres that would add most about a parameter: the information of each for this robot now, by
//! the filter's own equations.

pub mod manoeuvre;
pub mod ranking;

use nalgebra::Vector3;

use crate::filter::constraint::LidarMotion;
use crate::filter::prediction::PredictedMotion;
use crate::filter::{PARAMETERS, ParameterCovariance, Values, drive_parameters, lidar_in_base};
use crate::motion_noise::MotionNoise;
use crate::settings::EstimatorSettings;
use crate::vehicle::Vehicle;
use manoeuvre::{Manoeuvre, library};

/// Readings in one window of a manoeuvre: 0.6 s, some half a metre.
const WINDOW_READINGS: usize = 12;
/// Noise of the LiDAR's motion over one window: a scan matcher's, at both ends.
const WINDOW_SIGMA: [f64; 3] = [0.003, 0.003, 0.000_7];
/// Way that a manoeuvre costs before it begins, m: short ones are not free.
const APPROACH_M: f64 = 5.0;

/// A manoeuvre with the knowledge that it would add.
#[derive(Debug, Clone, PartialEq)]
pub struct Advice {
    /// The manoeuvre.
    pub manoeuvre: Manoeuvre,
    /// Standard deviations afterwards, in the order of
    /// [`Parameter::ALL`](crate::estimate::Parameter::ALL).
    pub sigma_after: Values,
    /// Their whole covariance.
    pub covariance_after: ParameterCovariance,
}

/// Knowledge of the robot that is to be advised.
#[derive(Debug, Clone, Copy)]
pub struct Knowledge<'a> {
    /// Its vehicle.
    pub vehicle: &'a Vehicle,
    /// Its parameters.
    pub values: &'a Values,
    /// Their covariance.
    pub covariance: &'a ParameterCovariance,
    /// Its settings.
    pub settings: &'a EstimatorSettings,
}

/// Every manoeuvre of the library with the knowledge that it would add, in the library's order.
pub fn advise(knowledge: &Knowledge) -> Vec<Advice> {
    library(knowledge.vehicle)
        .into_iter()
        .filter_map(|manoeuvre| {
            let covariance_after = covariance_after(&manoeuvre, knowledge)?;
            Some(Advice {
                sigma_after: Values::from_fn(|i, _| covariance_after[(i, i)].sqrt()),
                covariance_after,
                manoeuvre,
            })
        })
        .collect()
}

/// `P_after = (P^-1 + sum J' S^-1 J)^-1` over the manoeuvre's windows.
fn covariance_after(manoeuvre: &Manoeuvre, knowledge: &Knowledge) -> Option<ParameterCovariance> {
    let mut information = inverse(knowledge)?;
    let parameters = drive_parameters(knowledge.values);
    let mount = lidar_in_base(knowledge.values);
    let offset_rad = parameters.steering_offset_rad;
    let readings = manoeuvre.readings(knowledge.vehicle);
    let noise: &MotionNoise = &knowledge.settings.motion_noise;
    let sigma = Vector3::from(WINDOW_SIGMA);
    let lidar = nalgebra::Matrix3::from_diagonal(&sigma.component_mul(&sigma));
    for window in readings.chunks(WINDOW_READINGS) {
        let mut motion = PredictedMotion::none();
        let mut twist_at_begin = None;
        for reading in window {
            let mut measured = *reading;
            measured.drive.steering_rad += offset_rad;
            motion.advance(knowledge.vehicle, &parameters, noise, &measured);
            twist_at_begin.get_or_insert(motion.twist);
        }
        let predicted = LidarMotion::new(&mount, &motion.end_in_begin);
        let covariance = predicted.by_body * motion.noise * predicted.by_body.transpose() + lidar;
        let twist_at_begin = twist_at_begin.unwrap_or(motion.twist);
        let jacobian = predicted.by_parameters(&motion, &twist_at_begin, noise);
        let weighted = jacobian.transpose() * covariance.cholesky()?.inverse();
        information += weighted * jacobian;
    }
    Some(information.cholesky()?.inverse())
}

/// Information of the present knowledge. Parameters that are not estimated stay as they are.
fn inverse(knowledge: &Knowledge) -> Option<ParameterCovariance> {
    let mut covariance = *knowledge.covariance;
    for i in 0..PARAMETERS {
        // What is off has no variance.
        covariance[(i, i)] += 1e-16;
    }
    debug_assert_eq!(covariance.nrows(), PARAMETERS);
    Some(covariance.cholesky()?.inverse())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::Parameter;
    use crate::filter::prior::Prior;
    use crate::vehicle::VehicleModel;

    #[test]
    fn straight_driving_does_not_tell_where_the_lidar_sits() {
        let vehicle = Vehicle::new(VehicleModel::Tricycle, 1.5);
        let settings = EstimatorSettings::default();
        let prior = Prior::cold(&vehicle, None, &settings);
        let advice = advise(&Knowledge {
            vehicle: &vehicle,
            values: &prior.values,
            covariance: &prior.covariance,
            settings: &settings,
        });
        let straight = &advice[0];
        assert_eq!(straight.manoeuvre.name, "straight");
        assert!(straight.sigma_after[Parameter::LidarX.index()] > 1.0);
        assert!(straight.sigma_after[Parameter::SteeringOffset.index()] < 0.01);
    }
}
