//! Periodic evaluation of the rules, each second.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use fleetcal_cluster::{Cluster, Duty, cluster_sightings};
use fleetcal_domain::alert::{
    AlertKind, Sighting, Situation, Step, Subject, group_silent, sessions_full, sightings, step,
};
use fleetcal_domain::approval::{Deployment, RobotLedger};
use fleetcal_domain::limits;
use fleetcal_domain::robot::HistoryEvent;
use fleetcal_fleet::live::LiveUpdate;
use fleetcal_model::{Cause, ChangeKind, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_store::StoreError;
use tokio::sync::broadcast;
use tokio::sync::broadcast::error::TryRecvError;
use tokio::time::MissedTickBehavior;

use super::{AlertEvaluator, Observe};

/// Interval of the evaluations.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// Memory of the alert evaluator between two evaluations.
#[derive(Debug, Default)]
struct Memory {
    /// Last read records of each robot, and its newest deployment at that time.
    deployments: BTreeMap<RobotId, (Arc<RobotLedger>, Option<Deployment>)>,
    /// Time and source of the last fault that each robot's estimator reported, wall time.
    faults: BTreeMap<RobotId, (WallTime, &'static str)>,
}

/// Evaluates every robot until the alert evaluator stops.
pub(super) async fn watch(evaluator: AlertEvaluator, mut live: broadcast::Receiver<LiveUpdate>) {
    let mut ticks = tokio::time::interval(LOOK_EVERY);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut memory = Memory::default();
    let mut had_duty = false;
    loop {
        tokio::select! {
            () = evaluator.inner.stop.cancelled() => return,
            _ = ticks.tick() => {}
        }
        memory.hear(&mut live, evaluator.inner.clock.now());
        if !evaluator.may_look() {
            had_duty = false;
            continue;
        }
        let seen = async {
            // What the instance before has written is committed, or is refused by its fence.
            if !had_duty && evaluator.inner.membership.cluster().is_some() {
                evaluator.read_again().await?;
            }
            evaluator.look(&mut memory).await
        };
        match seen.await {
            Ok(()) => had_duty = true,
            Err(error) => tracing::error!(%error, "the alerts could not be updated"),
        }
    }
}

impl Memory {
    /// Processes the fleet's updates since the last evaluation.
    fn hear(&mut self, live: &mut broadcast::Receiver<LiveUpdate>, now: WallTime) {
        loop {
            match live.try_recv() {
                Ok(LiveUpdate::Event { robot, event, .. }) => {
                    if let HistoryEvent::Change(change) = event.as_ref()
                        && change.kind == ChangeKind::Fault
                    {
                        self.faults.insert(robot, (now, words(change.cause)));
                    }
                }
                Ok(_) => {}
                Err(TryRecvError::Lagged(lost)) => {
                    tracing::warn!(lost, "the alert evaluator missed live updates");
                }
                Err(TryRecvError::Empty | TryRecvError::Closed) => return,
            }
        }
    }
}

const fn words(cause: Cause) -> &'static str {
    match cause {
        Cause::Steering => "steering",
        Cause::LidarMount => "LiDAR's mount",
        Cause::Vehicle => "vehicle",
        Cause::Odometry => "LiDAR odometry",
        Cause::Unknown => "data, which do not tell what it came from",
    }
}

/// True if robots reach this instance, by its last row.
fn is_linked(cluster: &Cluster) -> bool {
    let snapshot = cluster.snapshot();
    let seat = cluster.seat();
    let own = seat.as_ref().and_then(|seat| snapshot.member(seat));
    own.is_some_and(|own| own.linked)
}

/// Robots of instances that this one does not receive: their data do not arrive here.
fn out_of_sight(cluster: &Cluster) -> BTreeSet<RobotId> {
    let snapshot = cluster.snapshot();
    let seat = cluster.seat();
    let Some(own) = seat.as_ref().and_then(|seat| snapshot.member(seat)) else {
        return BTreeSet::new();
    };
    let unheard = &own.hearing.unheard_instances;
    let rows = snapshot.robots.iter();
    let theirs = rows.filter(|(_, row)| {
        let owner = row.owner.as_ref();
        owner.is_some_and(|owner| unheard.contains(&owner.instance))
    });
    theirs.map(|(robot, _)| robot.clone()).collect()
}

impl AlertEvaluator {
    /// True if the duty is this instance's and robots reach it: otherwise it would find all of them
    /// silent.
    fn may_look(&self) -> bool {
        let inner = &self.inner;
        let membership = &inner.membership;
        membership.does(Duty::Alerts)
            && membership
                .cluster()
                .is_none_or(|cluster| is_linked(cluster))
            && membership.may_act(inner.clock.uptime())
    }

    /// Evaluates every robot once and passes the changes to the store.
    async fn look(&self, memory: &mut Memory) -> Result<(), StoreError> {
        // Of the life in which it looks: a duty of another one says nothing of what was seen in this.
        let cluster = self.inner.membership.cluster();
        let evaluator = cluster.and_then(|cluster| cluster.seat());
        if cluster.is_some() && evaluator.is_none() {
            return Ok(());
        }
        let now = self.inner.clock.now();
        let approval = self.inner.lifecycle.policy();
        let standings = self.standings();
        let mut standing = BTreeMap::new();
        let mut seen = Vec::new();
        let mut set_up = 0;
        let out_of_sight = cluster.map(|cluster| out_of_sight(cluster));
        let out_of_sight = out_of_sight.unwrap_or_default();
        for view in self.inner.fleet.robots() {
            set_up += usize::from(view.config.is_some());
            let ledger = self.inner.lifecycle.ledger(&view.id);
            let latest = self.latest(memory, &view.id, &ledger).await?;
            let situation = Situation {
                now,
                watched_since_ns: self.inner.since_ns,
                view: &view,
                in_sight: !out_of_sight.contains(&view.id),
                ledger: &ledger,
                latest: latest.as_ref(),
                fault: memory.faults.get(&view.id).copied(),
                approval: &approval,
                policy: &self.inner.policy,
            };
            let subject = || Subject::Robot(view.id.clone());
            seen.extend(sightings(&situation).map(|one| (subject(), one)));
            standing.insert(view.id.clone(), standings.basis(&view, &ledger));
        }
        self.group(&mut seen, set_up);
        if let Some(cluster) = cluster {
            seen.extend(cluster_sightings(&cluster.snapshot(), &self.inner.policy));
        }
        let crowded = self.inner.fleet.peers().crowded();
        seen.push(sessions_full(crowded, &self.inner.policy));
        seen.retain(|(subject, one)| self.is_news(subject, one, now));
        seen.truncate(limits::ALERTS_AT_ONCE_MAX);
        if seen.is_empty() {
            return Ok(());
        }
        let of_seen = seen.iter().filter_map(|(subject, _)| {
            let robot = subject.robot()?;
            let stands = (*standing.get(robot)?, standings.alerts(robot));
            Some((robot.clone(), stands))
        });
        let standing = of_seen.collect();
        let write = Observe {
            sightings: seen,
            policy: Arc::clone(&self.inner.policy),
            standing,
            evaluator,
            now,
        };
        let changes = self.inner.store.transact(write).await?;
        self.take(&changes);
        Ok(())
    }

    /// Merges robots that fell silent together into one sighting.
    fn group(&self, seen: &mut Vec<(Subject, Sighting)>, set_up: usize) {
        let active = self.active();
        let kind = AlertKind::NoData;
        let is_grouped = active.contains_key(&(Subject::Fleet, kind));
        group_silent(seen, set_up, is_grouped, |robot| {
            let own = active.get(&(Subject::Robot(robot.clone()), kind));
            own.is_some_and(|own| own.alerted_ns.is_some())
        });
    }

    /// True if a sighting changes anything. The store repeats this check on its own records.
    fn is_news(&self, subject: &Subject, sighting: &Sighting, now: WallTime) -> bool {
        let periods = self.inner.policy.periods(sighting.kind);
        let active = self.active();
        let before = active.get(&(subject.clone(), sighting.kind));
        step(before, subject, sighting, now, periods) != Step::Same
    }

    /// Newest deployment of a robot; it is read again after a change of the robot's records.
    async fn latest(
        &self,
        memory: &mut Memory,
        robot: &RobotId,
        ledger: &Arc<RobotLedger>,
    ) -> Result<Option<Deployment>, StoreError> {
        if ledger.live.is_some() || ledger.shadow.generation_last.is_factory() {
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
