//! Policy of alerts: kinds in use, and the delay of each.

use serde::{Deserialize, Serialize};

use super::condition::Periods;
use super::kind::AlertKind;

/// `[alerts]` of `fleetcal.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AlertPolicy {
    /// Delay from the first observation of a problem to its alert, s.
    pub pending_s: f64,
    /// Delay from the end of a problem to the end of its alert, s.
    pub recovering_s: f64,
    /// Kinds that never alert.
    pub off: Vec<AlertKind>,
}

impl Default for AlertPolicy {
    fn default() -> Self {
        Self {
            pending_s: 10.0,
            recovering_s: 60.0,
            off: Vec::new(),
        }
    }
}

impl AlertPolicy {
    /// Checks its numbers.
    ///
    /// # Errors
    /// One sentence that names the key, the value and what is accepted.
    pub fn check(&self) -> Result<(), String> {
        let numbers = [
            ("pending_s", self.pending_s),
            ("recovering_s", self.recovering_s),
        ];
        for (key, value) in numbers {
            if !(0.0..=86_400.0).contains(&value) {
                return Err(format!("alerts.{key}: got {value}, expected 0 to 86400"));
            }
        }
        Ok(())
    }

    /// Delays of a kind. Facts of the records count at once; observations of the robot's data may
    /// be transient.
    pub fn periods(&self, kind: AlertKind) -> Periods {
        let of_data = Periods {
            pending_ns: (self.pending_s * 1e9) as i64,
            recovering_ns: (self.recovering_s * 1e9) as i64,
        };
        match kind {
            AlertKind::Drift
            | AlertKind::Uncalibrated
            | AlertKind::OutOfSync
            | AlertKind::NoData
            | AlertKind::RoutersCut
            | AlertKind::ConfigurationsDiffer
            | AlertKind::ClockOff
            | AlertKind::SessionsFull => of_data,
            // It is told once, when it has happened.
            AlertKind::Fault | AlertKind::TwoSenders | AlertKind::FormerKey => Periods {
                pending_ns: 0,
                ..of_data
            },
            AlertKind::RollbackFailed
            | AlertKind::VerificationFailed
            | AlertKind::FalseReport
            | AlertKind::EstimatorFailed
            | AlertKind::NoInstance
            | AlertKind::NotApplied => Periods::NONE,
        }
    }
}
