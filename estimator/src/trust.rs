//! Trust in a number: a status per parameter, with the reason in words.

use serde::{Deserialize, Serialize};

use crate::advice::Knowledge;
use crate::advice::ranking::{first_for, rank};
use crate::claim::Claim;
use crate::claim::withheld::{Findings, Withheld};
use crate::estimate::{Parameter, ParameterEstimate, ParameterEstimates, SigmaSource, Status};
use crate::filter::{ParameterCovariance, Values, padded};
use crate::settings::{EstimatorSettings, Freedom};
use crate::stream::RobotTime;

/// Parameters that are reported.
const REPORTED: usize = Parameter::ALL.len();
/// Share of its prior above which the uncertainty of a parameter makes it unobservable.
const UNOBSERVABLE_SHARE: f64 = 0.5;
/// Need where no single manoeuvre would help much.
const MORE_DRIVING: &str = "more driving with turns to both sides";
/// Need of a LiDAR's `y` that no driving distinguishes from the place where the speed is measured.
const SPEED_PLACE: &str = "speed_measured_at in the configuration with a rear_wheel and its lateral_m (0 for \
    the axle's middle): no driving tells where the speed is measured";
/// Same need while the vehicle has turned to one side alone, where the steering's curve hides it.
const OTHER_SIDE_OR_SPEED_PLACE: &str = "more driving with turns to both sides, or speed_measured_at in the \
    configuration with a rear_wheel and its lateral_m (0 for the axle's middle)";
/// One-sidedness ([`crate::excitation::Excitation::one_sidedness`]) from which on a vehicle has
/// turned to one side alone.
const ONE_SIDED: f64 = 0.5;
/// Time for which an instruction stands before it is computed again, s of message time.
const ADVICE_HOLDS_S: f64 = 10.0;
/// Part of its limit within which a value that was beyond it must come to be believed again.
const RELEASE_SHARE: f64 = 0.93;
/// Factor of its limit that the sigma of a converged parameter must exceed to end that.
const HYSTERESIS: f64 = 1.2;

/// The trust a robot's parameters have earned.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Trust {
    #[serde(deserialize_with = "padded::published")]
    converged: [bool; Parameter::ALL.len()],
    /// Values beyond the limits of a vehicle.
    #[serde(deserialize_with = "padded::published")]
    impossible: [bool; Parameter::ALL.len()],
    advised: Option<Advised>,
}

/// Needs that were published last. Computing them takes as long as ten scans, so they are repeated
/// for a while.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Advised {
    at: RobotTime,
    statuses: [Status; REPORTED],
    needs: [Option<String>; REPORTED],
}

/// Grounds of a judgement.
#[derive(Debug, Clone, Copy)]
pub struct Grounds<'a> {
    /// The time it is made at.
    pub now: RobotTime,
    /// Uncertainties before the first metre.
    pub prior_sigma: &'a Values,
    /// Knowledge of the robot now.
    pub knowledge: Knowledge<'a>,
    /// Parameters of which a change would go unseen.
    pub blind: [bool; REPORTED],
    /// True if scans are made of points without times.
    pub lacks_beam_times: bool,
    /// True if steering angles are sent that the vehicle cannot have.
    pub has_impossible_steering: bool,
    /// Claim that is judged.
    pub claim: &'a Claim,
    /// Degree to which its turns went to one side alone, 0 to 1.
    pub one_sidedness: f64,
}

