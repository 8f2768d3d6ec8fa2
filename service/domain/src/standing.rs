//! Standing of a robot, in one word: from its estimate, the life cycle of its calibration and its
//! alerts.

use std::collections::{BTreeMap, BTreeSet};

use fleetcal_model::ParameterStatus;
use fleetcal_proto::RobotId;
use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr, VariantArray};

use crate::alert::{Alert, AlertKind, ConditionName};
use crate::approval::{DeploymentState, RobotLedger, Tolerance};
use crate::deviation::parts;
use crate::robot::{RobotState, RobotView};

/// Standing of a robot, the most urgent first; if several apply, the first in this list is
/// reported.
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
    VariantArray,
)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Standing {
    /// The previous calibration was not restored.
    RollbackFailed,
    /// Significant difference between the estimate and the approved calibration in use, or a
    /// changed vehicle.
    Drift,
    /// Verification estimate that disagrees with the applied calibration.
    VerificationFailed,
    /// Two senders under the robot's id.
    TwoSenders,
    /// Wheel odometry on a key that is no longer used.
    FormerKey,
    /// Answer in the robot's name that contradicts another.
    FalseReport,
    /// Estimator stopped after too many failures.
    EstimatorFailed,
    /// No instance of the cluster estimates the robot.
    NoInstance,
    /// Approved calibration that the robot did not apply.
    NotApplied,
    /// Calibration in use that differs from the expected one.
    OutOfSync,
    /// Failure of a sensor or of the LiDAR odometry.
    Fault,
    /// Robot that sends data, without a configured vehicle.
    Unregistered,
    /// Proposal that needs approval.
    AwaitingApproval,
    /// Approved values that are being sent, applied or verified.
    Deploying,
    /// Estimate outside the tolerance around the values in use, without proof, or not yet, that
    /// they have drifted.
    Uncalibrated,
    /// Configured robot of which nothing is known, since it has sent nothing. A robot that falls
    /// silent keeps its standing: its connection says that it is silent.
    NoData,
    /// Parameters that have not converged.
    Learning,
    /// Convergence of all observable parameters.
    Calibrated,
}

impl Standing {
    /// Every standing, the most urgent first.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// The name in documents and in `/metrics`.
    pub fn as_str(self) -> &'static str {
        self.into()
    }

    /// Parses the name of a standing.
    pub fn parse(name: &str) -> Option<Self> {
        name.parse().ok()
    }

    const fn of_state(state: RobotState) -> Self {
        match state {
            RobotState::Unregistered => Self::Unregistered,
            RobotState::NoData => Self::NoData,
            RobotState::Failed => Self::EstimatorFailed,
            RobotState::Changed => Self::Drift,
            RobotState::Learning => Self::Learning,
            RobotState::Calibrated => Self::Calibrated,
        }
    }

    const fn of_deployment(state: DeploymentState) -> Option<Self> {
        use DeploymentState as S;
        match state {
            S::Queued | S::Offered | S::Applied | S::Verifying | S::RollingBack => {
                Some(Self::Deploying)
            }
            S::RollbackFailed => Some(Self::RollbackFailed),
            S::Verified
            | S::Inconclusive
            | S::Refused
            | S::Failed
            | S::TimedOut
            | S::Withdrawn
            | S::RolledBack
            | S::Kept => None,
        }
    }

    /// Standing of a robot with an alert of this kind; `None` for a kind that concerns its
    /// connection, or no single robot.
    const fn of_alert(kind: AlertKind) -> Option<Self> {
        Some(match kind {
            AlertKind::RollbackFailed => Self::RollbackFailed,
            AlertKind::Drift => Self::Drift,
            AlertKind::VerificationFailed => Self::VerificationFailed,
            AlertKind::TwoSenders => Self::TwoSenders,
            AlertKind::FormerKey => Self::FormerKey,
            AlertKind::FalseReport => Self::FalseReport,
            AlertKind::EstimatorFailed => Self::EstimatorFailed,
            AlertKind::NoInstance => Self::NoInstance,
            AlertKind::NotApplied => Self::NotApplied,
            AlertKind::OutOfSync => Self::OutOfSync,
            AlertKind::Fault => Self::Fault,
            AlertKind::Uncalibrated => Self::Uncalibrated,
            AlertKind::NoData
            | AlertKind::RoutersCut
            | AlertKind::ConfigurationsDiffer
            | AlertKind::ClockOff
            | AlertKind::SessionsFull => {
                return None;
            }
        })
    }
}

