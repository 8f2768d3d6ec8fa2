//! Slow drift: is the present calibration still that of some time ago?
//!
//! A parameter that moves by a tenth of a degree an hour shows in no window of some metres, and the
//! filter follows it. Once a minute its values are therefore compared with those of when they were
//! first known this well. The two share data, so the uncertainties that are added here are more
//! than there are.

use serde::{Deserialize, Serialize};

use super::Calibrator;
use super::comparison::{COMPARED, Comparison, DRIFT, Occasion, Verdict, knows_enough};
use crate::estimate::ChangeKind;
use crate::settings::EstimatorSettings;
use crate::stream::{Effect, RobotTime};

/// Time between two comparisons, s of message time.
const EVERY_S: f64 = 60.0;
/// Share of the baseline's uncertainty below which a calibration becomes the new baseline.
const CLOSER_SHARE: f64 = 0.6;

/// The calibration that later ones are compared with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Baseline {
    calibration: Comparison,
    /// Time of the calibration.
    since: RobotTime,
    /// Time of its last comparison with a newer one.
    compared: RobotTime,
}

impl Baseline {
    /// True if another is known so much better that this one should give way to it.
    fn is_poorer_than(&self, other: &Self, settings: &EstimatorSettings) -> bool {
        let uncertainty = |baseline: &Self| -> f64 {
            let covariance = &baseline.calibration.covariance;
            let shares = COMPARED.iter().map(|&parameter| {
                let i = parameter.index();
                covariance[(i, i)].sqrt() / settings.converged_sigma.get(parameter)
            });
            shares.sum()
        };
        uncertainty(other) < CLOSER_SHARE * uncertainty(self)
    }
}

impl Calibrator {
    /// Compares the filter's values with the baseline, and reports when they have drifted away.
    pub(super) fn check_drift(&mut self, effects: &mut Vec<Effect>) {
        let now = self.session.now;
        let is_due = self
            .baseline
            .as_ref()
            .is_none_or(|baseline| now.seconds_since(baseline.compared) >= EVERY_S);
        let Some(filter) = self
            .filter()
            .filter(|_| is_due && self.comparison.is_none())
        else {
            return;
        };
        let settings = &self.config.settings;
        let (values, covariance) = self.known_of(filter);
        if !knows_enough(&covariance, settings) {
            return;
        }
        let calibration = Comparison::new(Occasion::NewSession, values, &covariance, settings);
        let newest = Baseline {
            calibration: calibration.of_compared_alone(),
            since: now,
            compared: now,
        };
        let Some(mut baseline) = self.baseline.take() else {
            self.baseline = Some(newest);
            return;
        };
        let stored = &baseline.calibration;
        match stored.verdict(&values, &covariance, settings, &DRIFT) {
            Verdict::Same if baseline.is_poorer_than(&newest, settings) => {
                self.baseline = Some(newest);
            }
            Verdict::Same => {
                baseline.compared = now;
                self.baseline = Some(baseline);
            }
            Verdict::Changed(cause, parameters) => {
                self.baseline = Some(newest);
                let before = self.judge_values(&stored.values);
                self.session
                    .close_segment(self.session.duration_s(), before);
                let onset_s = self.session.seconds_to(baseline.since);
                let kind = ChangeKind::CalibrationChanged;
                self.report(kind, cause, onset_s, &parameters, effects);
            }
        }
    }
}
