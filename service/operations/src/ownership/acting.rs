//! Execution of an instance's plan: claims, releases and take-overs.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use fleetcal_cluster::{
    ClaimId, Handover, InstanceId, Listening, Member, Plan, Seat, Silence, Snapshot, Takeover,
    Tenure, plan,
};
use fleetcal_domain::limits;
use fleetcal_fleet::Keep;
use fleetcal_proto::RobotId;
use fleetcal_store::StoreError;
use fleetcal_store::cluster::{RowsVersion, TakeForDead};
use tokio::time::MissedTickBehavior;

use super::Ownership;

/// Memory between two looks at the rows.
#[derive(Debug, Default)]
struct Memory {
    version: Option<RowsVersion>,
    rows: Snapshot,
    silence: Silence,
    listening: Listening,
    /// True if the last look failed.
    failing: bool,
}

/// Looks at the rows and acts until the cluster is left.
pub(super) async fn attend(ownership: Ownership) {
    let mut ticks = tokio::time::interval(limits::CLUSTER_LOOK_EVERY);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut memory = Memory::default();
    loop {
        tokio::select! {
            () = ownership.inner.stop.cancelled() => return,
            () = ownership.inner.seat_lost.notified() => ownership.lose(&mut memory).await,
            _ = ticks.tick() => {}
        }
        let looked = ownership.look(&mut memory).await;
        match (&looked, memory.failing) {
            (Err(error), false) => tracing::error!(%error, "the cluster cannot be followed"),
            (Ok(()), true) => tracing::info!("the cluster is followed again"),
            _ => {}
        }
        memory.failing = looked.is_err();
    }
}

/// Waits until this instance has no robot any more, or no other instance can have its robots.
pub(super) async fn until_nothing_is_left(ownership: &Ownership) {
    let cluster = &ownership.inner.cluster;
    loop {
        let snapshot = cluster.snapshot();
        let seat = cluster.seat();
        let could_take = |member: &&Member| member.is_live() && !member.draining && member.linked;
        let mut others = snapshot.members.iter().filter(could_take);
        let has_others = others.any(|member| Some(&member.seat) != seat.as_ref());
        if cluster.tenures().is_empty() || !has_others {
            return;
        }
        tokio::time::sleep(limits::CLUSTER_LOOK_EVERY).await;
    }
}

impl Ownership {
    /// Looks at the rows once, and acts.
    async fn look(&self, memory: &mut Memory) -> Result<(), StoreError> {
        let Some(seat) = self.inner.cluster.seat() else {
            return self.join().await;
        };
        let snapshot = self.read(memory).await?;
        if snapshot.member(&seat).is_none() {
            self.lose(memory).await;
            return Ok(());
        }
        self.take_for_dead(&seat, &snapshot, &mut memory.silence)
            .await?;
        self.listen(&seat, &snapshot, &mut memory.listening);
        self.follow(&seat, &snapshot, &memory.listening).await?;
        let plan = plan(&seat, &snapshot);
        self.perform(&seat, plan).await
    }

    /// Reads the rows.
    async fn read(&self, memory: &mut Memory) -> Result<Arc<Snapshot>, StoreError> {
        let setup = &self.inner.setup;
        let asked_at = setup.clock.uptime();
        let look = self.inner.registry.look(memory.version).await?;
        self.inner.cluster.answered(asked_at);
        if look.is_whole {
            memory.rows = look.snapshot;
            memory.version = Some(look.version);
        } else {
            memory.rows.now = look.snapshot.now;
            memory.rows.members = look.snapshot.members;
        }
        let snapshot = Arc::new(memory.rows.clone());
        self.inner.cluster.read(Arc::clone(&snapshot));
        Ok(snapshot)
    }

    /// Declares instances dead whose lease or connection has ended.
    async fn take_for_dead(
        &self,
        seat: &Seat,
        snapshot: &Snapshot,
        silence: &mut Silence,
    ) -> Result<(), StoreError> {
        let setup = &self.inner.setup;
        let others = || {
            snapshot
                .members
                .iter()
                .filter(|member| member.seat != *seat)
        };
        let mut ended = Vec::new();
        if self.may_judge_others() && others().any(|member| !member.is_live() && !member.is_ended) {
            let which = TakeForDead::LeaseEnded;
            ended.extend(self.inner.registry.take_for_dead(seat, which).await?);
        }
        let gone = self.gone(others(), silence);
        if !gone.is_empty() {
            let which = TakeForDead::Gone(&gone);
            ended.extend(self.inner.registry.take_for_dead(seat, which).await?);
        }
        for ended in ended {
            let of_ended = |row: &&fleetcal_cluster::Ownership| row.owner.as_ref() == Some(&ended);
            let robots = snapshot.robots.values().filter(of_ended).count();
            let from = ended.instance.clone();
            tracing::warn!(instance = %from.as_str(), robots, "an instance was declared dead");
            let at = setup.clock.now();
            self.inner.cluster.took_over(Takeover { from, at, robots });
        }
        Ok(())
    }

