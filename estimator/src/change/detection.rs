//! Could a change be seen now? Whether each cause is watched, and what detection waits for if not.
//!
//! A cause is watched while its parameters are known well enough to be held against, and while the
//! smallest change that matters would speak louder than the scatter of this very robot: with the
//! information `M` of the motion so far, a change by `d` is expected to give the evidence of the score
//! `M d`. Where that were too little for a robot that does not scatter either, the motion is what lacks.

pub use fleetcal_model::DetectionState;

use super::evidence::{CAUSES, HYPOTHESES, Hypothesis, Thresholds, least_change};
use crate::estimate::Parameter;
use crate::filter::ParameterCovariance;
use crate::settings::EstimatorSettings;

/// A filter that knows the parameters to this many times their limits can judge.
const JUDGE_SIGMA_FACTOR: f64 = 2.0;
/// A cause that is watched stays so until it is this much (as a standard deviation) less visible.
const WATCHED_HYSTERESIS: f64 = 1.5;

/// Windows, some 20 m, in which a change has to be seen.
const BLIND_WINDOWS: usize = 50;

/// What a cause is held against: its own parameters, and the yaw that a steering zero is told from.
fn has_to_be_known(hypothesis: &Hypothesis) -> impl Iterator<Item = Parameter> {
    let angles = [Parameter::SteeringOffset, Parameter::LidarYaw];
    hypothesis.parameters.iter().copied().chain(angles)
}

fn is_known(
    hypothesis: &Hypothesis,
    covariance: &ParameterCovariance,
    settings: &EstimatorSettings,
    factor: f64,
) -> bool {
    has_to_be_known(hypothesis).all(|p| {
        let sigma = covariance[(p.index(), p.index())].sqrt();
        sigma <= factor * settings.converged_sigma.get(p)
    })
}

/// For each cause, whether its parameters are known well enough to be held against.
pub fn known_causes(
    covariance: &ParameterCovariance,
    settings: &EstimatorSettings,
) -> [bool; CAUSES] {
    HYPOTHESES
        .each_ref()
        .map(|hypothesis| is_known(hypothesis, covariance, settings, JUDGE_SIGMA_FACTOR))
}

/// Which causes are watched.
#[derive(Debug, Clone, Copy, Default)]
pub struct Visibility {
    /// Whether the parameters of each cause are known; none while that was not asked yet.
    known: Option<[bool; CAUSES]>,
    /// The most evidence that the smallest change would have given so far, for each cause.
    evidence: [Option<f64>; CAUSES],
    visible: [bool; CAUSES],
    /// Whether that evidence would be enough if this robot did not scatter.
    moved_enough: [bool; CAUSES],
}

/// How much evidence a change of each cause takes.
#[derive(Debug, Clone, Copy)]
pub struct Required<'a> {
    /// By how far this robot scatters.
    pub of_this_robot: &'a Thresholds,
    /// Of one that does not scatter.
    pub without_scatter: &'a Thresholds,
}

impl Visibility {
    /// Notes how well the parameters are known that changes are held against from now on.
    pub fn know(&mut self, covariance: &ParameterCovariance, settings: &EstimatorSettings) {
        let before = self.known.unwrap_or_default();
        self.known = Some(std::array::from_fn(|i| {
            let factor = if before[i] {
                JUDGE_SIGMA_FACTOR * WATCHED_HYSTERESIS
            } else {
                JUDGE_SIGMA_FACTOR
            };
            is_known(&HYPOTHESES[i], covariance, settings, factor)
        }));
    }

