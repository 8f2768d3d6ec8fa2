//! Follower of other instances' decisions. Each decision, configuration and note leaves a row in
//! the audit, whose numbers have no gap and increase in the order of commits: the audit is the feed
//! of changes.

use std::collections::BTreeSet;
use std::sync::Arc;

use fleetcal_cluster::{Duty, Membership};
use fleetcal_domain::limits;
use fleetcal_domain::robot::HistoryEvent;
use fleetcal_fleet::FleetHandle;
use fleetcal_fleet::live::LiveUpdate;
use fleetcal_model::AuditId;
use fleetcal_proto::RobotId;
use fleetcal_proto::event::RobotEvent;
use fleetcal_store::{AuditRow, Store, StoreError};
use tokio::time::MissedTickBehavior;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::alert_evaluator::AlertEvaluator;
use crate::lifecycle::Lifecycle;
use crate::notes;

/// Parts that the follower uses.
#[derive(Debug, Clone)]
pub struct FollowingSetup {
    /// Store of the audit.
    pub store: Store,
    /// Robots of the fleet.
    pub fleet: FleetHandle,
    /// Records of the robots.
    pub lifecycle: Lifecycle,
    /// Evaluator of the robots' alerts.
    pub evaluator: AlertEvaluator,
    /// Membership of this process in the cluster.
    pub membership: Membership,
}

/// Task that follows the audit.
#[derive(Debug, Clone)]
pub struct Following {
    stop: CancellationToken,
    tasks: TaskTracker,
}

impl Following {
    /// Follows the decisions after `last`, the newest row before the records were first read.
    pub fn start(setup: FollowingSetup, last: AuditId) -> Self {
        let following = Self {
            stop: CancellationToken::new(),
            tasks: TaskTracker::new(),
        };
        let stop = following.stop.clone();
        following.tasks.spawn(follow(setup, last, stop));
        following
    }

    /// Ends the task.
    pub async fn stop(&self) {
        self.stop.cancel();
        self.tasks.close();
        self.tasks.wait().await;
    }
}

async fn follow(setup: FollowingSetup, mut last: AuditId, stop: CancellationToken) {
    let mut ticks = tokio::time::interval(limits::CLUSTER_FOLLOW_EVERY);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut failing = false;
    loop {
        tokio::select! {
            () = stop.cancelled() => return,
            _ = ticks.tick() => {}
        }
        let followed = setup.step(&mut last).await;
        match (&followed, failing) {
            (Err(error), false) => tracing::error!(%error, "others' decisions cannot be read"),
            (Ok(()), true) => tracing::info!("others' decisions are read again"),
            _ => {}
        }
        failing = followed.is_err();
    }
}

/// Records that rows of the audit make outdated.
#[derive(Debug, Default, PartialEq, Eq)]
struct Outdated {
    ledgers: BTreeSet<RobotId>,
    configurations: BTreeSet<RobotId>,
    freeze: bool,
    policy: bool,
    rollout: bool,
    notes: Vec<(RobotId, RobotEvent, String)>,
}

impl Outdated {
    fn of(rows: &[AuditRow]) -> Self {
        let mut outdated = Self::default();
        for row in rows {
            let robot = row.robot.as_deref();
            let robot = robot.and_then(|robot| RobotId::parse(robot).ok());
            match (row.subject.as_str(), robot) {
                ("proposal" | "deployment" | "shadow", Some(robot)) => {
                    outdated.ledgers.insert(robot);
                }
                ("robot", Some(robot)) => {
                    outdated.configurations.insert(robot);
                }
                ("event", Some(robot)) => {
                    let note = notes::event_of(row);
                    let note = note.map(|note| (robot, note, row.actor.clone()));
                    outdated.notes.extend(note);
                }
                ("freeze", _) => outdated.freeze = true,
                ("policy", _) => outdated.policy = true,
                ("rollout", _) => outdated.rollout = true,
                _ => {}
            }
        }
        outdated
    }
}

impl FollowingSetup {
    /// Reads the new rows, and updates the outdated records.
    async fn step(&self, last: &mut AuditId) -> Result<(), StoreError> {
        let rows = self
            .store
            .audit_after(*last, limits::CLUSTER_FOLLOWED_MAX)
            .await?;
        if let Some(newest) = rows.last() {
            self.take(Outdated::of(&rows)).await?;
            *last = newest.id;
        }
        if !self.membership.does(Duty::Alerts) {
            self.evaluator.read_again().await?;
        }
        Ok(())
    }

    async fn take(&self, outdated: Outdated) -> Result<(), StoreError> {
        for robot in &outdated.configurations {
            let record = self.store.load_robot(robot).await?;
            if let Some(config) = record.and_then(|record| record.config)
                && let Err(refused) = self.fleet.configure(robot, config)
            {
                tracing::error!(robot.id = %robot, %refused, "the robots exceed the limit");
            }
        }
        let ledgers: Vec<_> = outdated.ledgers.into_iter().collect();
        self.lifecycle.reload(&ledgers).await?;
        if outdated.freeze {
            self.lifecycle.reload_freeze().await?;
        }
        if outdated.policy {
            self.lifecycle.reload_policy().await?;
        }
        if outdated.rollout {
            self.fleet.announce(LiveUpdate::Rollout);
        }
        for (robot, note, author) in outdated.notes {
            if self.membership.has(&robot) {
                notes::bring(&self.store, &self.fleet, &robot).await?;
            }
            self.fleet.announce(LiveUpdate::Event {
                robot,
                event: Arc::new(HistoryEvent::Note(note)),
                author: Some(author),
            });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use fleetcal_model::{NoteKind, RobotTime, WallTime};

    use super::*;

    fn row(subject: &str, robot: Option<&str>, after: Option<serde_json::Value>) -> AuditRow {
        AuditRow {
            id: AuditId(1),
            at_ns: WallTime(0),
            actor: "ana".to_owned(),
            authentication: "session".to_owned(),
            role: None,
            request: None,
            address: None,
            action: String::new(),
            subject: subject.to_owned(),
            subject_id: "1".to_owned(),
            robot: robot.map(str::to_owned),
            before: None,
            after,
            reason: None,
            link: None,
        }
    }

    #[test]
    fn rows_say_what_is_out_of_date() {
        let a = RobotId::parse("a").unwrap();
        let note = serde_json::json!({"kind": "reassembled", "stamp_ns": 7, "note": "LiDAR"});
        let outdated = Outdated::of(&[
            row("user", None, None),
            row("deployment", Some("a"), None),
            row("robot", Some("a"), None),
            row("event", Some("a"), Some(note)),
            row("event", Some("a"), None),
            row("policy", None, None),
        ]);
        let event = RobotEvent {
            kind: NoteKind::Reassembled,
            stamp_ns: RobotTime(7),
            note: "LiDAR".to_owned(),
        };
        let expected = Outdated {
            ledgers: BTreeSet::from([a.clone()]),
            configurations: BTreeSet::from([a.clone()]),
            freeze: false,
            policy: true,
            rollout: false,
            notes: vec![(a, event, "ana".to_owned())],
        };
        assert_eq!(outdated, expected);
    }
}
