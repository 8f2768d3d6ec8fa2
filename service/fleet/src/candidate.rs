//! Candidate for a proposal: the time for which a robot's estimate has stood still.

use fleetcal_domain::approval::{Policy, difference, exceeds, values_and_sigmas};
use fleetcal_estimator::RobotTime;
use fleetcal_proto::calibration::CalibrationValues;
use fleetcal_proto::estimate::EstimateDocument;
use serde::{Deserialize, Serialize};

/// Candidate for a proposal, with the time since which the estimate has been stable.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Candidate {
    since: Option<(RobotTime, CalibrationValues)>,
    stable: bool,
}

impl Candidate {
    /// Follows the latest estimate; returns whether it has stayed within half of the proposal's
    /// threshold for long enough.
    pub fn observe(&mut self, estimate: Option<&EstimateDocument>, policy: &Policy) -> bool {
        let known = estimate.and_then(|one| Some((one.stamp_ns, values_and_sigmas(one)?.0)));
        let Some((stamp_ns, values)) = known else {
            *self = Self::default();
            return false;
        };
        let limits = policy.propose_beyond.limits().map(|limit| limit / 2.0);
        let still = self.since.filter(|(since_ns, first)| {
            stamp_ns >= *since_ns && !exceeds(&difference(first, &values), &limits)
        });
        let (since_ns, _) = *self.since.insert(still.unwrap_or((stamp_ns, values)));
        self.stable = stamp_ns.seconds_since(since_ns) >= policy.stable_for_s;
        self.stable
    }

    /// True if there is an estimate that has not been stable for long enough yet.
    pub const fn is_pending(&self) -> bool {
        self.since.is_some() && !self.stable
    }
}

#[cfg(test)]
mod tests {
    use fleetcal_estimator::calibrator::CalibratorConfig;
    use fleetcal_estimator::{Calibrator, Parameter, Status, Vehicle, VehicleModel};
    use fleetcal_model::RobotId;

    use super::*;

    fn estimate(steering_offset_rad: f64, second: i64) -> EstimateDocument {
        let vehicle = Vehicle::new(VehicleModel::Bicycle, 1.2);
        let mut estimate = Calibrator::new(CalibratorConfig::of(vehicle)).estimate();
        estimate.stamp = RobotTime(second * 1_000_000_000);
        let offset = Parameter::SteeringOffset.index();
        for (index, parameter) in estimate.parameters.iter_mut().enumerate() {
            parameter.status = Status::Converged;
            if index == offset {
                parameter.value = steering_offset_rad;
            }
        }
        crate::document::estimate_document(&RobotId::parse("tugger_01").unwrap(), &estimate)
    }

    #[test]
    fn an_estimate_is_a_candidate_once_it_has_stood_still() {
        let policy = Policy::default();
        let mut candidate = Candidate::default();
        assert!(!candidate.is_pending());
        assert!(!candidate.observe(Some(&estimate(0.05, 0)), &policy));
        assert!(!candidate.observe(Some(&estimate(0.05, 9)), &policy));
        assert!(candidate.is_pending());
        let stored = serde_json::to_string(&candidate).unwrap();
        candidate = serde_json::from_str(&stored).unwrap();
        assert!(candidate.observe(Some(&estimate(0.05, 10)), &policy));
        assert!(!candidate.is_pending());
        assert!(!candidate.observe(Some(&estimate(0.06, 11)), &policy));
        assert!(!candidate.observe(Some(&estimate(0.06, 20)), &policy));
        assert!(candidate.observe(Some(&estimate(0.06, 21)), &policy));
        assert!(!candidate.observe(None, &policy));
        assert!(!candidate.observe(Some(&estimate(0.06, 40)), &policy));
    }
}
