//! Standings of the robots, and the listeners that each change concerns.
//!
//! A standing follows from a robot's estimate, records and alerts, from the policy and from the
//! clock: no single event covers all of its changes. So it is computed for every robot once a
//! second, and at once for the robot of an event.

use std::collections::BTreeMap;

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
    told: BTreeMap<RobotId, Standing>,
}

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
        if let Some(standing) = self.told.get(robot) {
            return *standing;
        }
        self.now(robot)
            .map_or(Standing::Unregistered, |state| state.standing())
    }

    /// Present state of a robot, whose standing counts as published; `None` for an unknown robot.
    pub(super) fn now(&mut self, robot: &RobotId) -> Option<RobotStateDocument> {
        let view = self.fleet.robot(robot)?;
        let standing = self.of(&self.evaluator.standings(), &view);
        self.told.insert(view.id.clone(), standing);
        Some(RobotStateDocument::of(&view, standing))
    }

    /// Present state of a robot, if its standing differs from the published one.
    pub(super) fn changed(&mut self, robot: &RobotId) -> Option<RobotStateDocument> {
        let before = self.told.get(robot).copied();
        let now = self.now(robot)?;
        (before != Some(now.standing())).then_some(now)
    }

    /// Robots whose standing differs from the published one; the present one then counts as
    /// published.
    pub(super) fn all_changed(&mut self) -> Vec<RobotStateDocument> {
        let standings = self.evaluator.standings();
        let robots = self.fleet.robots();
        let mut changed = Vec::new();
        let mut told = BTreeMap::new();
        for view in &robots {
            let standing = self.of(&standings, view);
            if self.told.get(&view.id) != Some(&standing) {
                changed.push(RobotStateDocument::of(view, standing));
            }
            told.insert(view.id.clone(), standing);
        }
        // Robots that are gone are forgotten.
        self.told = told;
        changed
    }

    fn of(&self, standings: &Standings, view: &RobotView) -> Standing {
        standings.of(view, &self.lifecycle.ledger(&view.id))
    }
}
