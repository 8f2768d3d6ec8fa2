//! The look around, each second.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::{ChangeCause, ChangeKind};
use tokio::sync::broadcast;
use tokio::sync::broadcast::error::TryRecvError;
use tokio::time::MissedTickBehavior;

use super::Sentry;
use crate::alert::{Sighting, Situation, Step, sightings, step};
use crate::approval::{Deployment, RobotLedger};
use crate::fleet::{HistoryEvent, LiveUpdate, RobotView};
use crate::limits;
use crate::store::{AlertWrite, StoreError};

/// How often the robots are looked at.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// What the sentry remembers between two looks.
#[derive(Debug, Default)]
struct Memory {
    /// Each robot's records as they were last seen, and its newest deployment then.
    deployments: BTreeMap<RobotId, (Arc<RobotLedger>, Option<Deployment>)>,
    /// When each robot's estimator last told a fault, wall time, and what it came from.
    faults: BTreeMap<RobotId, (i64, &'static str)>,
}

/// Looks at every robot until the sentry stops.
pub(super) async fn watch(sentry: Sentry, mut live: broadcast::Receiver<LiveUpdate>) {
    let mut ticks = tokio::time::interval(LOOK_EVERY);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut memory = Memory::default();
    loop {
        tokio::select! {
            () = sentry.inner.stop.cancelled() => return,
            _ = ticks.tick() => {}
        }
        memory.hear(&mut live, sentry.inner.clock.now_ns());
        if let Err(error) = sentry.look(&mut memory).await {
            tracing::error!(%error, "the alerts could not be brought up to date");
        }
    }
}

impl Memory {
    /// Takes what the fleet told since the last look.
    fn hear(&mut self, live: &mut broadcast::Receiver<LiveUpdate>, now_ns: i64) {
        loop {
            match live.try_recv() {
                Ok(LiveUpdate::Event { robot, event }) => {
                    if let HistoryEvent::Change(change) = event.as_ref()
                        && change.kind == ChangeKind::Fault
                    {
                        self.faults.insert(robot, (now_ns, words(change.cause)));
                    }
                }
                Ok(_) => {}
                Err(TryRecvError::Lagged(lost)) => {
                    tracing::warn!(lost, "live updates passed the sentry by");
                }
                Err(TryRecvError::Empty | TryRecvError::Closed) => return,
            }
        }
    }
}

const fn words(cause: ChangeCause) -> &'static str {
    match cause {
        ChangeCause::Steering => "steering",
        ChangeCause::LidarMount => "LiDAR's mount",
        ChangeCause::Vehicle => "vehicle",
        ChangeCause::Odometry => "LiDAR odometry",
        ChangeCause::Unknown => "data, which do not tell what it came from",
    }
}

impl Sentry {
    /// Looks once at every robot and takes to the store what has changed.
    async fn look(&self, memory: &mut Memory) -> Result<(), StoreError> {
        let now_ns = self.inner.clock.now_ns();
        let approval = self.inner.clerk.policy();
        let mut seen = Vec::new();
        for view in self.inner.fleet.robots() {
            let ledger = self.inner.clerk.ledger(&view.id);
            let latest = self.latest(memory, &view.id, &ledger).await?;
            let situation = Situation {
                now_ns,
                view: &view,
                ledger: &ledger,
                latest: latest.as_ref(),
                fault: memory.faults.get(&view.id).copied(),
                approval: &approval,
                policy: &self.inner.policy,
            };
            let news = sightings(&situation);
            let news = news
                .into_iter()
                .filter(|one| self.is_news(&view, one, now_ns));
            seen.extend(news.map(|one| (view.id.clone(), one)));
            if seen.len() >= limits::ALERTS_AT_ONCE_MAX {
                break;
            }
        }
        if seen.is_empty() {
            return Ok(());
        }
        let write = AlertWrite::Observe {
            sightings: seen,
            policy: Arc::clone(&self.inner.policy),
            now_ns,
        };
        let changes = self.inner.store.write_alerts(write).await?;
        self.take(&changes);
        Ok(())
    }

    /// Whether a sighting changes anything. The store asks the same again of what it holds.
    fn is_news(&self, view: &RobotView, sighting: &Sighting, now_ns: i64) -> bool {
        let periods = self.inner.policy.periods(sighting.kind);
        let active = self.active();
        let before = active.get(&(view.id.clone(), sighting.kind));
        step(before, &view.id, sighting, now_ns, periods) != Step::Same
    }

    /// A robot's newest deployment; it is read anew when the robot's records have changed.
    async fn latest(
        &self,
        memory: &mut Memory,
        robot: &RobotId,
        ledger: &Arc<RobotLedger>,
    ) -> Result<Option<Deployment>, StoreError> {
        if ledger.live.is_some() || ledger.shadow.generation_last == 0 {
            return Ok(ledger.live.clone());
        }
        if let Some((seen, latest)) = memory.deployments.get(robot)
            && Arc::ptr_eq(seen, ledger)
        {
            return Ok(latest.clone());
        }
        let newest = self.inner.store.deployments(robot, None, 1).await?;
        let latest = newest.into_iter().next();
        let entry = (Arc::clone(ledger), latest.clone());
        memory.deployments.insert(robot.clone(), entry);
        Ok(latest)
    }
}
