//! Standings and deviations of the robots, and the listeners that each change concerns.
//!
//! They follow from a robot's estimate, records and alerts, from the policy and from the clock: no
//! single event covers all of their changes. So they are computed for every robot once a second, and
//! at once for the robot of an event.

use std::collections::BTreeMap;

use fleetcal_domain::deviation::Deviation;
use fleetcal_domain::robot::RobotView;
use fleetcal_domain::standing::Standing;
use fleetcal_fleet::FleetHandle;
use fleetcal_operations::alert_evaluator::{AlertEvaluator, Standings};
use fleetcal_operations::lifecycle::Lifecycle;
use fleetcal_proto::RobotId;

use super::robots::RobotStateDocument;

/// Standings that were last published to listeners, and their sources.
#[derive(Debug)]
pub(super) struct ToldStandings {
    fleet: FleetHandle,
    lifecycle: Lifecycle,
    evaluator: AlertEvaluator,
    told: BTreeMap<RobotId, Told>,
}

/// Standing and deviation of a robot as last published.
#[derive(Debug, Clone, Copy)]
struct Told {
    standing: Standing,
    deviation: Option<Deviation>,
}

impl Told {
    fn of(state: &RobotStateDocument) -> Self {
        Self {
            standing: state.standing(),
            deviation: state.deviation(),
        }
    }

    /// True if a present state is to be published after this one.
    fn differs(self, now: Self) -> bool {
        let farther = match (self.deviation, now.deviation) {
            (None, None) => false,
            (Some(before), Some(now)) => {
                before.parameter != now.parameter
                    || (before.tolerances - now.tolerances).abs() >= DEVIATION_STEP
            }
            _ => true,
        };
        self.standing != now.standing || farther
    }
}

/// Change of a deviation that is published, tolerances: half of the last digit that a list shows.
const DEVIATION_STEP: f64 = 0.05;

impl ToldStandings {
    /// Makes a collection without any published standing.
    pub(super) const fn new(
        fleet: FleetHandle,
        lifecycle: Lifecycle,
        evaluator: AlertEvaluator,
    ) -> Self {
        Self {
            fleet,
            lifecycle,
            evaluator,
            told: BTreeMap::new(),
        }
    }

    /// Standing of a robot as last published; the present one before that.
    pub(super) fn known(&mut self, robot: &RobotId) -> Standing {
        if let Some(told) = self.told.get(robot) {
            return told.standing;
        }
        self.now(robot)
            .map_or(Standing::Unregistered, |state| state.standing())
    }

    /// Present state of a robot, which counts as published; `None` for an unknown robot.
    pub(super) fn now(&mut self, robot: &RobotId) -> Option<RobotStateDocument> {
        let view = self.fleet.robot(robot)?;
        let state = self.of(&self.evaluator.standings(), &view);
        self.told.insert(view.id.clone(), Told::of(&state));
        Some(state)
    }

    /// Present state of a robot, if it differs from the published one.
    pub(super) fn changed(&mut self, robot: &RobotId) -> Option<RobotStateDocument> {
        let before = self.told.get(robot).copied();
        let now = self.now(robot)?;
        let differs = before.is_none_or(|before| before.differs(Told::of(&now)));
        differs.then_some(now)
    }

    /// Robots whose standing or deviation differs from the published one; the present state then
    /// counts as published.
    pub(super) fn all_changed(&mut self) -> Vec<RobotStateDocument> {
        let standings = self.evaluator.standings();
        let robots = self.fleet.robots();
        let mut changed = Vec::new();
        let mut told = BTreeMap::new();
        for view in &robots {
            let state = self.of(&standings, view);
            let now = Told::of(&state);
            match self.told.get(&view.id) {
                Some(before) if !before.differs(now) => told.insert(view.id.clone(), *before),
                _ => {
                    changed.push(state);
                    told.insert(view.id.clone(), now)
                }
            };
        }
        // Robots that are gone are forgotten.
        self.told = told;
        changed
    }

    fn of(&self, standings: &Standings, view: &RobotView) -> RobotStateDocument {
        let ledger = self.lifecycle.ledger(&view.id);
        let deviation = standings.deviation(view, &ledger);
        RobotStateDocument::of(view, standings.of(view, &ledger), deviation)
    }
}
