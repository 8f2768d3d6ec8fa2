//! State of a robot's estimator after its last sound message.

use fleetcal_estimator::Checkpoint;

/// State from which a task can continue after a fault.
#[derive(Debug, Clone)]
pub(super) struct Good {
    /// The robot's own estimator.
    pub(super) checkpoint: Checkpoint,
    /// True if a change was detected and the new values are not known yet.
    pub(super) changed: bool,
}
