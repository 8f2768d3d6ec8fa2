//! Robots' answers.

use std::sync::atomic::Ordering;

use fleetcal_domain::access::Actor;
use fleetcal_domain::approval::Command;
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::Applied;
use fleetcal_store::StoreError;
use tokio::sync::mpsc;

use super::Clerk;

impl Clerk {
    /// Takes a robot's answer. It never blocks: this runs on the link's receiving threads. An
    /// answer that is lost comes again, because it is not confirmed.
    pub fn take_answer(&self, robot: &RobotId, applied: Applied) {
        let known = self
            .inner
            .fleet
            .robot(robot)
            .is_some_and(|view| view.config.is_some());
        if !known {
            tracing::debug!(robot.id = %robot, "an answer of a robot that is not registered");
            return;
        }
        let robot = robot.clone();
        if self.inner.answers.try_send((robot, applied)).is_err() {
            self.inner.lost_answers.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Stores a robot's answer.
    ///
    /// # Errors
    /// [`StoreError::Refused`] when it fits no record, or the database's failure.
    pub async fn acknowledge(
        &self,
        robot: &RobotId,
        applied: Applied,
        actor: Actor,
    ) -> Result<(), StoreError> {
        let command = Command::Acknowledge(applied);
        let decided = self.decide(robot, command, actor, None).await;
        decided.map(|_| ()).inspect_err(|error| {
            if matches!(error, StoreError::Refused(_)) {
                self.inner.refused_answers.fetch_add(1, Ordering::Relaxed);
            }
        })
    }
}

/// Stores what comes until the clerk stops.
pub(super) async fn hear(clerk: Clerk, mut inbox: mpsc::Receiver<(RobotId, Applied)>) {
    loop {
        let received = tokio::select! {
            received = inbox.recv() => received,
            () = clerk.inner.stop.cancelled() => return,
        };
        let Some((robot, applied)) = received else {
            return;
        };
        let actor = Actor::robot(&robot);
        if let Err(error) = clerk.acknowledge(&robot, applied, actor).await {
            tracing::warn!(robot.id = %robot, %error, "a robot's answer was not stored");
        }
    }
}
