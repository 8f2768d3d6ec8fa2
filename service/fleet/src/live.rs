//! Live updates for listeners of the event stream.

use std::sync::Arc;

use fleetcal_domain::alert::Alert;
use fleetcal_domain::approval::Transition;
use fleetcal_domain::robot::{HistoryEvent, RobotState};
use fleetcal_model::RobotId;
use fleetcal_proto::estimate::EstimateDocument;

/// Something that a listener of the event stream wants to know at once.
#[derive(Debug, Clone, PartialEq)]
pub enum LiveUpdate {
    /// A robot's new estimate, at most one a second of message time.
    Estimate {
        /// Whose.
        robot: RobotId,
        /// What.
        document: Arc<EstimateDocument>,
    },
    /// A robot's state, connection or configuration changed; at most one a second and robot.
    RobotState {
        /// Whose.
        robot: RobotId,
        /// The new state.
        state: RobotState,
        /// Whether nothing has come for [`fleetcal_domain::limits::STALE_AFTER`].
        stale: bool,
        /// Whether its liveliness token stands.
        alive: bool,
    },
    /// A record of a robot's life cycle changed: what is shown of it should be read again.
    Approval {
        /// Whose.
        robot: RobotId,
    },
    /// An alert of a robot changed.
    Alert {
        /// Whose; `None` of one that is about several.
        robot: Option<RobotId>,
        /// The alert as it stands now; one that is [`fleetcal_domain::alert::ConditionName::Normal`] is over.
        alert: Arc<Alert>,
    },
    /// The deployment freeze began or ended.
    Freeze,
    /// The approval policy changed.
    Policy,
    /// Something happened to a robot.
    Event {
        /// Whose.
        robot: RobotId,
        /// What.
        event: Arc<HistoryEvent>,
        /// The person or tool of the site that noted it; `None` of what the robot, its estimator or the
        /// service says.
        author: Option<String>,
    },
}

impl LiveUpdate {
    /// What listeners are told of a transition of a robot's records.
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