impl Grounds<'_> {
    /// Covariance without the part that no driving shows.
    fn driven_covariance(&self) -> ParameterCovariance {
        let mut covariance = *self.knowledge.covariance;
        let y = Parameter::LidarY.index();
        covariance[(y, y)] -= self.claim.encoder_variance().total_m2();
        covariance
    }

    /// Need of a parameter that no single manoeuvre meets; `None` where one does.
    fn waits_for(&self, parameter: Parameter) -> Option<&'static str> {
        let yaw = Parameter::LidarYaw.index();
        let circling_rad2 = self
            .claim
            .variance_of(SigmaSource::Circling, Parameter::LidarYaw);
        let has_circled = circling_rad2 > 0.5 * self.knowledge.covariance[(yaw, yaw)];
        match parameter {
            Parameter::LidarYaw if has_circled => Some(MORE_DRIVING),
            Parameter::LidarY if self.is_open_by(self.claim.encoder_variance().total_m2()) => {
                Some(if self.one_sidedness > ONE_SIDED {
                    OTHER_SIDE_OR_SPEED_PLACE
                } else if self.is_open_by(self.claim.encoder_variance().undriven_m2()) {
                    SPEED_PLACE
                } else {
                    MORE_DRIVING
                })
            }
            _ => None,
        }
    }

    /// True if this much of the variance of the LiDAR's `y`, m², is most of it, and too much by
    /// itself.
    fn is_open_by(&self, variance_m2: f64) -> bool {
        let y = Parameter::LidarY.index();
        let limit_m = *self
            .knowledge
            .settings
            .converged_sigma
            .get(Parameter::LidarY);
        variance_m2 > limit_m * limit_m && variance_m2 > 0.5 * self.knowledge.covariance[(y, y)]
    }
}

impl Trust {
    /// Judges the parameters.
    pub fn judge(&mut self, grounds: &Grounds) -> ParameterEstimates {
        let Knowledge {
            values, settings, ..
        } = grounds.knowledge;
        for parameter in Parameter::ALL {
            self.limit(parameter, values[parameter.index()], settings);
        }
        let withheld = self.withheld(grounds);
        let statuses = Parameter::ALL.map(|parameter| {
            let i = parameter.index();
            let sigma = grounds.claim.judged_sigma(parameter);
            let status = self.status(parameter, sigma, grounds.prior_sigma[i], settings);
            match status {
                Status::Converged if withheld[i].is_some() => Status::Learning,
                status => status,
            }
        });
        let needs = self.needs(grounds, statuses, withheld);
        Parameter::ALL.map(|parameter| {
            let i = parameter.index();
            let (value, sigma) = if statuses[i] == Status::Off {
                // What is not estimated is told as the neutral value, even if the filter knows better.
                (neutral(parameter, values[i]), 0.0)
            } else {
                (values[i], grounds.claim.sigma(parameter))
            };
            ParameterEstimate {
                value,
                sigma,
                status: statuses[i],
                needs: needs[i].clone(),
            }
        })
    }

