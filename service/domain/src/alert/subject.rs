//! Subject of an alert.

use std::fmt;

use fleetcal_proto::RobotId;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Subject that the database stores for the fleet; no robot's id can equal it.
const FLEET: &str = "*";

/// Subject of an alert: one robot, or several of the fleet at once.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Subject {
    /// Several robots, named in the alert.
    Fleet,
    /// One robot.
    Robot(RobotId),
}

impl Subject {
    /// The name in the database.
    pub fn as_str(&self) -> &str {
        match self {
            Self::Fleet => FLEET,
            Self::Robot(robot) => robot.as_str(),
        }
    }

    /// The robot; `None` for the fleet.
    pub const fn robot(&self) -> Option<&RobotId> {
        match self {
            Self::Fleet => None,
            Self::Robot(robot) => Some(robot),
        }
    }
}

impl From<RobotId> for Subject {
    fn from(robot: RobotId) -> Self {
        Self::Robot(robot)
    }
}

impl fmt::Display for Subject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl Serialize for Subject {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.as_str())
    }
}

impl<'de> Deserialize<'de> for Subject {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        if name == FLEET {
            return Ok(Self::Fleet);
        }
        let robot = RobotId::parse(&name).map_err(serde::de::Error::custom)?;
        Ok(Self::Robot(robot))
    }
}
