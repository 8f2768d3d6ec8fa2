//! Tenure: the time for which one instance estimates one robot.

use std::fmt;

use fleetcal_proto::RobotId;
use serde::{Deserialize, Serialize};

use crate::InstanceId;

/// Life of an instance: incremented when it joins, and when it is declared dead.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize,
)]
#[serde(transparent)]
pub struct Incarnation(pub i64);

/// Seat: one life of an instance.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Seat {
    /// Name of the instance.
    pub instance: InstanceId,
    /// Life of the instance.
    pub incarnation: Incarnation,
}

/// Epoch that orders the tenures of a robot: a later one has a higher epoch, also after a failover
/// that lost the latest. Readers of estimates compare it.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize,
)]
#[serde(transparent)]
pub struct Epoch(pub i64);

/// Claim that distinguishes one tenure from every other: a random number. Two servers that both
/// assumed to be the primary can have assigned one epoch twice; the database therefore compares
/// this.
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

/// Tenure: the time for which one instance estimates one robot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tenure {
    /// Robot of the tenure.
    pub robot: RobotId,
    /// Seat of the owner.
    pub seat: Seat,
    /// Epoch among the robot's tenures.
    pub epoch: Epoch,
    /// Claim that distinguishes it from every other.
    pub claim: ClaimId,
}
