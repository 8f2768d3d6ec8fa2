//! Progress of roll-outs, each second, from what the database holds: the steps that are due, and
//! the approvals that the begun waves release. An instance releases the robots that it estimates.

use std::collections::BTreeMap;
use std::time::Duration;

use fleetcal_domain::access::Actor;
use fleetcal_domain::approval::Command;
use fleetcal_domain::limits;
use fleetcal_fleet::live::LiveUpdate;
use fleetcal_model::{RobotId, RolloutId, Version};
use fleetcal_rollout::{Followed, Member, Rollout, RolloutRefused, RolloutState, Stage, due};
use fleetcal_store::{RolloutFilter, StoreError};
use tokio::time::MissedTickBehavior;

use super::Lifecycle;
use super::decide::Release;
use super::rollouts::{AdvanceRollout, ChangeRollout, RolloutChange, StartRollout};

/// Interval of the looks at running roll-outs.
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// Looks between two rounds of attempts to release the robots of a roll-out.
const TRIED_EVERY_LOOKS: u32 = 10;

/// Releases of a running roll-out at the last looks.
#[derive(Debug, Default)]
struct Round {
    /// Version of the roll-out; another one begins the round again.
    version: Version,
    /// Wave and id of the robot that was tried last in this round.
    after: Option<(u32, RobotId)>,
    /// Looks until the next round.
    rests: u32,
    /// Refusals that were logged, by robot.
    refusals: BTreeMap<RobotId, String>,
}

impl Round {
    /// True if robots of a roll-out are to be released at this look.
    fn is_turn(&mut self, rollout: &Rollout) -> bool {
        if self.version != rollout.version {
            (self.version, self.after, self.rests) = (rollout.version, None, 0);
        }
        let is_turn = self.rests == 0;
        self.rests = self.rests.saturating_sub(1);
        is_turn
    }

    /// Logs a refusal of a robot's release once, and again when it is another one.
    fn refuse(&mut self, robot: &RobotId, refused: &StoreError) {
        let refused = refused.to_string();
        if self.refusals.get(robot) != Some(&refused) {
            tracing::info!(robot.id = %robot, %refused, "a released robot is not approved");
            self.refusals.insert(robot.clone(), refused);
        }
    }
}

/// Rounds of the running roll-outs.
type Rounds = BTreeMap<RolloutId, Round>;

/// Advances the running roll-outs until the lifecycle stops.
pub(super) async fn attend(lifecycle: Lifecycle) {
    let mut ticks = tokio::time::interval(LOOK_EVERY);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut rounds = Rounds::new();
    let mut failing = false;
    loop {
        tokio::select! {
            () = lifecycle.inner.stop.cancelled() => return,
            _ = ticks.tick() => {}
        }
        let advanced = lifecycle.look_at_rollouts(&mut rounds).await;
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

    /// Advances the running roll-outs once, each whatever becomes of the others.
    ///
    /// # Errors
    /// The first failure of the database.
    async fn look_at_rollouts(&self, rounds: &mut Rounds) -> Result<(), StoreError> {
        let running = RolloutFilter {
            state: Some(RolloutState::Running),
            before: None,
            limit: limits::ROLLOUTS_RUNNING_MAX,
        };
        let rollouts = self.inner.store.rollouts(&running).await?;
        let is_running = |id: &RolloutId| rollouts.iter().any(|one| one.id == *id);
        rounds.retain(|id, _| is_running(id));
        let mut left = limits::DECIDED_TOGETHER;
        let mut looked = Ok(());
        for rollout in &rollouts {
            let round = rounds.entry(rollout.id).or_default();
            looked = looked.and(self.advance(rollout, round, &mut left).await);
        }
        looked
    }

    /// Takes the step that is due for a roll-out, or else releases robots of its begun waves, at
    /// most `left`.
    async fn advance(
        &self,
        rollout: &Rollout,
        round: &mut Round,
        left: &mut usize,
    ) -> Result<(), StoreError> {
        let (store, id) = (&self.inner.store, rollout.id);
        let robots = store.rollout_robots(id).await?;
        if due(rollout, &rollout.counts(&robots)).is_some() {
            let now = self.inner.clock.now();
            store.transact(AdvanceRollout { id, now }).await?;
            self.inner.fleet.announce(LiveUpdate::Rollout);
            return Ok(());
        }
        if *left == 0 || !round.is_turn(rollout) {
            return Ok(());
        }
        self.release_some(rollout, &robots, (round, left)).await
    }

    /// Goes on with a round of releases, until it is over or `left` robots were tried.
    async fn release_some(
        &self,
        rollout: &Rollout,
        robots: &[Followed],
        (round, left): (&mut Round, &mut usize),
    ) -> Result<(), StoreError> {
        let key = |one: &Followed| (one.member.wave, one.member.robot.clone());
        let is_released = |one: &&Followed| {
            one.stage(rollout.has_begun(one.member.wave)) == Stage::Released
                && round.after.as_ref().is_none_or(|after| key(one) > *after)
        };
        let mut released: Vec<_> = robots.iter().filter(is_released).collect();
        released.sort_by_key(|one| key(one));
        let mut done = Ok(());
        for one in released {
            let Some(command) = self.awaited(rollout, &one.member) else {
                continue;
            };
            if *left == 0 || self.inner.stop.is_cancelled() {
                return done;
            }
            *left -= 1;
            round.after = Some(key(one));
            let robot = &one.member.robot;
            match self.release(rollout, &one.member, command).await {
                Ok(()) => drop(round.refusals.remove(robot)),
                Err(StoreError::Rollout(refused @ RolloutRefused::MayNotApprove(_))) => {
                    return done.and(self.halt(rollout.id, &refused).await);
                }
                // Paused or halted meanwhile.
                Err(StoreError::Rollout(_)) => return done,
                Err(refused @ (StoreError::Refused(_) | StoreError::Fenced(_))) => {
                    round.refuse(robot, &refused);
                }
                Err(error) => done = done.and(Err(error)),
            }
        }
        (round.after, round.rests) = (None, TRIED_EVERY_LOOKS - 1);
        done
    }

    /// Approval of a released robot's proposal in the name of who started the roll-out; `None` if
    /// it is given already, or another instance estimates the robot.
    fn awaited(&self, rollout: &Rollout, member: &Member) -> Option<Command> {
        let membership = &self.inner.membership;
        let uptime = self.inner.clock.uptime();
        if !membership.has(&member.robot) || !membership.may_act(uptime) {
            return None;
        }
        let ledger = self.ledger(&member.robot);
        let open = ledger.open.as_ref()?;
        let approver = &rollout.approver.name;
        let is_approved = open.approvals.iter().any(|one| one.by == *approver);
        if open.id != member.proposal || open.revision != member.revision || is_approved {
            return None;
        }
        Some(Command::Approve {
            proposal: open.id,
            version: None,
            sha256: open.revision_sha256.clone(),
            reason: Some(rollout.reason_of(member.wave)),
        })
    }

    async fn release(
        &self,
        rollout: &Rollout,
        member: &Member,
        command: Command,
    ) -> Result<(), StoreError> {
        let actor = Actor {
            name: rollout.approver.name.clone(),
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
        match self.change_rollout(halt).await {
            // Another instance has halted it, or a person.
            Ok(_) | Err(StoreError::Rollout(RolloutRefused::State { .. })) => Ok(()),
            Err(error) => Err(error),
        }
    }
}
