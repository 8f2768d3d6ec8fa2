//! Alerts as the database has them. While instances of two versions share a database, the newer one
//! may have stored kinds and conditions that the older one does not know.

use fleetcal_model::{AlertId, Version, WallTime};
use fleetcal_proto::RobotId;
use serde::{Deserialize, Serialize};

use super::condition::ConditionName;
use super::kind::AlertKind;
use super::record::{Acknowledgement, Alert};
use super::subject::Subject;

/// Value of a list that newer versions extend.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Named<T> {
    /// Value that this version knows.
    Known(T),
    /// Name of a value that a newer version has added.
    Newer(String),
}

impl<T: Copy + Into<&'static str>> Named<T> {
    /// The name in documents and in the database.
    pub fn as_str(&self) -> &str {
        match self {
            Self::Known(value) => (*value).into(),
            Self::Newer(name) => name,
        }
    }
}

impl<T> From<T> for Named<T> {
    fn from(value: T) -> Self {
        Self::Known(value)
    }
}

impl Named<AlertKind> {
    /// Parses the name of a kind.
    pub fn kind(name: &str) -> Self {
        AlertKind::parse(name).map_or_else(|| Self::Newer(name.to_owned()), Self::Known)
    }
}

impl Named<ConditionName> {
    /// Parses the name of a condition.
    pub fn condition(name: &str) -> Self {
        ConditionName::parse(name).map_or_else(|| Self::Newer(name.to_owned()), Self::Known)
    }
}

/// Alert in the database.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum StoredAlert {
    /// Alert of a kind and condition that this version knows.
    Known(Box<Alert>),
    /// Alert of a newer version: it is shown, and only a newer version changes it.
    Newer(Box<NewerAlert>),
}

/// Alert whose kind or condition this version does not know.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub struct NewerAlert {
    /// Number that the store assigned.
    #[serde(skip)]
    pub id: AlertId,
    /// Rank in a list, which the newer version assigned.
    #[serde(skip)]
    pub rank: u32,
    /// Robot, or the fleet.
    pub robot: Subject,
    /// Robots of an alert about several.
    #[serde(default)]
    pub robots: Vec<RobotId>,
    /// Name of its kind.
    pub kind: String,
    /// Version, incremented with every change.
    pub version: Version,
    /// Condition of the alert.
    pub condition: NewerCondition,
    /// Time of the first observation, ns since 1970, wall time.
    pub began_ns: WallTime,
    /// Time at which it first alerted.
    pub alerted_ns: Option<WallTime>,
    /// Time at which it ended.
    pub ended_ns: Option<WallTime>,
    /// Description of the observation.
    pub what: String,
    /// Acknowledgement, once there is one.
    pub acknowledgement: Option<Acknowledgement>,
}

/// Condition of a [`NewerAlert`].
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub struct NewerCondition {
    /// Name of the condition.
    pub state: String,
    /// Begin of the condition, ns since 1970, wall time.
    pub since_ns: WallTime,
}

impl StoredAlert {
    /// Parses the record of a row, with its number and rank.
    ///
    /// # Errors
    /// The record is no alert of this version, and names no kind or condition of a newer one.
    pub fn parse(id: AlertId, rank: u32, record: &str) -> Result<Self, serde_json::Error> {
        let refused = match serde_json::from_str::<Alert>(record) {
            Ok(alert) => return Ok(Self::Known(Box::new(Alert { id, ..alert }))),
            Err(refused) => refused,
        };
        match serde_json::from_str::<NewerAlert>(record) {
            Ok(newer) if newer.has_a_new_name() => {
                Ok(Self::Newer(Box::new(NewerAlert { id, rank, ..newer })))
            }
            Ok(_) | Err(_) => Err(refused),
        }
    }

    /// The alert, if this version knows its kind and condition.
    pub fn known(self) -> Option<Alert> {
        match self {
            Self::Known(alert) => Some(*alert),
            Self::Newer(_) => None,
        }
    }

    /// Number that the store assigned.
    pub const fn id(&self) -> AlertId {
        match self {
            Self::Known(alert) => alert.id,
            Self::Newer(newer) => newer.id,
        }
    }

    /// Version, incremented with every change.
    pub const fn version(&self) -> Version {
        match self {
            Self::Known(alert) => alert.version,
            Self::Newer(newer) => newer.version,
        }
    }

    /// True if it is about a robot, alone or among several.
    pub fn is_about(&self, robot: &RobotId) -> bool {
        let (subject, several) = match self {
            Self::Known(alert) => (&alert.robot, &alert.robots),
            Self::Newer(newer) => (&newer.robot, &newer.robots),
        };
        subject.robot() == Some(robot) || several.contains(robot)
    }

    /// Rank in a list, the most urgent first.
    pub fn rank(&self) -> u32 {
        match self {
            Self::Known(alert) => alert.rank(),
            Self::Newer(newer) => newer.rank,
        }
    }
}

impl NewerAlert {
    fn has_a_new_name(&self) -> bool {
        AlertKind::parse(&self.kind).is_none()
            || ConditionName::parse(&self.condition.state).is_none()
    }
}