/// Kinds of a robot's alerts that affect its standing.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RobotAlerts {
    /// Kinds that fire.
    alerting: BTreeSet<AlertKind>,
    /// Kinds that fired until the robot fell silent.
    stale: BTreeSet<AlertKind>,
}

impl RobotAlerts {
    /// Sets the condition of the alert of a kind.
    pub fn set(&mut self, kind: AlertKind, condition: ConditionName) {
        self.alerting.remove(&kind);
        self.stale.remove(&kind);
        self.add(kind, condition);
    }

    /// Adds an alert of a kind beside another one of it, such as one of the whole fleet.
    fn add(&mut self, kind: AlertKind, condition: ConditionName) {
        match condition {
            ConditionName::Alerting => self.alerting.insert(kind),
            ConditionName::NoData => self.stale.insert(kind),
            // It has not or no longer proven what it is about.
            ConditionName::Normal | ConditionName::Pending | ConditionName::Recovering => false,
        };
    }

    /// Alerts by robot, from all active alerts; robots without one are absent.
    pub fn by_robot<'a>(active: impl IntoIterator<Item = &'a Alert>) -> BTreeMap<RobotId, Self> {
        let mut found: BTreeMap<RobotId, Self> = BTreeMap::new();
        for alert in active {
            for robot in alert.robot.robot().into_iter().chain(&alert.robots) {
                let of_robot = found.entry(robot.clone()).or_default();
                of_robot.add(alert.kind, alert.condition.name());
            }
        }
        found
    }
}

/// Standing of a robot without its alerts, and the facts that alerts change it by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StandingBasis {
    without_alerts: Standing,
    /// True if its last estimate is outside the tolerance around the values in use.
    is_beyond: bool,
}

impl StandingBasis {
    /// Standing of a robot by its view and its records. `propose_beyond` is the tolerance of the
    /// policy.
    pub fn of(view: &RobotView, ledger: &RobotLedger, propose_beyond: &Tolerance) -> Self {
        let deployment = ledger.live.as_ref();
        let verdict = deployment.and_then(|live| live.verification.as_ref());
        let so = [
            Some(Standing::of_state(view.state)),
            deployment.and_then(|live| Standing::of_deployment(live.state)),
            verdict
                .filter(|verdict| !verdict.within)
                .map(|_| Standing::VerificationFailed),
            ledger.open.as_ref().map(|_| Standing::AwaitingApproval),
            // Nobody looks after a robot that stands well beside a value that is off.
            (view.state == RobotState::Calibrated && is_off(view, ledger, propose_beyond))
                .then_some(Standing::Uncalibrated),
        ];
        let least = so.into_iter().flatten().min();
        Self {
            without_alerts: least.unwrap_or(Standing::Learning),
            is_beyond: is_beyond(view, ledger, propose_beyond),
        }
    }

    /// Standing with these alerts: the most urgent that applies.
    pub fn with(self, alerts: &RobotAlerts) -> Standing {
        let alerting = alerts.alerting.iter();
        let alerting = alerting.filter_map(|kind| Standing::of_alert(*kind));
        // The values of a silent robot can be compared without it: of those inside the tolerance
        // nobody says any more that they are wrong.
        let stale = alerts.stale.iter();
        let stale = stale.filter(|kind| {
            let compares = matches!(kind, AlertKind::Drift | AlertKind::Uncalibrated);
            !compares || self.is_beyond
        });
        let stale = stale.filter_map(|kind| Standing::of_alert(*kind));
        let least = alerting.chain(stale).min();
        least.map_or(self.without_alerts, |least| least.min(self.without_alerts))
    }
}

/// True if a part of the last estimate is outside the tolerance around the values in use, or there
/// is no estimate.
fn is_beyond(view: &RobotView, ledger: &RobotLedger, tolerance: &Tolerance) -> bool {
    let mut parts = parts(view, ledger, tolerance).into_iter().flatten();
    view.estimate.is_none() || parts.any(|part| part.is_beyond())
}

/// True if a known value is outside the tolerance around the values in use.
fn is_off(view: &RobotView, ledger: &RobotLedger, tolerance: &Tolerance) -> bool {
    let mut parts = parts(view, ledger, tolerance).into_iter().flatten();
    parts.any(|part| part.status == ParameterStatus::Converged && part.is_beyond())
}

#[cfg(test)]
mod tests;
