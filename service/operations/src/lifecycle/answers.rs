//! Answers of robots.

use std::sync::PoisonError;
use std::sync::atomic::Ordering;

use fleetcal_domain::access::Actor;
use fleetcal_domain::approval::Command;
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::Applied;
use fleetcal_store::StoreError;

use super::Lifecycle;

impl Lifecycle {
    /// Queues a robot's answer. It never blocks, as it runs on the link's receiving threads. The
    /// robot repeats a lost answer, because it is not confirmed.
    pub fn take_answer(&self, robot: &RobotId, applied: Applied) {
        if !self.is_registered(robot) {
            tracing::debug!(robot.id = %robot, "an answer of a robot that is not registered");
            return;
        }
        let now = self.inner.clock.elapsed();
        if !self.inner.answers.put(robot, applied, now) {
            self.inner.lost_answers.fetch_add(1, Ordering::Relaxed);
            self.log_loss(robot, "an answer beyond the robot's limit was dropped", "");
        }
    }

    /// Counts an answer that cannot be decoded.
    pub fn refuse_answer(&self, robot: &RobotId, reason: &str) {
        self.inner
            .unreadable_answers
            .fetch_add(1, Ordering::Relaxed);
        self.log_loss(robot, "an answer cannot be read", reason);
    }

    fn is_registered(&self, robot: &RobotId) -> bool {
        let view = self.inner.fleet.robot(robot);
        view.is_some_and(|view| view.config.is_some())
    }

    /// Logs a loss, once a minute for each robot and kind.
    fn log_loss(&self, robot: &RobotId, kind: &'static str, reason: &str) {
        let registered = self.is_registered(robot).then_some(robot);
        let now = self.inner.clock.elapsed();
        let losses = self.inner.losses.lock();
        let mut losses = losses.unwrap_or_else(PoisonError::into_inner);
        if let Some(unsaid) = losses.take(registered, kind, now) {
            tracing::warn!(robot.id = %robot, unsaid, reason, "{kind}");
        }
    }

    /// Stores a robot's answer.
    ///
    /// # Errors
    /// [`StoreError::Refused`] if it fits no record, or the database's failure.
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

    /// True if an answer may be stored: it repeats the robot's last one, or is the first about the
    /// deployment under way, or the robot has sent few new ones.
    fn may_store(&self, robot: &RobotId, applied: &Applied) -> bool {
        let ledger = self.ledger(robot);
        let reported = ledger.shadow.reported.as_ref();
        let says_the_same = reported.is_some_and(|last| {
            (last.generation, last.status, last.at_ns)
                == (applied.generation, applied.status, applied.applied_at_ns)
                && (&last.sha256, &last.reason) == (&applied.sha256, &applied.reason)
        });
        let is_awaited = ledger.live.as_ref().is_some_and(|live| {
            live.offer.generation == applied.generation
                && live.offer.sha256 == applied.sha256
                && reported.is_none_or(|last| last.generation != applied.generation)
        });
        let now = self.inner.clock.elapsed();
        says_the_same || is_awaited || self.inner.answers.has_room_for_news(robot, now)
    }
}

/// Stores queued answers until the lifecycle stops.
pub(super) async fn hear(lifecycle: Lifecycle) {
    loop {
        let (robot, applied) = tokio::select! {
            received = lifecycle.inner.answers.next() => received,
            () = lifecycle.inner.stop.cancelled() => return,
        };
        if !lifecycle.may_store(&robot, &applied) {
            lifecycle.inner.lost_answers.fetch_add(1, Ordering::Relaxed);
            lifecycle.log_loss(&robot, "an answer beyond the robot's limit was dropped", "");
            continue;
        }
        let actor = Actor::robot(&robot);
        if let Err(error) = lifecycle.acknowledge(&robot, applied, actor).await {
            lifecycle.log_loss(&robot, "an answer was not stored", &error.to_string());
        }
    }
}
