//! Progress of roll-outs, each second, from what the database holds: the steps that are due, and
//! the approvals that the begun waves release. An instance releases the robots that it estimates.

use std::collections::BTreeMap;
use std::time::Duration;

use fleetcal_domain::access::Actor;
use fleetcal_domain::approval::Command;
use fleetcal_domain::limits;
use fleetcal_fleet::live::LiveUpdate;
use fleetcal_model::{RolloutId, Version};
use fleetcal_rollout::{Followed, Rollout, RolloutRefused, RolloutState, Stage, due};
use fleetcal_store::{RolloutFilter, StoreError};
use tokio::time::MissedTickBehavior;

use super::Lifecycle;
use super::decide::Release;
use super::rollouts::{AdvanceRollout, ChangeRollout, RolloutChange, StartRollout};

/// Interval of the looks at running roll-outs.
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// Looks between two attempts to release a robot whose approval was refused.
const TRIED_EVERY_LOOKS: u32 = 10;

/// Versions of the running roll-outs at the last look, and the looks since they changed.
#[derive(Debug, Default)]
struct Looked(BTreeMap<RolloutId, (Version, u32)>);

impl Looked {
    /// True if the robots of a roll-out are to be released now: it has changed, or it is their turn
    /// again.
    fn is_turn(&mut self, rollout: &Rollout) -> bool {
        let (version, looks) = self.0.entry(rollout.id).or_default();
        if *version != rollout.version {
            (*version, *looks) = (rollout.version, 0);
        }
        let is_turn = looks.is_multiple_of(TRIED_EVERY_LOOKS);
        *looks = looks.wrapping_add(1);
        is_turn
    }
}

/// Advances the running roll-outs until the lifecycle stops.
pub(super) async fn attend(lifecycle: Lifecycle) {
    let mut ticks = tokio::time::interval(LOOK_EVERY);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut looked = Looked::default();
    let mut failing = false;
    loop {
        tokio::select! {
            () = lifecycle.inner.stop.cancelled() => return,
            _ = ticks.tick() => {}
        }
        let advanced = lifecycle.look_at_rollouts(&mut looked).await;
        match (&advanced, failing) {
            (Err(error), false) => tracing::error!(%error, "roll-outs cannot be advanced"),
            (Ok(()), true) => tracing::info!("roll-outs are advanced again"),
            _ => {}
        }
        failing = advanced.is_err();
    }
}

impl Lifecycle {
    /// Starts a roll-out.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn start_rollout(&self, start: StartRollout) -> Result<Rollout, StoreError> {
        let lifecycle = self.clone();
        self.see_through(async move {
            let rollout = lifecycle.inner.store.transact(start).await?;
            lifecycle.inner.fleet.announce(LiveUpdate::Rollout);
            Ok(rollout)
        })
        .await
    }

    /// Pauses, resumes or halts a roll-out. Once this returns, a paused or halted one releases no
    /// further robot.
    ///
    /// # Errors
    /// [`StoreError::Rollout`] if the change does not fit it, or the database's failure.
    pub async fn change_rollout(&self, change: ChangeRollout) -> Result<Rollout, StoreError> {
        let lifecycle = self.clone();
        self.see_through(async move {
            let rollout = lifecycle.inner.store.transact(change).await?;
            lifecycle.inner.fleet.announce(LiveUpdate::Rollout);
            Ok(rollout)
        })
        .await
    }

    /// Advances the running roll-outs once.
    async fn look_at_rollouts(&self, looked: &mut Looked) -> Result<(), StoreError> {
        let running = RolloutFilter {
            state: Some(RolloutState::Running),
            before: None,
            limit: limits::ROLLOUTS_RUNNING_MAX,
        };
        let rollouts = self.inner.store.rollouts(&running).await?;
        let is_running = |id: &RolloutId| rollouts.iter().any(|one| one.id == *id);
        looked.0.retain(|id, _| is_running(id));
        for rollout in &rollouts {
            self.advance(rollout, looked).await?;
        }
        Ok(())
    }

    /// Takes the step that is due for a roll-out, or else releases robots of its begun waves.
    async fn advance(&self, rollout: &Rollout, looked: &mut Looked) -> Result<(), StoreError> {
        let (store, id) = (&self.inner.store, rollout.id);
        let robots = store.rollout_robots(id).await?;
        if due(rollout, &rollout.counts(&robots)).is_some() {
            let now = self.inner.clock.now();
            store.transact(AdvanceRollout { id, now }).await?;
            self.inner.fleet.announce(LiveUpdate::Rollout);
            return Ok(());
        }
        if !looked.is_turn(rollout) {
            return Ok(());
        }
        for robot in &robots {
            let has_begun = rollout.has_begun(robot.member.wave);
            if robot.stage(has_begun) != Stage::Released {
                continue;
            }
            match self.release(rollout, robot).await {
                Ok(()) => {}
                Err(StoreError::Rollout(refused @ RolloutRefused::MayNotApprove(_))) => {
                    return self.halt(id, &refused).await;
                }
                // Paused or halted meanwhile.
                Err(StoreError::Rollout(_)) => return Ok(()),
                Err(refused @ (StoreError::Refused(_) | StoreError::Fenced(_))) => {
                    let robot = &robot.member.robot;
                    tracing::info!(robot.id = %robot, %refused, "a released robot is not approved");
                }
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Approves the proposal of a released robot in the name of who started the roll-out.
    async fn release(&self, rollout: &Rollout, robot: &Followed) -> Result<(), StoreError> {
        let member = &robot.member;
        let membership = &self.inner.membership;
        let uptime = self.inner.clock.uptime();
        if !membership.has(&member.robot) || !membership.may_act(uptime) {
            return Ok(());
        }
        let ledger = self.ledger(&member.robot);
        let open = ledger.open.as_ref();
        let approver = &rollout.approver.name;
        let awaited = open.filter(|open| {
            let is_approved = open.approvals.iter().any(|one| one.by == *approver);
            open.id == member.proposal && open.revision == member.revision && !is_approved
        });
        let Some(open) = awaited else {
            return Ok(());
        };
        let command = Command::Approve {
            proposal: open.id,
            version: None,
            sha256: open.revision_sha256.clone(),
            reason: Some(rollout.reason_of(member.wave)),
        };
        let actor = Actor {
            name: approver.clone(),
            authentication: rollout.approver.authentication,
            role: rollout.approver.role,
            request: None,
        };
        let release = Release {
            rollout: rollout.id,
            wave: member.wave,
        };
        let done = self
            .decide_released(&member.robot, command, actor, release)
            .await;
        done.map(drop)
    }

    async fn halt(&self, id: RolloutId, refused: &RolloutRefused) -> Result<(), StoreError> {
        let halt = ChangeRollout {
            id,
            change: RolloutChange::Halt,
            version: None,
            reason: refused.to_string(),
            actor: Actor::service(),
            now: self.inner.clock.now(),
        };
        self.change_rollout(halt).await.map(drop)
    }
}
