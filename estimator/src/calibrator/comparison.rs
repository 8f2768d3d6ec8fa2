//! Comparison of a new session with the stored calibration: is this still the vehicle that was
//! calibrated?
//!
//! After a power cycle or a reassembly the filter starts from scratch and knows nothing of the
//! stored calibration; once the floor was found in its scans, it knows nothing of the four
//! parameters that are compared. Once it has converged the two are compared,
//! `d' (P_new + P_stored)^-1 d` with four degrees of freedom, *before* they are fused: a stored
//! calibration that is fused first hides the change.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use crate::claim::Claim;
use crate::claim::encoder::ENCODER_SIGMA_M;
use crate::estimate::{Cause, Parameter};
use crate::filter::prior::Prior;
use crate::filter::tyres::{Slip, moved_by_tyres};
use crate::filter::{CURVE, PARAMETERS, ParameterCovariance, SIDE_SLIP, Values, padded};
use crate::geometry::wrap_angle_rad;
use crate::settings::EstimatorSettings;
use crate::steered_way::SteeringRange;

/// The parameters that are compared.
pub(super) const COMPARED: [Parameter; 4] = [
    Parameter::SteeringOffset,
    Parameter::LidarX,
    Parameter::LidarY,
    Parameter::LidarYaw,
];
/// Largest differences between two calibrations of one vehicle, as chi-squared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Limits {
    /// All four together, 4 degrees of freedom.
    same: f64,
    /// Rest when the steering zero is let go, 3 degrees of freedom.
    without_steering: f64,
    /// Rest when the mount is let go, 1 degree of freedom.
    without_mount: f64,
}

/// Limits of a new session and the stored calibration: exceeded once in 10,000 comparisons.
pub(super) const SESSIONS: Limits = Limits {
    same: 23.5,
    without_steering: 21.1,
    without_mount: 15.1,
};

/// Limits of one and the same session over time: exceeded once in ten million comparisons, for
/// there is one a minute.
pub(super) const DRIFT: Limits = Limits {
    same: 38.2,
    without_steering: 35.4,
    without_mount: 28.4,
};

/// Reason for which a comparison was begun.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Occasion {
    /// A new session: the stored calibration holds until it is contradicted.
    NewSession,
    /// Report by a person that parts were off: nothing holds until it is found again.
    Reassembled,
}

/// A stored calibration that waits to be compared with a new one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Comparison {
    pub occasion: Occasion,
    #[serde(with = "padded")]
    pub values: Values,
    /// Its covariance, with the systematic errors that averaging cannot remove.
    #[serde(with = "padded")]
    pub covariance: ParameterCovariance,
    /// Variances that are published on top of it: of errors that no driving shows, as they were
    /// when this was stored.
    #[serde(default = "undriven_of_older", with = "padded")]
    pub undriven: Values,
    /// Measured steering angles that were driven when this was stored.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub driven: Option<SteeringRange>,
}

/// Variances that earlier checkpoints lack: the speed may have been measured beside the axle's
/// middle, which is `y` to the estimator.
fn undriven_of_older() -> Values {
    let mut variances = Values::zeros();
    variances[Parameter::LidarY.index()] = ENCODER_SIGMA_M.powi(2);
    variances
}

/// The outcome.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Verdict {
    /// Equal as far as the data show.
    Same,
    /// Different, with the cause and the moved parameters.
    Changed(Cause, Vec<Parameter>),
}

impl Comparison {
    pub fn new(
        occasion: Occasion,
        values: Values,
        covariance: &ParameterCovariance,
        settings: &EstimatorSettings,
    ) -> Self {
        Self {
            occasion,
            values,
            covariance: with_systematic(covariance, settings),
            undriven: Values::zeros(),
            driven: None,
        }
    }

    /// Opens the steering's curve, which a checkpoint of an earlier estimator lacks: nothing is known of
    /// it.
    pub fn open_curve(&mut self, prior: &Prior, settings: &EstimatorSettings) {
        let open = with_systematic(&ParameterCovariance::zeros(), settings);
        for i in CURVE {
            if self.covariance[(i, i)] <= open[(i, i)] {
                self.covariance[(i, i)] += prior.covariance[(i, i)];
            }
        }
    }

    /// The same, published with no smaller variances than these.
    #[must_use]
    pub fn told_with(mut self, covariance: &ParameterCovariance) -> Self {
        let more = covariance.diagonal() - self.covariance.diagonal();
        self.undriven = more.map(|variance| variance.max(0.0));
        self
    }

