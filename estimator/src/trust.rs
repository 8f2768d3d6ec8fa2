//! Trust in a number: a status per parameter, with the reason in words.

use serde::{Deserialize, Serialize};

use crate::advice::Knowledge;
use crate::advice::ranking::{first_for, rank};
use crate::estimate::{
    CalibrationCovariance, Estimate, Parameter, ParameterEstimate, ParameterEstimates, Status,
};
use crate::filter::encoder::EncoderVariance;
use crate::filter::{ParameterCovariance, Values, padded};
use crate::settings::{EstimatorSettings, Freedom};
use crate::stream::RobotTime;

/// Parameters that are reported.
const REPORTED: usize = Parameter::ALL.len();
/// A parameter is unobservable while its uncertainty is above this share of its prior.
const UNOBSERVABLE_SHARE: f64 = 0.5;
/// What is said where no single manoeuvre would help much.
const MORE_DRIVING: &str = "more driving with turns to both sides";
/// What is said of a LiDAR's `y` that no driving tells from the place where the speed is measured.
const SPEED_PLACE: &str = "speed_measured_at in the configuration with a rear_wheel and its lateral_m (0 for \
    the axle's middle): no driving tells where the speed is measured";
/// The same while the vehicle has turned to one side alone, where the steering's curve hides it.
const OTHER_SIDE_OR_SPEED_PLACE: &str = "more driving with turns to both sides, or speed_measured_at in the \
    configuration with a rear_wheel and its lateral_m (0 for the axle's middle)";
/// A vehicle has turned to one side alone from this much of [`crate::excitation::Excitation::one_sidedness`] on.
const ONE_SIDED: f64 = 0.5;
/// An instruction stands for this long before it is worked out again, s of message time.
const ADVICE_HOLDS_S: f64 = 10.0;
/// What is said of the time offset of clouds whose points have no times.
const POINT_TIMES: &str = "clouds whose points have a time, or ignore_times in point_cloud where they were all \
    taken at once: without, nobody knows when in a turn the scanner looked where";
/// What is said of a value that no vehicle has.
const CHECK_VEHICLE: &str = "a look at the vehicle and its configuration: this cannot be";
/// A value that was beyond its limit must come this far inside it to be believed again.
const RELEASE_SHARE: f64 = 0.93;
/// Standard deviation of the scale of a LiDAR's ranges, which docs/assumptions.md takes for typical.
const RANGE_SCALE_SIGMA: f64 = 0.005;
/// A converged parameter stays so until its sigma exceeds its limit by this factor.
const HYSTERESIS: f64 = 1.2;

/// The trust a robot's parameters have earned.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Trust {
    #[serde(deserialize_with = "padded::published")]
    converged: [bool; Parameter::ALL.len()],
    /// Values beyond what a vehicle can be.
    #[serde(deserialize_with = "padded::published")]
    impossible: [bool; Parameter::ALL.len()],
    advised: Option<Advised>,
}

/// What was last said to be missing. Working it out takes as long as ten scans, so it is said again
/// for a while.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Advised {
    at: RobotTime,
    statuses: [Status; REPORTED],
    needs: [Option<String>; REPORTED],
}

/// What a judgement is made from.
#[derive(Debug, Clone, Copy)]
pub struct Grounds<'a> {
    /// The time it is made at.
    pub now: RobotTime,
    /// Uncertainties before the first metre.
    pub prior_sigma: &'a Values,
    /// What is known of the robot now.
    pub knowledge: Knowledge<'a>,
    /// Parameters of which a change would go unseen.
    pub blind: [bool; REPORTED],
    /// Says that scans are made of points without times.
    pub lacks_beam_times: bool,
    /// Whether steering angles are sent that the vehicle cannot have.
    pub has_impossible_steering: bool,
    /// What of the variance of the LiDAR's `y` is there because nobody said where the speed is measured.
    pub encoder_variance: EncoderVariance,
    /// What of the variance of the LiDAR's yaw no turning to one side takes away, rad².
    pub circling_variance_rad2: f64,
    /// How far its turns went to one side alone, 0 to 1.
    pub one_sidedness: f64,
}

