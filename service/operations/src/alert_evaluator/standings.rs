//! Standings of the robots at one moment.

use std::collections::BTreeMap;

use fleetcal_domain::approval::{RobotLedger, Tolerance};
use fleetcal_domain::deviation::Deviation;
use fleetcal_domain::robot::RobotView;
use fleetcal_domain::standing::{RobotAlerts, Standing, StandingBasis};
use fleetcal_proto::RobotId;

use super::AlertEvaluator;

/// Facts that determine every robot's standing, beside its view and its records.
#[derive(Debug, Clone)]
pub struct Standings {
    alerts: BTreeMap<RobotId, RobotAlerts>,
    propose_beyond: Tolerance,
}

impl Standings {
    /// Standing of a robot.
    pub fn of(&self, view: &RobotView, ledger: &RobotLedger) -> Standing {
        let basis = self.basis(view, ledger);
        match self.alerts.get(&view.id) {
            Some(alerts) => basis.with(alerts),
            None => basis.with(&RobotAlerts::default()),
        }
    }

    /// Deviation of a robot's estimate from the calibration in use.
    pub fn deviation(&self, view: &RobotView, ledger: &RobotLedger) -> Option<Deviation> {
        Deviation::of(view, ledger, &self.propose_beyond)
    }

    /// Standing of a robot without its alerts.
    pub(super) fn basis(&self, view: &RobotView, ledger: &RobotLedger) -> StandingBasis {
        StandingBasis::of(view, ledger, &self.propose_beyond)
    }

    /// Alerts of a robot.
    pub(super) fn alerts(&self, robot: &RobotId) -> RobotAlerts {
        self.alerts.get(robot).cloned().unwrap_or_default()
    }
}

impl AlertEvaluator {
    /// Standings at this moment.
    pub fn standings(&self) -> Standings {
        Standings {
            alerts: RobotAlerts::by_robot(self.active().values()),
            propose_beyond: self.inner.lifecycle.policy().propose_beyond,
        }
    }
}
