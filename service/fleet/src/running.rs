//! Running of a robot's task, from its start to its end.

use std::sync::Arc;
use std::time::Duration;

use fleetcal_domain::limits::{
    CLUSTER_OVERLAP, TASK_IDLE_ROUNDS, TASK_ROUND, TASK_ROUND_WHEEL_ODOMETRY_MAX,
};
use fleetcal_estimator::Event;
use tokio::sync::watch;

use crate::registry::Fleet;
use crate::robot::Robot;
use crate::task::RobotTask;
use crate::tenancy::{Keep, Running};

/// Begins the task of a robot, which continues from a stored state.
pub fn begin(fleet: &Arc<Fleet>, robot: Arc<Robot>, stored: Option<Vec<u8>>) -> Running {
    let (leave, told) = watch::channel(None);
    let ended = fleet
        .tasks
        .spawn(run(Arc::clone(fleet), robot, stored, told));
    Running::new(leave, ended)
}

/// Runs until the fleet stops or another instance takes over the robot, and the mailbox is empty.
async fn run(
    fleet: Arc<Fleet>,
    robot: Arc<Robot>,
    stored: Option<Vec<u8>>,
    mut leave: watch::Receiver<Option<Keep>>,
) {
    let Some((version, config)) = robot.versioned_config() else {
        return;
    };
    let mut task = RobotTask::start(fleet, robot, version, &config, stored.as_deref());
    let mut idle_rounds = TASK_IDLE_ROUNDS;
    loop {
        idle_rounds = idle_rounds.saturating_add(1);
        let mut drives = 0_usize;
        while let Some(item) = task.robot.mailbox.take() {
            idle_rounds = 0;
            drives = if item.is_wheel_odometry() {
                drives + 1
            } else {
                0
            };
            task.take(item);
            // A scan takes a millisecond: let the API and the other robots have theirs. The drive
            // samples before it are integrated in one go.
            if drives.is_multiple_of(TASK_ROUND_WHEEL_ODOMETRY_MAX) {
                task.answer_top_view_askers();
                tokio::task::yield_now().await;
            }
        }
        if task.fleet.stop.is_cancelled() || leave.borrow().is_some() {
            break;
        }
        tokio::select! {
            () = task.next_round(idle_rounds) => {}
            () = task.fleet.stop.cancelled() => {}
            Ok(()) = leave.changed() => {}
        }
        task.follow_config();
        task.answer_top_view_askers();
    }
    let keep = *leave.borrow();
    if keep == Some(Keep::State) {
        task.let_out_what_nobody_else_heard();
    }
    if keep != Some(Keep::Nothing) {
        task.save_checkpoint();
    }
    drop(task.robot.top_view_askers.take());
}

impl RobotTask {
    /// Waits for the next round, or for an item that does not wait for it; after some rounds
    /// without a message, for the next message.
    async fn next_round(&self, idle_rounds: u32) {
        if idle_rounds > TASK_IDLE_ROUNDS {
            self.robot.mailbox.arrived().await;
            return;
        }
        let round_ns = TASK_ROUND.as_nanos() as u64;
        let since_ns = self.fleet.clock.elapsed().as_nanos() as u64 % round_ns;
        tokio::select! {
            () = tokio::time::sleep(Duration::from_nanos(round_ns - since_ns)) => {}
            () = self.robot.mailbox.pressing() => {}
        }
    }

    /// Flushes the merger, as at the end of a session, for a robot that has been silent for half of
    /// [`CLUSTER_OVERLAP`]. The next instance receives the robot only for that long before it
    /// begins, so the last messages of a silent robot may be older.
    fn let_out_what_nobody_else_heard(&mut self) {
        let quiet = self.robot.quiet_for(&*self.fleet.clock);
        if quiet.is_some_and(|quiet| quiet >= CLUSTER_OVERLAP / 2) {
            self.step(Event::EndOfSession);
        }
    }
}