    /// Needs, as instructions a driver can follow.
    fn needs(
        &mut self,
        grounds: &Grounds,
        statuses: [Status; REPORTED],
        withheld: [Option<Withheld>; REPORTED],
    ) -> [Option<String>; REPORTED] {
        let fresh = self.advised.as_ref().filter(|advised| {
            let age_s = grounds.now.seconds_since(advised.at);
            advised.statuses == statuses && (0.0..ADVICE_HOLDS_S).contains(&age_s)
        });
        if let Some(advised) = fresh {
            return advised.needs.clone();
        }
        let open = |status: &Status| matches!(status, Status::Learning | Status::Unobservable);
        // What to drive is worked out only for a robot that still has to learn something.
        let covariance = grounds.driven_covariance();
        let ranked = if statuses.iter().any(open) {
            let knowledge = Knowledge {
                covariance: &covariance,
                ..grounds.knowledge
            };
            rank(&knowledge, None)
        } else {
            Vec::new()
        };
        let needs = Parameter::ALL.map(|parameter| {
            let i = parameter.index();
            if !open(&statuses[i]) {
                return None;
            }
            let waits_for = withheld[i].and_then(Withheld::needs);
            if let Some(waits_for) = waits_for.or_else(|| grounds.waits_for(parameter)) {
                return Some(waits_for.to_owned());
            }
            let sigma_now = covariance[(i, i)].sqrt();
            let first = first_for(parameter, sigma_now, &ranked);
            Some(first.map_or_else(
                || MORE_DRIVING.to_owned(),
                |first| first.manoeuvre.instruction.clone(),
            ))
        });
        self.advised = Some(Advised {
            at: grounds.now,
            statuses,
            needs: needs.clone(),
        });
        needs
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
        if self.impossible[parameter.index()] {
            self.converged[parameter.index()] = false;
            return Status::Learning;
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

    /// Notes a value that no vehicle has, until it is well inside the limits again.
    fn limit(&mut self, parameter: Parameter, value: f64, settings: &EstimatorSettings) {
        let neutral = match parameter {
            Parameter::SpeedScale | Parameter::SteeringGain => 1.0,
            _ => 0.0,
        };
        let limit = *settings.physical_limit.get(parameter);
        let impossible = &mut self.impossible[parameter.index()];
        let bound = if *impossible {
            limit * RELEASE_SHARE
        } else {
            limit
        };
        *impossible = (value - neutral).abs() > bound;
    }

    /// The reason for which each parameter is withheld.
    fn withheld(&self, grounds: &Grounds) -> [Option<Withheld>; REPORTED] {
        let is_impossible =
            grounds.has_impossible_steering || self.holds_impossible(grounds.knowledge.settings);
        Parameter::ALL.map(|parameter| {
            let findings = Findings {
                is_impossible,
                lacks_beam_times: grounds.lacks_beam_times,
                is_blind: grounds.blind[parameter.index()],
            };
            Withheld::of(parameter, findings)
        })
    }

    /// True if a parameter that is estimated has a value that no vehicle has.
    fn holds_impossible(&self, settings: &EstimatorSettings) -> bool {
        let mut estimated = Parameter::ALL
            .into_iter()
            .filter(|&parameter| settings.freedom(parameter) == Freedom::Estimated);
        estimated.any(|parameter| self.impossible[parameter.index()])
    }

    /// Removes all trust: the vehicle may not be the one that earned it.
    pub fn withdraw(&mut self) {
        self.converged = [false; Parameter::ALL.len()];
    }
}

/// Value of a parameter that is off.
fn neutral(parameter: Parameter, value: f64) -> f64 {
    match parameter {
        Parameter::SteeringGain => 1.0,
        _ => value,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::{Vehicle, VehicleModel};

    #[test]
    fn a_value_beyond_its_limit_is_not_believed_until_it_is_well_inside() {
        let settings = EstimatorSettings::default();
        let vehicle = Vehicle::new(VehicleModel::Bicycle, 1.2);
        let covariance = ParameterCovariance::identity() * 1e-9;
        let mut trust = Trust::default();
        let mut judged = |offset_deg: f64, lacks_beam_times: bool| {
            let mut values = Values::zeros();
            values[Parameter::SpeedScale.index()] = 1.0;
            values[Parameter::SteeringOffset.index()] = offset_deg.to_radians();
            let prior_sigma = Values::repeat(1.0);
            let claim = Claim::new(SigmaSource::Filter, values, &covariance, &settings);
            let estimates = trust.judge(&Grounds {
                now: RobotTime(1),
                prior_sigma: &prior_sigma,
                blind: [false; REPORTED],
                lacks_beam_times,
                has_impossible_steering: false,
                claim: &claim,
                one_sidedness: 0.0,
                knowledge: Knowledge {
                    vehicle: &vehicle,
                    values: &values,
                    covariance: &covariance,
                    settings: &settings,
                },
            });
            let of = |parameter: Parameter| estimates[parameter.index()].clone();
            let offset = of(Parameter::SteeringOffset);
            let lidar_x = of(Parameter::LidarX);
            assert_eq!(lidar_x.status, offset.status, "none is believed alone");
            (offset, of(Parameter::TimeOffset))
        };
        assert_eq!(judged(14.9, false).0.status, Status::Converged);
        let beyond = judged(15.1, false).0;
        assert_eq!(beyond.status, Status::Learning);
        assert!(beyond.needs.unwrap().contains("look at the vehicle"));
        assert_eq!(judged(14.5, false).0.status, Status::Learning);
        assert_eq!(judged(13.5, false).0.status, Status::Converged);
        // Of clouds without times, the time offset alone is not known.
        assert_eq!(judged(0.0, false).1.status, Status::Converged);
        let (offset, time_offset) = judged(0.0, true);
        assert_eq!(offset.status, Status::Converged);
        assert_eq!(time_offset.status, Status::Learning);
        assert!(
            time_offset
                .needs
                .unwrap()
                .contains("clouds whose points have a time")
        );
    }
}