    /// The claim that is published of it.
    pub fn claim(&self, settings: &EstimatorSettings) -> Claim {
        Claim::of_stored(self.values, &self.covariance, self.undriven, settings)
    }

    /// The same without the uncertainties that [`Self::verdict`] does not use.
    #[must_use]
    pub fn of_compared_alone(mut self) -> Self {
        let is_used =
            |i: usize| i == SIDE_SLIP || COMPARED.iter().any(|compared| compared.index() == i);
        for row in 0..PARAMETERS {
            for column in 0..PARAMETERS {
                if !is_used(row) || !is_used(column) {
                    self.covariance[(row, column)] = 0.0;
                }
            }
        }
        self
    }

    /// Compares with the values that the new session has found on the same tyres.
    pub fn verdict(
        &self,
        values: &Values,
        covariance: &ParameterCovariance,
        settings: &EstimatorSettings,
        limits: &Limits,
    ) -> Verdict {
        let mut apart = values - self.values;
        let yaw = Parameter::LidarYaw.index();
        apart[yaw] = wrap_angle_rad(apart[yaw]);
        let prior_sigma = settings.side_slip_sigma_rad_per_mps2;
        let stored = Slip::of(&self.values, &self.covariance, prior_sigma);
        let new = Slip::of(values, covariance, prior_sigma);
        let (by_tyres, of_tyres) = moved_by_tyres(&stored, &new, prior_sigma);
        apart += by_tyres;
        let uncertainty = with_systematic(covariance, settings) + self.covariance + of_tyres;
        let chi2 = |parameters: &[Parameter]| chi_squared(&apart, &uncertainty, parameters);
        if chi2(&COMPARED) <= limits.same {
            return Verdict::Same;
        }
        let (steering, mount) = COMPARED.split_at(1);
        if chi2(mount) <= limits.without_steering {
            Verdict::Changed(Cause::Steering, steering.to_vec())
        } else if chi2(steering) <= limits.without_mount {
            Verdict::Changed(Cause::LidarMount, mount.to_vec())
        } else {
            Verdict::Changed(Cause::Unknown, COMPARED.to_vec())
        }
    }
}

/// True if a new session knows enough for a comparison.
pub(super) fn knows_enough(covariance: &ParameterCovariance, settings: &EstimatorSettings) -> bool {
    COMPARED.iter().all(|&parameter| {
        let sigma = covariance[(parameter.index(), parameter.index())].sqrt();
        sigma <= *settings.converged_sigma.get(parameter)
    })
}

fn with_systematic(
    covariance: &ParameterCovariance,
    settings: &EstimatorSettings,
) -> ParameterCovariance {
    let mut with = *covariance;
    for parameter in Parameter::ALL {
        let i = parameter.index();
        with[(i, i)] += settings.systematic_sigma.get(parameter).powi(2);
    }
    with
}

