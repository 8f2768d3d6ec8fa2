//! When a number may be trusted: per parameter, with the reason in words.

use serde::{Deserialize, Serialize};

use crate::estimate::{Parameter, ParameterEstimate, Status};
use crate::excitation::Excitation;
use crate::filter::{PARAMETERS, ParameterCovariance, Values};
use crate::settings::{EstimatorSettings, Freedom};

/// A parameter is unobservable while its doubt is above this share of its prior.
const UNOBSERVABLE_SHARE: f64 = 0.5;
/// A converged parameter stays so until its sigma exceeds its limit by this factor.
const HYSTERESIS: f64 = 1.2;

/// The trust a robot's parameters have earned.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Trust {
    converged: [bool; PARAMETERS],
}

impl Trust {
    /// Judges the parameters from what the filter says and what was driven.
    pub fn judge(
        &mut self,
        values: &Values,
        covariance: &ParameterCovariance,
        prior_sigma: &Values,
        excitation: &Excitation,
        settings: &EstimatorSettings,
    ) -> [ParameterEstimate; PARAMETERS] {
        Parameter::ALL.map(|parameter| {
            let i = parameter.index();
            let known = covariance[(i, i)] > 0.0;
            let systematic = if known {
                *settings.systematic_sigma.get(parameter)
            } else {
                0.0
            };
            let sigma = covariance[(i, i)].max(0.0).sqrt().hypot(systematic);
            let status = self.status(parameter, sigma, prior_sigma[i], settings);
            ParameterEstimate {
                value: values[i],
                sigma,
                status,
                needs: needs(parameter, status, excitation),
            }
        })
    }

    fn status(
        &mut self,
        parameter: Parameter,
        sigma: f64,
        prior_sigma: f64,
        settings: &EstimatorSettings,
    ) -> Status {
        match settings.freedom(parameter) {
            Freedom::Off => return Status::Off,
            Freedom::Fixed => return Status::Fixed,
            Freedom::Estimated => {}
        }
        let limit = *settings.converged_sigma.get(parameter);
        let converged = &mut self.converged[parameter.index()];
        *converged = sigma
            <= if *converged {
                limit * HYSTERESIS
            } else {
                limit
            };
        if *converged {
            Status::Converged
        } else if sigma > UNOBSERVABLE_SHARE * prior_sigma {
            Status::Unobservable
        } else {
            Status::Learning
        }
    }

    /// Takes all trust away: the vehicle may not be the one that earned it.
    pub fn withdraw(&mut self) {
        self.converged = [false; PARAMETERS];
    }
}

/// What is missing, as an instruction a driver can follow.
fn needs(parameter: Parameter, status: Status, excitation: &Excitation) -> Option<String> {
    match status {
        Status::Converged | Status::Fixed | Status::Off => None,
        Status::Learning | Status::Unobservable => Some(
            match parameter {
                Parameter::SteeringOffset | Parameter::LidarYaw => excitation.missing_straight(),
                Parameter::SpeedScale => "20 m of driving with turns",
                Parameter::TimeOffset => "driving with changing speed and steering",
                Parameter::LidarX
                | Parameter::LidarY
                | Parameter::Wheelbase
                | Parameter::SteeringGain => excitation.missing_turn(),
            }
            .to_owned(),
        ),
    }
}
