//! Record of an alert.

use fleetcal_model::{AlertId, Version, WallTime};
use fleetcal_proto::RobotId;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::condition::{Condition, ConditionName, Observation, Periods};
use super::kind::AlertKind;
use super::rules::Sighting;
use super::subject::Subject;

/// Shortest time between two updates of an alert's description, ns.
const RETOLD_EVERY_NS: i64 = 10 * 1_000_000_000;

/// Acknowledgement of an alert.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Acknowledgement {
    /// Person or tool that acknowledged it.
    pub by: String,
    /// Time of the acknowledgement, ns since 1970, wall time.
    pub at_ns: WallTime,
    /// Note of the person.
    pub note: Option<String>,
}

/// Present or past problem of one robot, or of several at once. A robot has at most one active
/// alert of a kind.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Alert {
    /// Number that the store assigns; 0 before that.
    #[serde(skip)]
    pub id: AlertId,
    /// Robot, or the fleet.
    pub robot: Subject,
    /// Robots of an alert about several.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub robots: Vec<RobotId>,
    /// Kind of problem.
    pub kind: AlertKind,
    /// Version, incremented with every change.
    pub version: Version,
    /// Condition of the alert.
    pub condition: Condition,
    /// Time of the first observation, ns since 1970, wall time.
    pub began_ns: WallTime,
    /// Time at which it first alerted; `None` while it is pending.
    pub alerted_ns: Option<WallTime>,
    /// Time at which it ended; `None` while it is active.
    pub ended_ns: Option<WallTime>,
    /// Description of the observation; of an alert that no longer fires, the last one.
    pub what: String,
    /// Time at which the description was updated, ns since 1970, wall time.
    #[serde(default)]
    pub told_ns: WallTime,
    /// Acknowledgement, once there is one.
    pub acknowledgement: Option<Acknowledgement>,
}

/// Published change of an alert.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Notice {
    /// First alert of the problem.
    Alerting,
    /// End of the alert.
    Resolved,
}

/// Effect of a sighting on an alert.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Step {
    /// No change.
    Same,
    /// Same condition, with an updated description.
    Retold(Box<Alert>),
    /// New or changed alert, with the notice to publish, if any.
    Changed(Box<Alert>, Option<Notice>),
    /// Pending alert that came to nothing and need not be kept.
    Dropped,
}

/// Reason for which an acknowledgement was refused; nothing has changed then.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum AlertRefused {
    /// Unknown number.
    #[error("no alert {0} is known")]
    Unknown(AlertId),
    /// Alert changed since it was read.
    #[error("it is at version {found} now: it changed since you opened it")]
    Stale {
        /// Present version.
        found: Version,
    },
    /// Alert that is acknowledged already.
    #[error("{0} has acknowledged this already")]
    AcknowledgedAlready(String),
}

/// Applies a sighting to the active alert of a robot and kind; `before` is `None` without one.
pub fn step(
    before: Option<&Alert>,
    robot: &Subject,
    sighting: &Sighting,
    now: WallTime,
    periods: Periods,
) -> Step {
    let began = Condition::Normal { since_ns: now };
    let was = before.map_or(began, |alert| alert.condition);
    let condition = was.after(sighting.observation, now, periods);
    if condition.name() == was.name() {
        return before.map_or(Step::Same, |alert| retold(alert, sighting, now));
    }
    let is_over = condition.name() == ConditionName::Normal;
    let mut alert = match before {
        Some(alert) if is_over && alert.alerted_ns.is_none() => return Step::Dropped,
        Some(alert) => alert.clone(),
        None => Alert {
            id: AlertId(0),
            robot: robot.clone(),
            robots: Vec::new(),
            kind: sighting.kind,
            version: Version(0),
            condition,
            began_ns: now,
            alerted_ns: None,
            ended_ns: None,
            what: String::new(),
            told_ns: now,
            acknowledgement: None,
        },
    };
    alert.version = alert.version.next();
    alert.condition = condition;
    if sighting.observation == Observation::Firing {
        alert.say(sighting, now);
    }
    let mut notice = None;
    if condition.name() == ConditionName::Alerting && alert.alerted_ns.is_none() {
        alert.alerted_ns = Some(now);
        notice = Some(Notice::Alerting);
    }
    if is_over {
        alert.ended_ns = Some(now);
        notice = Some(Notice::Resolved);
    }
    Step::Changed(Box::new(alert), notice)
}

/// Updates the description with the sighting. The version stays, since there is nothing new to
/// decide.
fn retold(before: &Alert, sighting: &Sighting, now: WallTime) -> Step {
    let says_more = before.what != sighting.what || before.robots != sighting.robots;
    let is_due = now.ns_since(before.told_ns) >= RETOLD_EVERY_NS;
    if sighting.observation != Observation::Firing || !says_more || !is_due {
        return Step::Same;
    }
    let mut alert = before.clone();
    alert.say(sighting, now);
    Step::Retold(Box::new(alert))
}

impl Alert {
    fn say(&mut self, sighting: &Sighting, now: WallTime) {
        self.what.clone_from(&sighting.what);
        self.robots.clone_from(&sighting.robots);
        self.told_ns = now;
    }

    /// True if it has not ended.
    pub const fn is_active(&self) -> bool {
        self.ended_ns.is_none()
    }

    /// Rank in a list, the most urgent first: active alerts by kind, then pending ones, then ended
    /// ones.
    pub fn rank(&self) -> u32 {
        let active = AlertKind::OF_ROBOT.len() as u32;
        match self.condition.name() {
            ConditionName::Normal => active + 1,
            ConditionName::Pending => active,
            ConditionName::Alerting | ConditionName::Recovering | ConditionName::NoData => {
                // The place stands in rows: kinds that came later share one with others.
                let kind = match self.kind {
                    AlertKind::NoInstance | AlertKind::RoutersCut => AlertKind::EstimatorFailed,
                    AlertKind::ConfigurationsDiffer
                    | AlertKind::ClockOff
                    | AlertKind::SessionsFull => AlertKind::Fault,
                    kind => kind,
                };
                let place = AlertKind::OF_ROBOT.iter().position(|one| *one == kind);
                place.map_or(active, |place| place as u32)
            }
        }
    }

    /// Acknowledges the alert, in any condition.
    ///
    /// # Errors
    /// [`AlertRefused::Stale`] if it is not at `version`, [`AlertRefused::AcknowledgedAlready`].
    pub fn acknowledge(
        &self,
        version: Version,
        acknowledgement: Acknowledgement,
    ) -> Result<Self, AlertRefused> {
        if version != self.version {
            let found = self.version;
            return Err(AlertRefused::Stale { found });
        }
        if let Some(first) = &self.acknowledgement {
            return Err(AlertRefused::AcknowledgedAlready(first.by.clone()));
        }
        Ok(Self {
            version: self.version.next(),
            acknowledgement: Some(acknowledgement),
            ..self.clone()
        })
    }
}
