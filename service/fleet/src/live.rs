//! Live updates for listeners of the event stream.

use std::sync::Arc;

use fleetcal_domain::alert::Alert;
use fleetcal_domain::approval::Transition;
use fleetcal_domain::robot::{HistoryEvent, RobotState};
use fleetcal_model::RobotId;
use fleetcal_proto::estimate::EstimateDocument;

/// Update that listeners of the event stream receive at once.
#[derive(Debug, Clone, PartialEq)]
pub enum LiveUpdate {
    /// A robot's new estimate, at most one a second of message time.
    Estimate {
        /// The robot.
        robot: RobotId,
        /// The estimate.
        document: Arc<EstimateDocument>,
    },
    /// A robot's state, connection or configuration changed; at most one a second and robot.
    RobotState {
        /// The robot.
        robot: RobotId,
        /// The new state.
        state: RobotState,
        /// True if nothing has come for [`fleetcal_domain::limits::STALE_AFTER`].
        stale: bool,
        /// True if its liveliness token is present.
        alive: bool,
    },
    /// A record of a robot's life cycle changed, and its display should be refreshed.
    Approval {
        /// The robot.
        robot: RobotId,
    },
    /// An alert of a robot changed.
    Alert {
        /// The robot; `None` for an alert about several.
        robot: Option<RobotId>,
        /// The alert in its present state; one that is
        /// [`fleetcal_domain::alert::ConditionName::Normal`] is over.
        alert: Arc<Alert>,
    },
    /// The deployment freeze began or ended.
    Freeze,
    /// A roll-out changed.
    Rollout,
    /// The approval policy changed.
    Policy,
    /// An event of a robot.
    Event {
        /// The robot.
        robot: RobotId,
        /// The event.
        event: Arc<HistoryEvent>,
        /// The person or tool of the site that noted it; `None` for events of the robot, its
        /// estimator or the service.
        author: Option<String>,
    },
}

impl LiveUpdate {
    /// Makes the update that listeners receive about a transition of a robot's records.
    pub fn of_transition(robot: &RobotId, transition: &Transition) -> Self {
        match transition {
            Transition::Proposal(_) | Transition::Deployment(_) | Transition::Shadow(_) => {
                Self::Approval {
                    robot: robot.clone(),
                }
            }
        }
    }
}
