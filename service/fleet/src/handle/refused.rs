//! Reasons for which the fleet refuses requests.

use fleetcal_domain::limits;
use fleetcal_proto::RobotId;
use thiserror::Error;

/// Reason for which the fleet refused a request.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum FleetRefused {
    /// The robot is unknown: it is unconfigured and has sent nothing.
    #[error("no robot {0} is known")]
    UnknownRobot(RobotId),
    /// The robot is unregistered.
    #[error("robot {0} is not registered, expected a robot with a vehicle")]
    Unregistered(RobotId),
    /// The robot is registered.
    #[error("robot {0} is registered: it has checks and a top view of its own")]
    Registered(RobotId),
    /// The robot is retired.
    #[error("robot {0} is retired: bring it back first")]
    Retired(RobotId),
    /// Another instance estimates the robot, or none does at this moment.
    #[error("robot {0} is not estimated by this instance")]
    Elsewhere(RobotId),
    /// The fleet is full.
    #[error("{} robots are configured, which is the limit", limits::ROBOTS_MAX)]
    RobotsMax,
    /// The robot's estimator is stopped after too many faults.
    #[error(
        "the estimator of robot {0} is stopped, expected one that runs: restart the service, and \
         the estimator goes on from its last stored state"
    )]
    Stopped(RobotId),
    /// Too many notes wait for the robot.
    #[error("robot {0} has {max} notes that wait", max = limits::MAILBOX_NOTES_MAX)]
    NotesMax(RobotId),
    /// Too many requests for the robot's top view wait.
    #[error("{max} others wait for the top view of robot {0}", max = limits::TOP_VIEW_ASKERS_MAX)]
    TopViewAskersMax(RobotId),
    /// Too many other robots have a preview.
    #[error("{max} other robots than {0} have a preview", max = limits::PREVIEWS_MAX)]
    PreviewsMax(RobotId),
    /// The robot's messages could not be read for a preview.
    #[error("the preview of robot {0} failed, expected messages that can be read")]
    PreviewFailed(RobotId),
}
