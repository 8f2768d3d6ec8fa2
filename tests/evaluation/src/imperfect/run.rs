//! One run of a cell.

use std::f64::consts::FRAC_PI_4;
use std::ops::ControlFlow;

use fleetcal_estimator::Estimate;
use fleetcal_estimator::estimate::{Change, ChangeKind};
use fleetcal_estimator::geometry::wrap_angle_rad;
use fleetcal_robot::simulator::{Simulation, TrueParameters, Truth};
use serde::{Deserialize, Serialize};

use super::cell::{Cell, Scenario, Speed};
use super::outcome::{ChangeOutcome, ClaimsOutcome, Flagged, Outcome, Snapshot};
use super::robot::robot;
use crate::drive::{Robot, Seen, drive_watched};
use crate::error::EvaluationError;

/// Times at which an unchanged robot's claims are evaluated, s.
pub const CLAIMS_AT_S: [f64; 4] = [60.0, 120.0, 180.0, 600.0];
/// Distance that a robot drives after a change, m.
pub const AFTER_CHANGE_M: f64 = 40.0;
/// Distance after a change from which the alarm is due, m.
const ALARM_AFTER_M: f64 = 20.0;
/// Turn in which a moved LiDAR shows, rad: 20 mm become 15 mm between two poses, `2 sin(turn / 2)`
/// of it.
const TURNED_RAD: f64 = FRAC_PI_4;
/// Longest duration of a run after a change, s: a slower robot is stopped.
const AFTER_CHANGE_MAX_S: f64 = 400.0;

/// Duration of the robots' drives, and of their observation.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Watch {
    /// Length of an unchanged robot's run, s.
    pub length_s: f64,
    /// Time from which the estimator receives the robot's messages, s: 0 from its start at rest on.
    #[serde(default)]
    pub heard_from_s: f64,
    /// Distances between which a change happens, m; `None` after two to five minutes.
    #[serde(default)]
    pub changed_within_m: Option<(f64, f64)>,
}

impl Watch {
    /// Observes from the robot's start on.
    pub fn whole(length_s: f64) -> Self {
        Self {
            length_s,
            heard_from_s: 0.0,
            changed_within_m: None,
        }
    }
}

/// Drives the robot of a seed.
///
/// # Errors
/// Names the setting or message that is refused.
pub fn run(cell: Cell, seed: u64, watch: Watch) -> Result<Outcome, EvaluationError> {
    let (mut robot, change_s) = robot(cell, seed, watch.changed_within_m);
    robot.heard_from_s = watch.heard_from_s;
    match (cell.scenario, change_s) {
        (Scenario::Changed(_, speed), Some(changed_s)) => {
            changed(robot, changed_s, speed).map(|outcome| Outcome::Change(Box::new(outcome)))
        }
        _ => unchanged(robot, watch.length_s).map(Outcome::Claims),
    }
}

/// Converts a detection of an estimator that began this late: it counts from its first message on.
fn flagged(change: &Change, heard_from_s: f64) -> Flagged {
    Flagged {
        at_s: heard_from_s + change.time_s,
        kind: change.kind,
        cause: change.cause,
    }
}

fn unchanged(robot: Robot, length_s: f64) -> Result<ClaimsOutcome, EvaluationError> {
    let heard_from_s = robot.heard_from_s;
    let mut outcome = ClaimsOutcome {
        snapshots: Vec::new(),
        worst_claim: 0.0,
        converged_s: None,
        flagged: Vec::new(),
        length_s,
    };
    let mut due = CLAIMS_AT_S.into_iter().peekable();
    // The estimate told last before a moment is the one that holds at it.
    let driven = drive_watched(robot, length_s + 1.0, |time_s, seen, robot| {
        if let Seen::Estimate(estimate, _) = seen {
            let snapshot = Snapshot::of(time_s, estimate, &robot.parameters());
            outcome.worst_claim = outcome.worst_claim.max(snapshot.worst_claim());
            if snapshot.all_converged() {
                outcome.converged_s.get_or_insert(time_s);
            }
            if due.next_if(|at_s| *at_s <= time_s).is_some() {
                outcome.snapshots.push(snapshot);
            }
        }
        ControlFlow::Continue(())
    })?;
    let flagged = |change| flagged(change, heard_from_s);
    outcome.flagged = driven.changes.iter().map(flagged).collect();
    Ok(outcome)
}

