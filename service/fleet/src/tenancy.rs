//! Tenancy of a robot: whether its task runs here, and how it is ended.

use fleetcal_model::RobotId;
use tokio::sync::watch;
use tokio::task::JoinHandle;

/// What is kept of a robot that another instance gets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Keep {
    /// What waits is worked through, and the estimator's state is stored.
    State,
    /// Nothing: another instance has the robot already.
    Nothing,
}

/// Whether a robot has a task.
#[derive(Debug, Default)]
pub enum Tenancy {
    /// It has none.
    #[default]
    None,
    /// It is to have one that goes on from this, once its configuration is known.
    Awaited(Option<Vec<u8>>),
    /// It has one.
    Running(Running),
}

/// A robot's task.
#[derive(Debug)]
pub struct Running {
    /// Tells it to end.
    leave: watch::Sender<Option<Keep>>,
    ended: JoinHandle<()>,
}

impl Running {
    /// A task that ends once it is told by `leave`.
    pub const fn new(leave: watch::Sender<Option<Keep>>, ended: JoinHandle<()>) -> Self {
        Self { leave, ended }
    }

    /// Ends the task of `robot`; it has ended when this returns. The mailbox has to be closed
    /// before, and woken by `wake`.
    pub async fn end(self, robot: &RobotId, keep: Keep, wake: impl FnOnce()) {
        self.leave.send_replace(Some(keep));
        wake();
        if let Err(error) = self.ended.await {
            tracing::error!(robot.id = %robot, %error, "the robot's task failed");
        }
    }
}
