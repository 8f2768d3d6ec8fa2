//! One thing that is or was wrong with one robot.

use fleetcal_model::{AlertId, Version, WallTime};
use fleetcal_proto::RobotId;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::condition::{Condition, ConditionName, Observation, Periods};
use super::kind::AlertKind;
use super::rules::Sighting;
use super::subject::Subject;

/// The words of an alert are written down again at most this often, ns.
const RETOLD_EVERY_NS: i64 = 10 * 1_000_000_000;

/// Who has taken an alert on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Acknowledgement {
    /// Who.
    pub by: String,
    /// When, ns since 1970, wall time.
    pub at_ns: WallTime,
    /// What the person has to say.
    pub note: Option<String>,
}

/// One thing that is or was wrong with one robot, or with several at once. A robot has one active
/// alert of a kind at most.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Alert {
    /// Its number; the store gives it, and 0 stands for none yet.
    #[serde(skip)]
    pub id: AlertId,
    /// Whose.
    pub robot: Subject,
    /// The robots of an alert that is about several.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub robots: Vec<RobotId>,
    /// What.
    pub kind: AlertKind,
    /// Goes up with every change of it.
    pub version: Version,
    /// Where it stands.
    pub condition: Condition,
    /// When it was first seen, ns since 1970, wall time.
    pub began_ns: WallTime,
    /// When it first alerted; `None` while it is pending.
    pub alerted_ns: Option<WallTime>,
    /// When it was over; `None` while it is active.
    pub ended_ns: Option<WallTime>,
    /// What is seen, in words; of an alert that no longer fires, what was seen last.
    pub what: String,
    /// When that was written down, ns since 1970, wall time.
    #[serde(default)]
    pub told_ns: WallTime,
    /// Who has taken it on.
    pub acknowledgement: Option<Acknowledgement>,
}

/// What people are told of a change.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Notice {
    /// It alerts for the first time.
    Alerting,
    /// It is over.
    Resolved,
}

/// What a sighting makes of an alert.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Step {
    /// Nothing has changed.
    Same,
    /// Where it stands is the same, and its words are others.
    Retold(Box<Alert>),
    /// It is new or has changed, and people are told.
    Changed(Box<Alert>, Option<Notice>),
    /// It was pending and came to nothing: it need not be kept.
    Dropped,
}

/// Why an acknowledgement was refused; nothing has changed then.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum AlertRefused {
    /// No alert has this number.
    #[error("no alert {0} is known")]
    Unknown(AlertId),
    /// It has changed since it was looked at.
    #[error("it is at version {found} now: it changed since you opened it")]
    Stale {
        /// The version it is at.
        found: Version,
    },
    /// Somebody has taken it on already.
    #[error("{0} has acknowledged this already")]
    AcknowledgedAlready(String),
}

/// Moves the active alert of a robot and kind on; `before` is `None` while there is none.
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

/// The words follow what is seen, so that they say what is so now; its version stays, because
/// nobody has to decide again.
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

    /// Whether it is not over.
    pub const fn is_active(&self) -> bool {
        self.ended_ns.is_none()
    }

    /// Its place in a list, the most urgent first: active ones by kind, then those that are pending,
    /// then those that are over.
    pub fn rank(&self) -> u32 {
        let active = AlertKind::OF_ROBOT.len() as u32;
        match self.condition.name() {
            ConditionName::Normal => active + 1,
            ConditionName::Pending => active,
            ConditionName::Alerting | ConditionName::Recovering | ConditionName::NoData => {
                // The place stands in rows: kinds that came later share one with others.
                let kind = match self.kind {
                    AlertKind::NoInstance => AlertKind::EstimatorFailed,
                    AlertKind::ConfigurationsDiffer | AlertKind::ClockOff => AlertKind::Fault,
                    kind => kind,
                };
                let place = AlertKind::OF_ROBOT.iter().position(|one| *one == kind);
                place.map_or(active, |place| place as u32)
            }
        }
    }

    /// The alert with somebody who takes it on, whatever its condition.
    ///
    /// # Errors
    /// [`AlertRefused::Stale`] when it is not at `version`, [`AlertRefused::AcknowledgedAlready`].
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