    /// Notes how much evidence the smallest change of each cause would give by the motion of now, and
    /// how much it takes.
    ///
    /// Few windows cannot tell that it would not be seen: more will show more.
    pub fn see(&mut self, windows: usize, expected: &[f64; CAUSES], required: Required) {
        let thresholds = required.of_this_robot;
        for (i, hypothesis) in HYPOTHESES.iter().enumerate() {
            let is_promised = hypothesis
                .parameters
                .iter()
                .any(|&p| least_change(p).is_some());
            let is_seen = expected[i] >= thresholds.values()[i];
            if is_promised && !is_seen && windows < BLIND_WINDOWS && self.evidence[i].is_none() {
                continue;
            }
            let most = self.evidence[i].map_or(expected[i], |most| most.max(expected[i]));
            self.evidence[i] = Some(most);
            let margin = if self.visible[i] {
                WATCHED_HYSTERESIS * WATCHED_HYSTERESIS
            } else {
                1.0
            };
            self.visible[i] = !is_promised || most * margin >= thresholds.values()[i];
            self.moved_enough[i] = most >= required.without_scatter.values()[i];
        }
    }

    /// Whether any cause is known well enough to be watched.
    pub fn knows_any(&self) -> bool {
        self.known.is_some_and(|known| known.contains(&true))
    }

    /// Where detection stands with each cause.
    pub fn states(&self) -> [DetectionState; CAUSES] {
        std::array::from_fn(|i| {
            if self.known.is_some_and(|known| !known[i]) {
                DetectionState::Accuracy
            } else if self.known.is_none() || self.evidence[i].is_none() {
                DetectionState::Motion
            } else if self.visible[i] {
                DetectionState::Watching
            } else if self.moved_enough[i] {
                DetectionState::Scatter
            } else {
                DetectionState::Motion
            }
        })
    }

    /// Whether a change of this parameter would go unseen for more than a few metres. Before that was asked
    /// nothing says so.
    pub fn is_blind(&self, parameter: Parameter) -> bool {
        HYPOTHESES.iter().enumerate().any(|(i, hypothesis)| {
            let is_unknown = self.known.is_some_and(|known| !known[i]);
            let is_unseen = self.known.is_some() && self.evidence[i].is_some() && !self.visible[i];
            hypothesis.parameters.contains(&parameter) && (is_unknown || is_unseen)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::Values;

    const STEERING: usize = 0;
    const MOUNT: usize = 1;

    /// A robot whose scatter doubles the evidence that a change takes, by the share of what it takes without.
    fn seen(windows: usize, share: f64) -> Visibility {
        let without_scatter = Thresholds::for_false_alarm_hours(1000.0);
        let of_this_robot = without_scatter.raised(&Values::repeat(2.0));
        let mut expected = without_scatter.values().map(|threshold| 10.0 * threshold);
        expected[MOUNT] = share * without_scatter.values()[MOUNT];
        let mut visibility = Visibility::default();
        let covariance = ParameterCovariance::identity() * 1e-9;
        visibility.know(&covariance, &EstimatorSettings::default());
        let required = Required {
            of_this_robot: &of_this_robot,
            without_scatter: &without_scatter,
        };
        visibility.see(windows, &expected, required);
        visibility
    }

    #[test]
    fn a_change_waits_for_motion_until_it_would_be_seen_without_scatter() {
        for (share, state) in [
            (0.9, DetectionState::Motion),
            (1.1, DetectionState::Scatter),
            (2.1, DetectionState::Watching),
        ] {
            let visibility = seen(BLIND_WINDOWS, share);
            assert_eq!(visibility.states()[MOUNT], state, "{share}");
            assert_eq!(visibility.states()[STEERING], DetectionState::Watching);
            let is_blind = state != DetectionState::Watching;
            assert_eq!(visibility.is_blind(Parameter::LidarX), is_blind, "{share}");
            assert!(!visibility.is_blind(Parameter::SteeringOffset));
        }
    }

    #[test]
    fn few_windows_hold_nothing_back() {
        let visibility = seen(BLIND_WINDOWS - 1, 0.9);
        assert_eq!(visibility.states()[MOUNT], DetectionState::Motion);
        assert!(!visibility.is_blind(Parameter::LidarX));
    }
}