    /// Instances that have a lease, and no liveliness token or no heartbeats, by this instance's
    /// link.
    fn gone<'a>(
        &self,
        others: impl Iterator<Item = &'a Member>,
        silence: &mut Silence,
    ) -> Vec<InstanceId> {
        let setup = &self.inner.setup;
        let link = setup.link.borrow();
        if !setup.fast_takeover || !link.linked {
            return Vec::new();
        }
        let now = setup.clock.uptime();
        let could_be = |member: &&Member| member.linked && member.is_live();
        let others = others.filter(could_be);
        let (present, absent): (BTreeSet<_>, BTreeSet<_>) = others
            .map(|member| member.seat.instance.clone())
            .partition(|instance| link.present.contains(instance));
        let silent = present.into_iter();
        let silent = silent.filter(|instance| link.is_silent(instance, now));
        let silent = silence.lasting(silent.collect(), now);
        // Who was cut off from the database, as all are when it fails over, takes the lock of its name
        // again with its next renewal.
        let may_judge = self.may_judge_others();
        let silent = silent.into_iter().filter(|_| may_judge);
        absent.into_iter().chain(silent).collect()
    }

    /// Begins the tenures that this instance has by the rows, and drops those that it has not.
    async fn follow(
        &self,
        seat: &Seat,
        snapshot: &Snapshot,
        listening: &Listening,
    ) -> Result<(), StoreError> {
        let cluster = &self.inner.cluster;
        let own = snapshot.duties.iter();
        let own = own.filter(|(_, row)| row.owner.as_ref() == Some(seat));
        let duties: BTreeSet<_> = own.map(|(duty, _)| *duty).collect();
        self.inner
            .setup
            .store
            .set_retention(duties.contains(&fleetcal_cluster::Duty::Retention));
        cluster.set_duties(duties);
        let present = cluster.tenures();
        let own = snapshot.robots.iter();
        let own = own.filter(|(_, row)| row.owner.as_ref() == Some(seat));
        let mut begun = Vec::new();
        for (robot, row) in own {
            let tenure = Tenure {
                robot: robot.clone(),
                seat: seat.clone(),
                epoch: row.epoch,
                claim: row.claim,
            };
            match present.get(robot) {
                None => begun.push(tenure),
                // A promotion of the database raised it.
                Some(known) if *known != tenure => {
                    self.inner.setup.store.claims().set(&tenure);
                    cluster.began(tenure);
                }
                Some(_) => {}
            }
        }
        let is_own = |robot: &RobotId| {
            let row = snapshot.robots.get(robot);
            row.is_some_and(|row| row.owner.as_ref() == Some(seat))
        };
        let gone: Vec<_> = present.keys().filter(|robot| !is_own(robot)).collect();
        self.drop_robots(&gone).await;
        let is_to_be = |robot: &RobotId| {
            let row = snapshot.robots.get(robot);
            row.is_some_and(|row| row.heir.as_ref() == Some(seat))
        };
        let mut unneeded = self.inner.setup.fleet.heard().unwrap_or_default();
        let is_needed =
            |robot: &RobotId| is_own(robot) || is_to_be(robot) || listening.listens_to(robot);
        unneeded.retain(|robot| !is_needed(robot));
        let unneeded: Vec<_> = unneeded.into_iter().collect();
        if !unneeded.is_empty() {
            self.inner.setup.fleet.unhear(&unneeded);
        }
        self.adopt(begun).await
    }

    /// Stops the estimators of robots that other instances have by now; none of their states are
    /// stored.
    async fn drop_robots(&self, robots: &[&RobotId]) {
        let setup = &self.inner.setup;
        for robot in robots {
            setup.store.claims().remove(robot);
            self.inner.cluster.ended(robot);
        }
        for robot in robots {
            setup.fleet.release(robot, Keep::Nothing).await;
        }
    }

    async fn perform(&self, seat: &Seat, plan: Plan) -> Result<(), StoreError> {
        let registry = &self.inner.registry;
        if !plan.claim_duties.is_empty() {
            registry.claim_duties(seat, &plan.claim_duties).await?;
        }
        if !plan.give_up_duties.is_empty() {
            registry.free_duties(seat, &plan.give_up_duties).await?;
        }
        self.claim(seat, plan.claim).await?;
        self.prepare(seat, &plan.prepare).await?;
        self.name_heirs(seat, plan.offer, plan.withdraw).await?;
        self.hand_over(seat, plan.hand_over).await?;
        self.give_up(seat, plan.give_up).await
    }

    /// Claims robots without an owner.
    async fn claim(&self, seat: &Seat, robots: Vec<RobotId>) -> Result<(), StoreError> {
        if robots.is_empty() {
            return Ok(());
        }
        let claims = robots.into_iter().map(|robot| Ok((robot, self.draw()?)));
        let claims = claims.collect::<Result<Vec<_>, StoreError>>()?;
        let tenures = self.inner.registry.claim(seat, &claims).await?;
        self.adopt(tenures).await
    }

    /// Begins tenures: each robot's estimator continues from its stored state.
    async fn adopt(&self, tenures: Vec<Tenure>) -> Result<(), StoreError> {
        if tenures.is_empty() {
            return Ok(());
        }
        let setup = &self.inner.setup;
        let robots: Vec<_> = tenures.iter().map(|tenure| tenure.robot.clone()).collect();
        setup.fleet.hear(&robots);
        let stored = setup.store.load_checkpoints_of(&robots).await?;
        let mut stored: BTreeMap<_, _> = stored
            .into_iter()
            .map(|record| (record.robot, record.state))
            .collect();
        for tenure in tenures {
            setup.store.claims().set(&tenure);
            self.inner.cluster.began(tenure.clone());
            setup
                .fleet
                .adopt(&tenure.robot, stored.remove(&tenure.robot));
            setup.lifecycle.tell_fleet_again(&tenure.robot);
        }
        setup.store.adopted(&robots);
        tracing::info!(robots = robots.len(), "robots taken over");
        Ok(())
    }

    /// Subscribes to robots whose heir this instance is, and confirms that they are received.
    async fn prepare(&self, seat: &Seat, robots: &[RobotId]) -> Result<(), StoreError> {
        if robots.is_empty() {
            return Ok(());
        }
        let setup = &self.inner.setup;
        setup.fleet.hear(robots);
        for robot in robots {
            let subscribed = setup.fleet.subscribed(robot);
            let in_time = tokio::time::timeout(limits::CLUSTER_SUBSCRIBED_WITHIN, subscribed);
            if in_time.await.is_err() {
                tracing::warn!(robot.id = %robot, "subscribing took too long, and is tried again");
                return Ok(());
            }
        }
        self.inner.registry.note_ready(seat, robots).await
    }

    async fn name_heirs(
        &self,
        seat: &Seat,
        offer: Vec<Handover>,
        withdraw: Vec<RobotId>,
    ) -> Result<(), StoreError> {
        let named = offer.into_iter().map(|one| (one.robot, Some(one.to)));
        let nobody = withdraw.into_iter().map(|robot| (robot, None));
        let heirs: Vec<_> = named.chain(nobody).collect();
        if heirs.is_empty() {
            return Ok(());
        }
        self.inner.registry.name_heirs(seat, &heirs).await
    }

    /// Ends tenures and passes them on. A robot whose hand-over fails is still this instance's by
    /// the rows, and the next look begins its tenure again.
    async fn hand_over(&self, seat: &Seat, moves: Vec<Handover>) -> Result<(), StoreError> {
        if moves.is_empty() {
            return Ok(());
        }
        let robots: Vec<_> = moves.iter().map(|one| one.robot.clone()).collect();
        self.end(&robots).await?;
        let passed = moves
            .into_iter()
            .map(|one| Ok((one.robot, one.to, self.draw()?)));
        let passed = passed.collect::<Result<Vec<_>, StoreError>>()?;
        let went = self.inner.registry.hand_over(seat, &passed).await?;
        tracing::info!(robots = went.len(), "robots handed over");
        Ok(())
    }

    async fn give_up(&self, seat: &Seat, robots: Vec<RobotId>) -> Result<(), StoreError> {
        if robots.is_empty() {
            return Ok(());
        }
        self.end(&robots).await?;
        tracing::warn!(
            robots = robots.len(),
            "robots released: this instance does not receive them, or its clock is too far off the \
             database's"
        );
        self.inner.registry.free(seat, &robots).await
    }

    /// Stops the estimators of robots and stores their states.
    async fn end(&self, robots: &[RobotId]) -> Result<(), StoreError> {
        let setup = &self.inner.setup;
        for robot in robots {
            setup.fleet.release(robot, Keep::State).await;
        }
        let flushed = setup.store.flush().await;
        for robot in robots {
            setup.store.claims().remove(robot);
            self.inner.cluster.ended(robot);
        }
        flushed
    }

    /// Drops all tenures: other instances have the robots by now.
    async fn lose(&self, memory: &mut Memory) {
        memory.version = None;
        let had = self.inner.cluster.lost();
        self.note_connected(None);
        tracing::warn!(
            robots = had.len(),
            "this instance was declared dead, and joins again"
        );
        self.drop_robots(&had.keys().collect::<Vec<_>>()).await;
    }

    /// Stores the states of all robots and leaves.
    pub(super) async fn give_up_everything(&self) -> Result<(), StoreError> {
        let robots: Vec<_> = self.inner.cluster.tenures().into_keys().collect();
        let ended = self.end(&robots).await;
        let Some(seat) = self.inner.cluster.seat() else {
            return ended;
        };
        ended?;
        self.inner.registry.leave(&seat).await
    }

    /// Random claim of a tenure.
    fn draw(&self) -> Result<ClaimId, StoreError> {
        let drawn = (self.inner.setup.draw)();
        drawn.map(ClaimId).map_err(|error| StoreError::Server {
            database: "of the cluster".to_owned(),
            reason: format!("cannot be asked: the system gives no random bytes: {error}"),
        })
    }
}