fn changed(robot: Robot, changed_s: f64, speed: Speed) -> Result<ChangeOutcome, EvaluationError> {
    let mut way = Way::default();
    let heard_from_s = robot.heard_from_s;
    let mut outcome = ChangeOutcome {
        changed_s,
        before: None,
        too_early: Vec::new(),
        flag: None,
        faults: Vec::new(),
        turned_m: None,
        driven_m: 0.0,
        told: [0; 2],
        told_late: [0; 2],
        end: None,
    };
    let end_s = changed_s + AFTER_CHANGE_MAX_S.min(AFTER_CHANGE_M / speed.mps() * 3.0);
    let driven = drive_watched(robot, end_s, |time_s, seen, robot| {
        match seen {
            Seen::Message(emitted, _) => {
                way.drive(time_s, &emitted.truth_when_sent, changed_s);
            }
            Seen::Estimate(estimate, _) => {
                watch_claims(&mut outcome, time_s, way.since_change_m, estimate, robot);
            }
        }
        if way.since_change_m > AFTER_CHANGE_M {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    })?;
    outcome.driven_m = way.since_change_m;
    outcome.turned_m = way.turned_m;
    let flagged = |change| flagged(change, heard_from_s);
    sort_flags(&mut outcome, driven.changes.iter().map(flagged), &way);
    Ok(outcome)
}

fn watch_claims(
    outcome: &mut ChangeOutcome,
    time_s: f64,
    since_change_m: f64,
    estimate: &Estimate,
    robot: &Simulation,
) {
    let truth: TrueParameters = robot.parameters();
    let snapshot = Snapshot::of(time_s, estimate, &truth);
    if time_s < outcome.changed_s {
        outcome.before = Some(snapshot);
        return;
    }
    let count = |[told, wrong]: [u32; 2]| [told + 1, wrong + u32::from(snapshot.is_false())];
    outcome.told = count(outcome.told);
    if since_change_m > ALARM_AFTER_M {
        outcome.told_late = count(outcome.told_late);
    }
    outcome.end = Some(snapshot);
}

/// Sorts the detections: before the change, the first change after it, and faults.
fn sort_flags(outcome: &mut ChangeOutcome, flags: impl Iterator<Item = Flagged>, way: &Way) {
    for flagged in flags {
        if flagged.at_s < outcome.changed_s {
            outcome.too_early.push(flagged);
        } else if flagged.kind == ChangeKind::Fault {
            outcome.faults.push(flagged);
        } else if outcome.flag.is_none() {
            outcome.flag = Some((flagged, way.at_m(flagged.at_s)));
        }
    }
}

/// Distance driven since the change, at each second.
#[derive(Debug, Default)]
struct Way {
    last_s: Option<f64>,
    since_change_m: f64,
    /// Time, s, and distance since the change, m.
    marks: Vec<(f64, f64)>,
    /// Heading of the robot at the change, rad.
    yaw_rad: Option<f64>,
    /// Distance until its heading had turned by [`TURNED_RAD`], m.
    turned_m: Option<f64>,
}

impl Way {
    fn drive(&mut self, time_s: f64, truth: &Truth, changed_s: f64) {
        let last_s = self.last_s.replace(time_s).unwrap_or(time_s);
        if time_s < changed_s {
            return;
        }
        self.since_change_m += truth.speed_mps.abs() * (time_s - last_s);
        let yaw_rad = *self.yaw_rad.get_or_insert(truth.base.yaw_rad);
        if wrap_angle_rad(truth.base.yaw_rad - yaw_rad).abs() >= TURNED_RAD {
            self.turned_m.get_or_insert(self.since_change_m);
        }
        if self
            .marks
            .last()
            .is_none_or(|(at_s, _)| time_s - at_s > 0.1)
        {
            self.marks.push((time_s, self.since_change_m));
        }
    }

    /// Returns the distance driven until a time, m.
    fn at_m(&self, time_s: f64) -> f64 {
        let after = self.marks.partition_point(|(at_s, _)| *at_s < time_s);
        self.marks
            .get(after)
            .map_or(self.since_change_m, |(_, m)| *m)
    }
}