impl Grounds<'_> {
    /// Covariance of what driving tells.
    fn driven_covariance(&self) -> ParameterCovariance {
        let mut covariance = *self.knowledge.covariance;
        let y = Parameter::LidarY.index();
        covariance[(y, y)] -= self.encoder_variance.told_m2;
        covariance
    }

    /// What a parameter waits for that no single manoeuvre shows; `None` where one does.
    fn waits_for(&self, parameter: Parameter) -> Option<&'static str> {
        let yaw = Parameter::LidarYaw.index();
        let has_circled = self.circling_variance_rad2 > 0.5 * self.knowledge.covariance[(yaw, yaw)];
        match parameter {
            Parameter::TimeOffset if self.lacks_beam_times => Some(POINT_TIMES),
            Parameter::LidarYaw if has_circled => Some(MORE_DRIVING),
            Parameter::LidarY if self.is_open_by(self.encoder_variance.told_m2) => {
                Some(if self.one_sidedness > ONE_SIDED {
                    OTHER_SIDE_OR_SPEED_PLACE
                } else if self.is_open_by(self.encoder_variance.undriven_m2) {
                    SPEED_PLACE
                } else {
                    MORE_DRIVING
                })
            }
            _ => None,
        }
    }

    /// Whether this much of the variance of the LiDAR's `y`, m², is most of it, and too much by itself.
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
            values,
            covariance,
            settings,
            ..
        } = grounds.knowledge;
        for parameter in Parameter::ALL {
            self.limit(parameter, values[parameter.index()], settings);
        }
        let believed = self.believes(grounds);
        let statuses = Parameter::ALL.map(|parameter| {
            let i = parameter.index();
            let sigma = reported_sigma(parameter, covariance, settings);
            let status = self.status(parameter, sigma, grounds.prior_sigma[i], settings);
            match status {
                Status::Converged if grounds.blind[i] || !believed => Status::Learning,
                Status::Converged
                    if grounds.lacks_beam_times && parameter == Parameter::TimeOffset =>
                {
                    Status::Learning
                }
                status => status,
            }
        });
        let needs = self.needs(grounds, statuses);
        Parameter::ALL.map(|parameter| {
            let i = parameter.index();
            let (value, sigma) = if statuses[i] == Status::Off {
                // What is not estimated is told as the neutral value, even if the filter knows better.
                (neutral(parameter, values[i]), 0.0)
            } else {
                let sigma = reported_sigma(parameter, covariance, settings);
                (values[i], sigma.hypot(scale_sigma(parameter, values[i])))
            };
            ParameterEstimate {
                value,
                sigma,
                status: statuses[i],
                needs: needs[i].clone(),
            }
        })
    }

    /// What is missing, as instructions a driver can follow.
    fn needs(
        &mut self,
        grounds: &Grounds,
        statuses: [Status; REPORTED],
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
        let believed = self.believes(grounds);
        let needs = Parameter::ALL.map(|parameter| {
            let i = parameter.index();
            if !open(&statuses[i]) {
                return None;
            }
            if !believed {
                return Some(CHECK_VEHICLE.to_owned());
            }
            if let Some(waits_for) = grounds.waits_for(parameter) {
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

    /// Whether this can be a vehicle. All values explain the same motion: where one of them cannot
    /// be, none is believed.
    fn believes(&self, grounds: &Grounds) -> bool {
        !grounds.has_impossible_steering && !self.holds_impossible(grounds.knowledge.settings)
    }

    /// Whether a parameter that is estimated has a value that no vehicle has.
    fn holds_impossible(&self, settings: &EstimatorSettings) -> bool {
        let mut estimated = Parameter::ALL
            .into_iter()
            .filter(|&parameter| settings.freedom(parameter) == Freedom::Estimated);
        estimated.any(|parameter| self.impossible[parameter.index()])
    }

    /// Takes all trust away: the vehicle may not be the one that earned it.
    pub fn withdraw(&mut self) {
        self.converged = [false; Parameter::ALL.len()];
    }
}

/// What a parameter that is off is taken for.
fn neutral(parameter: Parameter, value: f64) -> f64 {
    match parameter {
        Parameter::SteeringGain => 1.0,
        _ => value,
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

/// The scale of the LiDAR's ranges passes for that of the speed on the straight, and stretches the mount
/// in turns. No driving tells it, so that nothing has to wait for it to be converged.
fn scale_sigma(parameter: Parameter, value: f64) -> f64 {
    match parameter {
        Parameter::LidarX | Parameter::LidarY => RANGE_SCALE_SIGMA * value.abs(),
        _ => 0.0,
    }
}

/// An estimate as it is compared with values that the same LiDAR has measured. The scale of its ranges
/// (1 sigma: 0.5 % of the mount's x and y, m) is off alike in both, and no part of their difference.
#[must_use]
pub fn without_range_scale(mut estimate: Estimate) -> Estimate {
    for parameter in [Parameter::LidarX, Parameter::LidarY] {
        let one = &mut estimate.parameters[parameter.index()];
        let scale_sigma = scale_sigma(parameter, one.value);
        let variance = (one.sigma * one.sigma - scale_sigma * scale_sigma).max(0.0);
        one.sigma = variance.sqrt();
    }
    let told = estimate.covariance;
    estimate.covariance = CalibrationCovariance::from_fn(|row, column| {
        if row == column {
            estimate.parameters[row.index()].sigma.powi(2)
        } else {
            told.rows()[row.index()][column.index()]
        }
    });
    estimate
}

/// The covariance that leaves the estimator: that of the errors as they go together, with each
/// parameter's reported sigma.
pub fn reported_covariance(
    parameters: &ParameterEstimates,
    covariance: &ParameterCovariance,
) -> CalibrationCovariance {
    CalibrationCovariance::from_fn(|row, column| {
        let [sigma, other] = [row, column].map(|p| parameters[p.index()].sigma);
        if row == column {
            sigma * sigma
        } else if sigma > 0.0 && other > 0.0 {
            covariance[(row.index(), column.index())]
        } else {
            // A parameter that is off has no error.
            0.0
        }
    })
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
            let estimates = trust.judge(&Grounds {
                now: RobotTime(1),
                prior_sigma: &prior_sigma,
                blind: [false; REPORTED],
                lacks_beam_times,
                has_impossible_steering: false,
                encoder_variance: EncoderVariance::default(),
                circling_variance_rad2: 0.0,
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
