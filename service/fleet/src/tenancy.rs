//! Tenancy of a robot: whether its task runs here, and how it is ended.

use fleetcal_model::RobotId;
use tokio::sync::watch;
use tokio::task::JoinHandle;

/// State that is kept of a robot that another instance adopts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Keep {
    /// The waiting items are processed, and the estimator's state is stored.
    State,
    /// Nothing: another instance estimates the robot already.
    Nothing,
}

/// Task of a robot, if any.
#[derive(Debug, Default)]
pub enum Tenancy {
    /// There is no task.
    #[default]
    None,
    /// A task is to begin from this state, once the robot's configuration is known.
    Awaited(Option<Vec<u8>>),
    /// There is a task.
    Running(Running),
}

/// A robot's task.
#[derive(Debug)]
pub struct Running {
    /// Channel that ends it.
    leave: watch::Sender<Option<Keep>>,
    ended: JoinHandle<()>,
}

impl Running {
    /// Makes the handle of a task that ends on a value of `leave`.
    pub const fn new(leave: watch::Sender<Option<Keep>>, ended: JoinHandle<()>) -> Self {
        Self { leave, ended }
    }

    /// Ends the task of `robot`, which has ended on return. The mailbox has to be closed before,
    /// and woken by `wake`.
    pub async fn end(self, robot: &RobotId, keep: Keep, wake: impl FnOnce()) {
        self.leave.send_replace(Some(keep));
        wake();
        if let Err(error) = self.ended.await {
            tracing::error!(robot.id = %robot, %error, "the robot's task failed");
        }
    }
}
