//! Jobs of roll-outs: start, changes by people, and what their waves make due.

use async_trait::async_trait;
use fleetcal_domain::access::Actor;
use fleetcal_domain::audit::Action;
use fleetcal_domain::limits;
use fleetcal_domain::webhook::Message;
use fleetcal_model::{RolloutId, Version, WallTime};
use fleetcal_rollout::{Changed, Event, Lost, Member, Rollout, RolloutRefused, WavePlan, due};
use fleetcal_store::{AuditEntry, Job, Records, StoreError};

use crate::webhook_dispatcher::outbox;

/// Start of a roll-out.
#[derive(Debug, Clone)]
pub struct StartRollout {
    /// Query that selected the robots.
    pub q: String,
    /// Waves with their numbers of robots.
    pub waves: Vec<(WavePlan, u32)>,
    /// Robots with the proposals that the actor approves.
    pub members: Vec<Member>,
    /// Person or token that approves them.
    pub actor: Actor,
    /// Reason for the approvals.
    pub reason: Option<String>,
    /// Wall time.
    pub now: WallTime,
}

#[async_trait]
impl Job for StartRollout {
    type Done = Rollout;

    async fn run(&self, records: &mut dyn Records) -> Result<Rollout, StoreError> {
        let is_blank = |reason: &String| reason.trim().is_empty();
        if self.reason.as_ref().is_some_and(is_blank) {
            return Err(RolloutRefused::ReasonMissing.into());
        }
        let rollout = Rollout::start(
            records.next_rollout().await?,
            self.q.clone(),
            self.waves.clone(),
            &self.actor,
            self.reason.clone(),
            self.now,
        );
        records.save_rollout(&rollout).await?;
        records
            .add_rollout_robots(rollout.id, &self.members)
            .await?;
        check_beside(records, rollout.id).await?;
        audit(records, None, &rollout, Action::StartRollout, &self.actor).await?;
        Ok(rollout)
    }
}

/// Change of a roll-out that a person decides.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RolloutChange {
    /// Releases no further robot for now.
    Pause,
    /// Releases robots again. After a halt, the lost robots of each wave that the person has read
    /// are accepted.
    Resume(Vec<Lost>),
    /// Releases no further robot, since something is wrong.
    Halt,
}

/// Change of a roll-out, by a person, or by the service which halts it.
#[derive(Debug, Clone)]
pub struct ChangeRollout {
    /// Number of the roll-out.
    pub id: RolloutId,
    /// The change.
    pub change: RolloutChange,
    /// Version that the person read; any unless given.
    pub version: Option<Version>,
    /// Reason for the change; never empty.
    pub reason: String,
    /// Actor of the change.
    pub actor: Actor,
    /// Wall time.
    pub now: WallTime,
}

#[async_trait]
impl Job for ChangeRollout {
    type Done = Rollout;

    async fn run(&self, records: &mut dyn Records) -> Result<Rollout, StoreError> {
        let before = records.rollout(self.id).await?;
        let before = before.ok_or(RolloutRefused::Unknown(self.id))?;
        let found = before.version;
        if self.version.is_some_and(|version| version != found) {
            return Err(RolloutRefused::Stale { found }.into());
        }
        if self.reason.trim().is_empty() {
            return Err(RolloutRefused::ReasonMissing.into());
        }
        let event = match &self.change {
            RolloutChange::Pause => Event::Pause,
            RolloutChange::Halt => Event::Halt,
            RolloutChange::Resume(read) => {
                check_beside(records, self.id).await?;
                let robots = records.rollout_robots(self.id).await?;
                let counts = before.counts(&robots);
                before.check_read(&counts, read)?;
                Event::Resume(counts)
            }
        };
        let reason = self.reason.clone();
        take(records, &before, &event, (&self.actor, reason), self.now).await
    }
}

/// Step that is due for a roll-out, if any: it may run again, and on several instances.
#[derive(Debug, Clone)]
pub struct AdvanceRollout {
    /// Number of the roll-out.
    pub id: RolloutId,
    /// Wall time.
    pub now: WallTime,
}

#[async_trait]
impl Job for AdvanceRollout {
    type Done = Option<Rollout>;

    async fn run(&self, records: &mut dyn Records) -> Result<Option<Rollout>, StoreError> {
        let Some(before) = records.rollout(self.id).await? else {
            return Ok(None);
        };
        let robots = records.rollout_robots(self.id).await?;
        let Some((event, reason)) = due(&before, &before.counts(&robots)) else {
            return Ok(None);
        };
        let by = (&Actor::service(), reason);
        take(records, &before, &event, by, self.now).await.map(Some)
    }
}

/// Refuses a roll-out that would release what another one does, or that would be one too many.
async fn check_beside(records: &mut dyn Records, id: RolloutId) -> Result<(), StoreError> {
    if let Some((other, robot)) = records.rollout_taken(id).await? {
        return Err(RolloutRefused::Taken { other, robot }.into());
    }
    if records.rollouts_beside(id).await? >= limits::ROLLOUTS_RUNNING_MAX {
        return Err(RolloutRefused::TooMany.into());
    }
    Ok(())
}

/// Takes an event of a roll-out: stores it with its audit, and reports a halt to webhooks.
async fn take(
    records: &mut dyn Records,
    before: &Rollout,
    event: &Event,
    (actor, reason): (&Actor, String),
    now: WallTime,
) -> Result<Rollout, StoreError> {
    let changed = Changed {
        by: actor.name.clone(),
        at_ns: now,
        reason: Some(reason),
    };
    let after = before.after(event, changed)?;
    records.save_rollout(&after).await?;
    audit(records, Some(before), &after, action(event), actor).await?;
    if *event == Event::Halt {
        let Changed { by, reason, .. } = &after.changed;
        let reason = reason.as_deref().unwrap_or_default();
        let message = Message::of_halted_rollout((after.id, after.version), by, reason, now);
        let message = message.map_err(|error| outbox::unwritable(&error))?;
        outbox::tell(records, &message, now).await?;
    }
    Ok(after)
}

const fn action(event: &Event) -> Action {
    match event {
        Event::Pause => Action::PauseRollout,
        Event::Resume(_) => Action::ResumeRollout,
        Event::Halt => Action::HaltRollout,
        Event::BeginWave => Action::BeginWave,
        Event::Finish => Action::FinishRollout,
    }
}

async fn audit(
    records: &mut dyn Records,
    before: Option<&Rollout>,
    after: &Rollout,
    action: Action,
    actor: &Actor,
) -> Result<(), StoreError> {
    let entry = AuditEntry {
        at_ns: after.changed.at_ns,
        actor: actor.clone(),
        action,
        subject_id: after.id.to_string(),
        robot: None,
        before: before.and_then(|before| serde_json::to_value(before).ok()),
        after: serde_json::to_value(after).ok(),
        reason: after.changed.reason.clone(),
    };
    records.append_audit(&entry).await
}
