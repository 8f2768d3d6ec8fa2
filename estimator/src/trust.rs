//! When a number may be trusted: per parameter, with the reason in words.

use serde::{Deserialize, Serialize};

use crate::advice::{Knowledge, advise, best_for};
use crate::estimate::{Parameter, ParameterEstimate, Status};
use crate::filter::{PARAMETERS, ParameterCovariance, Values};
use crate::settings::{EstimatorSettings, Freedom};
use crate::vehicle::Vehicle;

/// A parameter is unobservable while its doubt is above this share of its prior.
const UNOBSERVABLE_SHARE: f64 = 0.5;
/// What is said where no single manoeuvre would help much.
const MORE_DRIVING: &str = "more driving with turns to both sides";
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
        vehicle: &Vehicle,
        settings: &EstimatorSettings,
    ) -> [ParameterEstimate; PARAMETERS] {
        let statuses = Parameter::ALL.map(|parameter| {
            let sigma = reported_sigma(parameter, covariance, settings);
            self.status(parameter, sigma, prior_sigma[parameter.index()], settings)
        });
        let open = |status: &Status| matches!(status, Status::Learning | Status::Unobservable);
        // What to drive is worked out only for a robot that still has to learn something.
        let advice = if statuses.iter().any(open) {
            advise(&Knowledge {
                vehicle,
                values,
                covariance,
                settings,
            })
        } else {
            Vec::new()
        };
        Parameter::ALL.map(|parameter| {
            let i = parameter.index();
            let status = statuses[i];
            let needs = if open(&status) {
                best_for(parameter, covariance[(i, i)].sqrt(), &advice)
                    .map(|best| best.manoeuvre.instruction.clone())
                    .or_else(|| Some(MORE_DRIVING.to_owned()))
            } else {
                None
            };
            ParameterEstimate {
                value: values[i],
                sigma: reported_sigma(parameter, covariance, settings),
                status,
                needs,
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

/// The sigma that leaves the estimator: with what averaging cannot take away.
fn reported_sigma(
    parameter: Parameter,
    covariance: &ParameterCovariance,
    settings: &EstimatorSettings,
) -> f64 {
    let variance = covariance[(parameter.index(), parameter.index())];
    if variance <= 0.0 {
        return 0.0;
    }
    variance
        .sqrt()
        .hypot(*settings.systematic_sigma.get(parameter))
}
