//! Detection of each cause: could a change be seen now, and what does it wait for if not?
//!
//! A cause is watched while its parameters are known well enough to compare with, and while the
//! smallest change that matters would stand out from the scatter of this very robot: with the
//! information `M` of the motion so far, a change by `d` is expected to give the evidence of the
//! score `M d`. Where that would be too little even for a robot that does not scatter, the missing
//! part is motion.

pub use fleetcal_model::DetectionState;

use super::evidence::{CAUSES, HYPOTHESES, Hypothesis, least_change};
use crate::estimate::Parameter;
use crate::filter::ParameterCovariance;
use crate::settings::EstimatorSettings;

/// Multiple of their limits within which the parameters of a filter that can judge are known.
const JUDGE_SIGMA_FACTOR: f64 = 2.0;
/// Factor (of a standard deviation) by which a watched cause must become less visible before it is
/// not watched.
const WATCHED_HYSTERESIS: f64 = 1.5;

/// Windows, some 20 m, in which a change has to be seen.
const BLIND_WINDOWS: usize = 50;

/// Parameters that have to be known to watch a cause: its own, and the yaw that a steering zero is
/// distinguished from.
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

/// Determines for each cause whether its parameters are known well enough to compare with.
pub fn known_causes(
    covariance: &ParameterCovariance,
    settings: &EstimatorSettings,
) -> [bool; CAUSES] {
    HYPOTHESES
        .each_ref()
        .map(|hypothesis| is_known(hypothesis, covariance, settings, JUDGE_SIGMA_FACTOR))
}

/// Visibility of a change by each cause.
#[derive(Debug, Clone, Copy, Default)]
pub struct Visibility {
    /// True for each cause whose parameters are known; `None` before the first check.
    known: Option<[bool; CAUSES]>,
    /// The most evidence that the smallest change would have given so far, for each cause.
    evidence: [Option<f64>; CAUSES],
    visible: [bool; CAUSES],
    /// True for each cause if the motion so far would have been enough for a robot that does not
    /// scatter.
    moved_enough: [bool; CAUSES],
}

/// Evidence that the motion of the last windows promises for each cause.
#[derive(Debug, Clone, Copy)]
pub struct Prospect {
    /// Evidence that the smallest change is expected to give.
    pub expected: [f64; CAUSES],
    /// Evidence that a change needs.
    pub required: [f64; CAUSES],
}

impl Prospect {
    fn is_enough(&self, cause: usize) -> bool {
        self.expected[cause] >= self.required[cause]
    }
}

impl Visibility {
    /// Notes how well the parameters that changes are compared with from now on are known.
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

    /// Notes the prospect of this robot by its recent motion, and that of one that does not
    /// scatter.
    ///
    /// With few windows, too little evidence is not yet a verdict.
    pub fn see(&mut self, windows: usize, of_this_robot: &Prospect, without_scatter: &Prospect) {
        for (i, hypothesis) in HYPOTHESES.iter().enumerate() {
            self.moved_enough[i] |= without_scatter.is_enough(i);
            let is_promised = hypothesis
                .parameters
                .iter()
                .any(|&p| least_change(p).is_some());
            let is_few = windows < BLIND_WINDOWS && self.evidence[i].is_none();
            if is_promised && is_few && !of_this_robot.is_enough(i) {
                continue;
            }
            let now = of_this_robot.expected[i];
            let most = self.evidence[i].map_or(now, |most| most.max(now));
            self.evidence[i] = Some(most);
            let margin = if self.visible[i] {
                WATCHED_HYSTERESIS * WATCHED_HYSTERESIS
            } else {
                1.0
            };
            self.visible[i] = !is_promised || most * margin >= of_this_robot.required[i];
        }
    }

    /// True if any cause is known well enough to be watched.
    pub fn knows_any(&self) -> bool {
        self.known.is_some_and(|known| known.contains(&true))
    }

    /// True if the parameters of a cause are too little known to compare with.
    fn is_unknown(&self, cause: usize) -> bool {
        self.known.is_some_and(|known| !known[cause])
    }

    /// True if a change was checked for visibility, and would not be seen.
    fn is_unseen(&self, cause: usize) -> bool {
        self.evidence[cause].is_some() && !self.visible[cause]
    }

