//! Kinds of alerts about a robot.

use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr};

/// Kind of an alert about a robot, the worst first.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Serialize,
    Deserialize,
    EnumString,
    IntoStaticStr,
)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum AlertKind {
    /// Failed return to the former calibration.
    RollbackFailed,
    /// Significant difference of the vehicle from its approved calibration, or a change of the
    /// vehicle.
    Drift,
    /// Verification estimate that disagrees with the applied calibration.
    VerificationFailed,
    /// Two senders under the robot's id.
    TwoSenders,
    /// Messages of the robot on a former key.
    FormerKey,
    /// Answer in the robot's name that its own answer contradicts.
    FalseReport,
    /// Estimator stopped after too many failures.
    EstimatorFailed,
    /// No instance of the cluster estimates the robot.
    NoInstance,
    /// Approved calibration that the robot did not apply.
    NotApplied,
    /// Calibration in use that differs from the desired one.
    OutOfSync,
    /// Silence of a robot that was sending.
    NoData,
    /// Cause that a joining check names, or a failure of a sensor or of the LiDAR odometry that lasts.
    Fault,
    /// Significantly wrong values in use that were never approved from an estimate.
    Uncalibrated,
    /// Instances of the cluster that do not receive each other.
    RoutersCut,
    /// Different configurations of the cluster's instances.
    ConfigurationsDiffer,
    /// Clock of an instance that differs from the database's.
    ClockOff,
    /// All places of Zenoh sessions, or the share of one name or address, that are taken.
    SessionsFull,
}

impl AlertKind {
    /// Every kind.
    pub const ALL: [Self; 17] = [
        Self::RollbackFailed,
        Self::Drift,
        Self::VerificationFailed,
        Self::TwoSenders,
        Self::FormerKey,
        Self::FalseReport,
        Self::EstimatorFailed,
        Self::NoInstance,
        Self::NotApplied,
        Self::OutOfSync,
        Self::NoData,
        Self::Fault,
        Self::Uncalibrated,
        Self::RoutersCut,
        Self::ConfigurationsDiffer,
        Self::ClockOff,
        Self::SessionsFull,
    ];

    /// Kinds that follow from a robot's view and records.
    pub const OF_ROBOT: [Self; 12] = [
        Self::RollbackFailed,
        Self::Drift,
        Self::VerificationFailed,
        Self::TwoSenders,
        Self::FormerKey,
        Self::FalseReport,
        Self::EstimatorFailed,
        Self::NotApplied,
        Self::OutOfSync,
        Self::NoData,
        Self::Fault,
        Self::Uncalibrated,
    ];

    /// True if the rule reads the records alone, which every instance has, and nothing that arrives
    /// live.
    pub const fn reads_records_alone(self) -> bool {
        matches!(
            self,
            Self::RollbackFailed | Self::FalseReport | Self::NotApplied | Self::OutOfSync
        )
    }

    /// The name in documents and in the database.
    pub fn as_str(self) -> &'static str {
        self.into()
    }

    /// Parses the name of a kind.
    pub fn parse(name: &str) -> Option<Self> {
        name.parse().ok()
    }

    /// Severity of the kind.
    pub const fn severity(self) -> Severity {
        match self {
            Self::RollbackFailed => Severity::Critical,
            Self::Drift
            | Self::VerificationFailed
            | Self::TwoSenders
            | Self::FormerKey
            | Self::FalseReport
            | Self::EstimatorFailed
            | Self::NoInstance
            | Self::RoutersCut => Severity::Error,
            Self::NotApplied
            | Self::OutOfSync
            | Self::NoData
            | Self::Fault
            | Self::Uncalibrated
            | Self::ConfigurationsDiffer
            | Self::ClockOff
            | Self::SessionsFull => Severity::Warning,
        }
    }

    /// Advice for the person who looks after the alert.
    pub const fn advice(self) -> &'static str {
        match self {
            Self::RollbackFailed => {
                "Stop the robot and look at it where it stands: nobody knows that it drives with \
                 values that were proven. Then approve a calibration for it."
            }
            Self::Drift => {
                "Look at the robot's LiDAR mount and steering, and decide on its proposal once \
                 there is one."
            }
            Self::VerificationFailed => {
                "Compare the estimate with what the robot uses, look for a loose mount, and \
                 approve again or leave the former values in place."
            }
            Self::TwoSenders => {
                "Find the second robot, recording or program that sends under this id and stop it; \
                 an access list per robot (docs/zenoh.md) keeps others out."
            }
            Self::FormerKey => {
                "Have the robot send its wheel odometry, measured speed and steering, on \
                 fleet/{robot}/wheel_odometry instead of fleet/{robot}/drive. Message and encoding \
                 stay as they are (docs/upgrading.md)."
            }
            Self::FalseReport => {
                "Look on the robot at which calibration it uses, and decide what it should use. An \
                 access list per robot (docs/zenoh.md) keeps others from answering for it."
            }
            Self::EstimatorFailed => {
                "Read the service's log and restart the service: the robot's estimator then goes on \
                 from its last stored state."
            }
            Self::NoInstance => {
                "Look on the health page at which instances are there and reach a Zenoh router, and \
                 start one more: each takes robots that nobody has (docs/cluster.md)."
            }
            Self::NotApplied => {
                "Read the robot's reason, mend it on the robot, and propose the calibration again."
            }
            Self::OutOfSync => {
                "Find out who changed the calibration on the robot; roll it back or propose what \
                 it should use. One that uses what was taken back goes back by itself unless that \
                 was confirmed: if it does not, approve what it should use, and look at which \
                 router and which agents it has."
            }
            Self::NoData => {
                "Check that the robot is on and connected. Set maintenance on the page of one that \
                 was switched off on purpose: it does not alert until that ends."
            }
            Self::Fault => {
                "Follow the joining check; without one, look at the sensor, its cable and what it sees."
            }
            Self::Uncalibrated => {
                "Decide on the robot's proposal once there is one, or propose the present estimate. \
                 Acknowledge it where the values in use are meant to stay."
            }
            Self::RoutersCut => {
                "Mend the connection between the routers: robots are estimated meanwhile."
            }
            Self::ConfigurationsDiffer => {
                "Give all instances the same fleetcal.toml but for name and addresses, and restart them \
                 one after the other."
            }
            Self::ClockOff => {
                "Set the machine's clock, and see that it is kept by NTP: from 10 s on the instance \
                 gives up its robots."
            }
            Self::SessionsFull => {
                "Find out who opens so many sessions: a robot needs one. For many behind one bridge, \
                 raise sessions_per_name or sessions_per_address in fleetcal.toml."
            }
        }
    }
}

/// Severity of an alert, the worst first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "openapi", schema(as = AlertSeverity))]
pub enum Severity {
    /// Somebody must go to the robot now.
    Critical,
    /// The robot drives worse than it should.
    Error,
    /// Somebody should look at the robot.
    Warning,
}

impl Severity {
    /// The name in documents.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Critical => "critical",
            Self::Error => "error",
            Self::Warning => "warning",
        }
    }
}
