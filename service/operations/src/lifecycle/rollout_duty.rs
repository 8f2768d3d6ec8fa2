//! Progress of roll-outs, each second, from what the database holds: the steps that are due, and
//! the approvals that the begun waves release. An instance releases the robots that it estimates.

use std::collections::BTreeMap;

use fleetcal_domain::access::Actor;
use fleetcal_domain::approval::Command;
use fleetcal_domain::limits;
use fleetcal_fleet::live::LiveUpdate;
use fleetcal_model::{RolloutId, Version};
use fleetcal_rollout::{Followed, Rollout, RolloutRefused, RolloutState, Stage, due};
use fleetcal_store::{RolloutFilter, StoreError};

use super::Lifecycle;
use super::decide::Release;
use super::rollouts::{AdvanceRollout, ChangeRollout, RolloutChange, StartRollout};

/// Looks between two attempts to release a robot whose approval was refused.
const TRIED_EVERY_LOOKS: u32 = 10;

/// Versions of the running roll-outs at the last look, and the looks since they changed.
#[derive(Debug, Default)]
pub(super) struct Looked(BTreeMap<RolloutId, (Version, u32)>);

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
    pub(super) async fn look_at_rollouts(&self, looked: &mut Looked) {
        let running = RolloutFilter {
            state: Some(RolloutState::Running),
            before: None,
            limit: limits::ROLLOUTS_RUNNING_MAX,
        };
        let rollouts = self.inner.store.rollouts(&running).await;
        let rollouts = rollouts.inspect_err(|error| {
            tracing::error!(%error, "the roll-outs cannot be read");
        });
        let rollouts = rollouts.unwrap_or_default();
        looked
            .0
            .retain(|id, _| rollouts.iter().any(|one| one.id == *id));
        for rollout in rollouts {
            let id = rollout.id;
            if let Err(error) = self.advance(rollout, looked).await {
                tracing::error!(%id, %error, "a roll-out cannot be advanced");
            }
        }
    }

    async fn advance(&self, rollout: Rollout, looked: &mut Looked) -> Result<(), StoreError> {
        let (store, id) = (&self.inner.store, rollout.id);
        let robots = store.rollout_robots(id).await?;
        let (rollout, robots) = if due(&rollout, &rollout.counts(&robots)).is_some() {
            let now = self.inner.clock.now();
            let after = store.transact(AdvanceRollout { id, now }).await?;
            self.inner.fleet.announce(LiveUpdate::Rollout);
            (after.unwrap_or(rollout), robots)
        } else {
            (rollout, robots)
        };
        if rollout.state != RolloutState::Running || !looked.is_turn(&rollout) {
            return Ok(());
        }
        for robot in &robots {
            let has_begun = rollout.has_begun(robot.member.wave);
            if robot.stage(has_begun) != Stage::Released {
                continue;
            }
            match self.release(&rollout, robot).await {
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
