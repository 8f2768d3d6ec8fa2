//! Standings of the robots at one moment.

use std::collections::BTreeMap;

use fleetcal_domain::approval::{RobotLedger, Tolerance};
use fleetcal_domain::robot::RobotView;
use fleetcal_domain::standing::{RobotAlerts, Standing, StandingBasis};
use fleetcal_model::WallTime;
use fleetcal_proto::RobotId;

use super::AlertEvaluator;

/// What the standing of every robot follows from, beside the robot itself and its records.
#[derive(Debug, Clone)]
pub struct Standings {
    alerts: BTreeMap<RobotId, RobotAlerts>,
    propose_beyond: Tolerance,
    now: WallTime,
}

impl Standings {
    /// How a robot stands.
    pub fn of(&self, view: &RobotView, ledger: &RobotLedger) -> Standing {
        let basis = self.basis(view, ledger);
        match self.alerts.get(&view.id) {
            Some(alerts) => basis.with(alerts),
            None => basis.with(&RobotAlerts::default()),
        }
    }

    /// How a robot stands apart from its alerts.
    pub(super) fn basis(&self, view: &RobotView, ledger: &RobotLedger) -> StandingBasis {
        StandingBasis::of(view, ledger, &self.propose_beyond, self.now)
    }

    /// The alerts of a robot.
    pub(super) fn alerts(&self, robot: &RobotId) -> RobotAlerts {
        self.alerts.get(robot).cloned().unwrap_or_default()
    }
}

impl AlertEvaluator {
    /// What the standings of robots follow from at this moment.
    pub fn standings(&self) -> Standings {
        Standings {
            alerts: RobotAlerts::by_robot(self.active().values()),
            propose_beyond: self.inner.lifecycle.policy().propose_beyond,
            now: self.inner.clock.now(),
        }
    }
}