    /// State of detection for each cause.
    pub fn states(&self) -> [DetectionState; CAUSES] {
        std::array::from_fn(|i| {
            if self.is_unknown(i) {
                DetectionState::Accuracy
            } else if self.is_unseen(i) && self.moved_enough[i] {
                DetectionState::Scatter
            } else if self.is_unseen(i) || self.evidence[i].is_none() {
                DetectionState::Motion
            } else {
                DetectionState::Watching
            }
        })
    }

    /// True if a change of this parameter would go unseen for more than a few metres: its values
    /// are too little known, or it was checked and would not be seen.
    pub fn is_blind(&self, parameter: Parameter) -> bool {
        HYPOTHESES.iter().enumerate().any(|(i, hypothesis)| {
            hypothesis.parameters.contains(&parameter) && (self.is_unknown(i) || self.is_unseen(i))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEERING: usize = 0;
    const MOUNT: usize = 1;
    /// Evidence that a change of a robot that does not scatter needs; this one needs twice as much.
    const REQUIRED: f64 = 30.0;

    fn known(sigma: f64) -> Visibility {
        let mut visibility = Visibility::default();
        let covariance = ParameterCovariance::identity() * (sigma * sigma);
        visibility.know(&covariance, &EstimatorSettings::default());
        visibility
    }

    /// Adds a motion that promises this much of a LiDAR that moved, and enough of every other
    /// cause. The robot's scatter divides its evidence.
    fn see(visibility: &mut Visibility, windows: usize, promised: f64, scatter: f64) {
        let mut expected = [10.0 * REQUIRED; CAUSES];
        expected[MOUNT] = promised;
        let without_scatter = Prospect {
            expected,
            required: [REQUIRED; CAUSES],
        };
        let of_this_robot = Prospect {
            expected: expected.map(|evidence| evidence / scatter),
            required: [2.0 * REQUIRED; CAUSES],
        };
        visibility.see(windows, &of_this_robot, &without_scatter);
    }

    fn seen(windows: usize, promised: f64, scatter: f64) -> Visibility {
        let mut visibility = known(1e-5);
        see(&mut visibility, windows, promised, scatter);
        visibility
    }

    #[test]
    fn a_change_waits_for_motion_until_it_would_be_seen_without_scatter() {
        for (promised, scatter, state) in [
            (0.9 * REQUIRED, 1.0, DetectionState::Motion),
            (1.1 * REQUIRED, 1.0, DetectionState::Scatter),
            (2.1 * REQUIRED, 1.0, DetectionState::Watching),
            (2.1 * REQUIRED, 4.0, DetectionState::Scatter),
        ] {
            let visibility = seen(BLIND_WINDOWS, promised, scatter);
            assert_eq!(visibility.states()[MOUNT], state, "{promised}");
            assert_eq!(visibility.states()[STEERING], DetectionState::Watching);
            let is_blind = state != DetectionState::Watching;
            assert_eq!(visibility.is_blind(Parameter::LidarX), is_blind);
            assert!(!visibility.is_blind(Parameter::SteeringOffset));
        }
    }

    #[test]
    fn what_motion_has_shown_once_is_not_asked_of_it_again() {
        let mut visibility = seen(BLIND_WINDOWS, 2.1 * REQUIRED, 1.0);
        see(&mut visibility, BLIND_WINDOWS, 0.0, 1.0);
        assert_eq!(visibility.states()[MOUNT], DetectionState::Watching);
        let mut scattering = seen(BLIND_WINDOWS, 2.1 * REQUIRED, 4.0);
        see(&mut scattering, BLIND_WINDOWS, 0.0, 4.0);
        assert_eq!(scattering.states()[MOUNT], DetectionState::Scatter);
    }

    #[test]
    fn few_windows_hold_nothing_back() {
        let visibility = seen(BLIND_WINDOWS - 1, 0.9 * REQUIRED, 1.0);
        assert_eq!(visibility.states()[MOUNT], DetectionState::Motion);
        assert!(!visibility.is_blind(Parameter::LidarX));
        assert!(!Visibility::default().is_blind(Parameter::LidarX));
    }

    #[test]
    fn what_is_not_known_is_blind() {
        let visibility = known(1.0);
        assert_eq!(visibility.states(), [DetectionState::Accuracy; CAUSES]);
        assert!(visibility.is_blind(Parameter::LidarX));
    }
}