/// Squared normalised difference over some parameters, the others left out.
fn chi_squared(apart: &Values, uncertainty: &ParameterCovariance, parameters: &[Parameter]) -> f64 {
    let size = parameters.len();
    let part = DVector::from_fn(size, |i, _| apart[parameters[i].index()]);
    let block = DMatrix::from_fn(size, size, |i, j| {
        uncertainty[(parameters[i].index(), parameters[j].index())]
    });
    block
        .cholesky()
        .map_or(f64::INFINITY, |factor| part.dot(&factor.solve(&part)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stored() -> Comparison {
        let covariance = ParameterCovariance::identity() * 1e-8;
        Comparison::new(
            Occasion::NewSession,
            Values::zeros(),
            &covariance,
            &EstimatorSettings::default(),
        )
    }

    fn verdict(moves: &[(Parameter, f64)]) -> Verdict {
        let mut values = Values::zeros();
        for (parameter, by) in moves {
            values[parameter.index()] = *by;
        }
        let covariance = ParameterCovariance::identity() * 1e-8;
        stored().verdict(
            &values,
            &covariance,
            &EstimatorSettings::default(),
            &SESSIONS,
        )
    }

    #[test]
    fn what_moved_is_named() {
        assert_eq!(verdict(&[(Parameter::LidarX, 0.0005)]), Verdict::Same);
        let steering = verdict(&[(Parameter::SteeringOffset, 0.01)]);
        assert!(matches!(steering, Verdict::Changed(Cause::Steering, _)));
        let mount = verdict(&[(Parameter::LidarX, 0.02), (Parameter::LidarYaw, 0.01)]);
        assert!(matches!(mount, Verdict::Changed(Cause::LidarMount, _)));
        let both = verdict(&[(Parameter::LidarX, 0.02), (Parameter::SteeringOffset, 0.01)]);
        assert!(matches!(both, Verdict::Changed(Cause::Unknown, _)));
    }

    const SPEED_MPS: f64 = 1.0;

    /// Values that a robot has found whose LiDAR is at `x_m` and whose tyres give way by `slip`, rad for each m/s^2, at
    /// these speeds: each shows `x - c |v| v` to half a millimetre.
    fn found(x_m: f64, slip: f64, speeds_mps: &[f64]) -> (Values, ParameterCovariance) {
        let settings = EstimatorSettings::default();
        let mut information = ParameterCovariance::identity() * 1e8;
        let x = Parameter::LidarX.index();
        information[(x, x)] = 1.0;
        information[(SIDE_SLIP, SIDE_SLIP)] = settings.side_slip_sigma_rad_per_mps2.powi(-2);
        let mut score = Values::zeros();
        for speed_mps in speeds_mps {
            let mut by = Values::zeros();
            by[x] = 1.0;
            by[SIDE_SLIP] = -speed_mps.abs() * speed_mps;
            information += by * by.transpose() * 4e6;
            score += by * (x_m + by[SIDE_SLIP] * slip) * 4e6;
        }
        let covariance = information.cholesky().unwrap().inverse();
        (covariance * score, covariance)
    }

    fn compared(
        (stored, covariance): (Values, ParameterCovariance),
        (new, new_covariance): (Values, ParameterCovariance),
        limits: &Limits,
    ) -> Verdict {
        let settings = EstimatorSettings::default();
        let stored = Comparison::new(Occasion::NewSession, stored, &covariance, &settings)
            .of_compared_alone();
        stored.verdict(&new, &new_covariance, &settings, limits)
    }

    #[test]
    fn tyres_that_give_way_are_no_lidar_that_moved() {
        let drives: [&[f64]; 5] = [
            &[SPEED_MPS],
            &[-SPEED_MPS],
            &[SPEED_MPS, -SPEED_MPS],
            &[0.3],
            &[0.3, 1.5],
        ];
        for slip in [0.0, 0.003, 0.01, 0.02, 0.03, 0.04] {
            for (stored, new) in drives
                .iter()
                .flat_map(|a| drives.iter().map(move |b| (a, b)))
            {
                let [stored, new] = [stored, new].map(|speeds| found(0.4, slip, speeds));
                let verdict = compared(stored, new, &SESSIONS);
                assert_eq!(verdict, Verdict::Same, "{slip}: {stored:?} {new:?}");
            }
        }
    }

    #[test]
    fn a_lidar_that_moved_is_seen_whatever_the_tyres() {
        for slip in [0.0, 0.003, 0.03] {
            for (stored, new) in [
                // Nothing of the slip is known, but it is the same.
                (&[SPEED_MPS][..], &[SPEED_MPS][..]),
                // It is known from both, or from the stored one alone.
                (&[SPEED_MPS, -SPEED_MPS], &[SPEED_MPS, -SPEED_MPS]),
                (&[SPEED_MPS, -SPEED_MPS], &[SPEED_MPS]),
            ] {
                for moved_m in [-0.03, 0.03] {
                    let [stored, new] = [(0.4, stored), (0.4 + moved_m, new)]
                        .map(|(x_m, speeds)| found(x_m, slip, speeds));
                    let verdict = compared(stored, new, &DRIFT);
                    let is_seen = matches!(verdict, Verdict::Changed(Cause::LidarMount, _));
                    assert!(is_seen, "{slip}: {verdict:?} of {stored:?} and {new:?}");
                }
            }
        }
    }

    #[test]
    fn a_yaw_is_compared_the_short_way_round() {
        let mut stored = stored();
        stored.values[Parameter::LidarYaw.index()] = std::f64::consts::PI - 1e-4;
        let mut values = Values::zeros();
        values[Parameter::LidarYaw.index()] = -std::f64::consts::PI + 1e-4;
        let covariance = ParameterCovariance::identity() * 1e-8;
        let settings = EstimatorSettings::default();
        assert_eq!(
            stored.verdict(&values, &covariance, &settings, &SESSIONS),
            Verdict::Same
        );
    }
}
