//! Changes of alerts: each is read, made and written in one transaction, with what is told of it.

use std::collections::BTreeMap;
use std::sync::Arc;

use async_trait::async_trait;
use fleetcal_cluster::{Duty, Seat};
use fleetcal_domain::access::Actor;
use fleetcal_domain::alert::{
    Acknowledgement, Alert, AlertPolicy, AlertRefused, Notice, Sighting, Step, Subject, step,
};
use fleetcal_domain::audit::Action;
use fleetcal_domain::limits;
use fleetcal_domain::standing::{RobotAlerts, Standing, StandingBasis};
use fleetcal_domain::webhook::Message;
use fleetcal_model::{AlertId, Version, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_store::{AlertMoment, AuditEntry, Job, Records, StoreError};

use crate::webhook_dispatcher::outbox;

/// Takes what the rules have seen.
#[derive(Debug, Clone)]
pub struct Observe {
    /// Of which robots, or of the fleet.
    pub sightings: Vec<(Subject, Sighting)>,
    /// How long something has to last.
    pub policy: Arc<AlertPolicy>,
    /// How these robots stand apart from their alerts, and what alerts they had before.
    pub standing: BTreeMap<RobotId, (StandingBasis, RobotAlerts)>,
    /// Who must have the duty of alerts until this is written; `None` where one service has all.
    pub evaluator: Option<Seat>,
    /// Wall time.
    pub now: WallTime,
}

/// Somebody takes an alert on.
#[derive(Debug, Clone)]
pub struct Acknowledge {
    /// Which.
    pub id: AlertId,
    /// The version that was looked at.
    pub version: Version,
    /// Who.
    pub actor: Actor,
    /// What the person has to say.
    pub note: Option<String>,
    /// Wall time.
    pub now: WallTime,
}

/// What became of one alert.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum AlertChange {
    /// It is new or has changed.
    Kept(Box<Alert>),
    /// It was pending, came to nothing, and is gone.
    Dropped(Box<Alert>),
}

#[async_trait]
impl Job for Observe {
    type Done = Vec<AlertChange>;

    async fn run(&self, records: &mut dyn Records) -> Result<Vec<AlertChange>, StoreError> {
        if let Some(seat) = &self.evaluator
            && !records.holds_duty(seat, Duty::Alerts).await?
        {
            tracing::info!(
                instance = seat.instance.as_str(),
                "another instance evaluates the alerts now"
            );
            return Ok(Vec::new());
        }
        let mut changes = Vec::new();
        let mut standing = self.standing.clone();
        for (subject, sighting) in &self.sightings {
            let change = self.observe(records, &mut standing, subject, sighting);
            changes.extend(change.await?);
        }
        Ok(changes)
    }
}

impl Observe {
    async fn observe(
        &self,
        records: &mut dyn Records,
        standing: &mut BTreeMap<RobotId, (StandingBasis, RobotAlerts)>,
        subject: &Subject,
        sighting: &Sighting,
    ) -> Result<Option<AlertChange>, StoreError> {
        let before = records.active_alert(subject, sighting.kind).await?;
        let periods = self.policy.periods(sighting.kind);
        match step(before.as_ref(), subject, sighting, self.now, periods) {
            Step::Same => Ok(None),
            Step::Dropped => {
                let Some(before) = before else {
                    return Ok(None);
                };
                records.delete_alert(before.id).await?;
                Ok(Some(AlertChange::Dropped(Box::new(before))))
            }
            // What it says now is no change of it.
            Step::Retold(alert) => {
                records.save_alert(&alert).await?;
                Ok(Some(AlertChange::Kept(alert)))
            }
            Step::Changed(mut alert, notice) => {
                if alert.id == AlertId(0) {
                    alert.id = records.add_alert(&alert).await?;
                } else {
                    records.save_alert(&alert).await?;
                }
                note_change(records, &alert, None, self.now).await?;
                let stands = standing_with(standing, &alert);
                if let Some(notice) = notice {
                    self.tell(records, &alert, notice, stands).await?;
                }
                Ok(Some(AlertChange::Kept(alert)))
            }
        }
    }

    async fn tell(
        &self,
        records: &mut dyn Records,
        alert: &Alert,
        notice: Notice,
        standing: Option<Standing>,
    ) -> Result<(), StoreError> {
        let message = Message::of_alert(alert, notice, standing, self.now);
        let message = message.map_err(|error| outbox::unwritable(&error))?;
        outbox::tell(records, &message, self.now).await
    }
}

/// How the robot of an alert stands once the alert is as it is now; `None` of one about several.
fn standing_with(
    standing: &mut BTreeMap<RobotId, (StandingBasis, RobotAlerts)>,
    alert: &Alert,
) -> Option<Standing> {
    let (basis, alerts) = standing.get_mut(alert.robot.robot()?)?;
    alerts.set(alert.kind, alert.condition.name());
    Some(basis.with(alerts))
}

#[async_trait]
impl Job for Acknowledge {
    type Done = Alert;

    async fn run(&self, records: &mut dyn Records) -> Result<Alert, StoreError> {
        let before = records.alert(self.id).await?;
        let before = before.ok_or(AlertRefused::Unknown(self.id))?;
        let acknowledgement = Acknowledgement {
            by: self.actor.name.clone(),
            at_ns: self.now,
            note: self.note.clone(),
        };
        let after = before.acknowledge(self.version, acknowledgement.clone())?;
        records.save_alert(&after).await?;
        note_change(records, &after, Some(acknowledgement), self.now).await?;
        let entry = AuditEntry {
            at_ns: self.now,
            actor: self.actor.clone(),
            action: Action::AcknowledgeAlert,
            subject_id: self.id.to_string(),
            robot: after.robot.robot().cloned(),
            before: serde_json::to_value(&before).ok(),
            after: serde_json::to_value(&after).ok(),
            reason: self.note.clone(),
        };
        records.append_audit(&entry).await?;
        Ok(after)
    }
}

/// Adds a change to an alert's history.
async fn note_change(
    records: &mut dyn Records,
    alert: &Alert,
    acknowledged: Option<Acknowledgement>,
    now: WallTime,
) -> Result<(), StoreError> {
    let (by, note) = acknowledged.map_or((None, None), |one| (Some(one.by), one.note));
    let moment = AlertMoment {
        at_ns: now,
        version: alert.version,
        state: alert.condition.name(),
        what: alert.what.clone(),
        by,
        note,
    };
    let kept = limits::ALERT_CHANGES_MAX;
    records.add_alert_moment(alert.id, &moment, kept).await
}
