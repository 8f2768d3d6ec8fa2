//! The time for which one instance estimates one robot.

use std::fmt;

use fleetcal_proto::RobotId;
use serde::{Deserialize, Serialize};

use crate::InstanceId;

/// The life of an instance: goes up when it joins, and when it is taken for dead.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize,
)]
#[serde(transparent)]
pub struct Incarnation(pub i64);

/// One life of an instance.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Seat {
    /// Which instance.
    pub instance: InstanceId,
    /// Which of its lives.
    pub incarnation: Incarnation,
}

/// Orders the tenures of a robot: a later one has a higher epoch, also after a failover that forgot
/// the latest. Readers of estimates go by it.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize,
)]
#[serde(transparent)]
pub struct Epoch(pub i64);

/// Tells one tenure from every other: a random number. Two servers that both took themselves for
/// the primary can have given out one epoch twice; the database therefore compares this.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize,
)]
#[serde(transparent)]
pub struct ClaimId(pub i64);

impl fmt::Display for Epoch {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(formatter)
    }
}

/// The time for which one instance estimates one robot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tenure {
    /// Whose estimator it is about.
    pub robot: RobotId,
    /// Which life of which instance has it.
    pub seat: Seat,
    /// Its place among the robot's tenures.
    pub epoch: Epoch,
    /// What tells it from every other.
    pub claim: ClaimId,
}
