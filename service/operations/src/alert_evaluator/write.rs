//! Changes of alerts: each is read, made and written in one transaction, with its messages.

use std::collections::BTreeMap;
use std::sync::Arc;

use async_trait::async_trait;
use fleetcal_cluster::{Duty, Seat};
use fleetcal_domain::access::Actor;
use fleetcal_domain::alert::{
    Acknowledgement, Alert, AlertPolicy, AlertRefused, Notice, Sighting, Step, StoredAlert,
    Subject, step,
};
use fleetcal_domain::audit::Action;
use fleetcal_domain::limits;
use fleetcal_domain::standing::{RobotAlerts, Standing, StandingBasis};
use fleetcal_domain::webhook::Message;
use fleetcal_model::{AlertId, Version, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_store::{AlertMoment, AuditEntry, Job, Records, StoreError};

use crate::webhook_dispatcher::outbox;

/// Observation of the rules, to be stored.
#[derive(Debug, Clone)]
pub struct Observe {
    /// Sightings of robots, or of the fleet.
    pub sightings: Vec<(Subject, Sighting)>,
    /// Delays of the alerts.
    pub policy: Arc<AlertPolicy>,
    /// Standings of these robots without their alerts, and their previous alerts.
    pub standing: BTreeMap<RobotId, (StandingBasis, RobotAlerts)>,
    /// Seat that must have the duty of alerts until this is written; `None` for a single service.
    pub evaluator: Option<Seat>,
    /// Wall time.
    pub now: WallTime,
}

/// Acknowledgement of an alert.
#[derive(Debug, Clone)]
pub struct Acknowledge {
    /// Number of the alert.
    pub id: AlertId,
    /// Version that the person read.
    pub version: Version,
    /// Actor of the acknowledgement.
    pub actor: Actor,
    /// Note of the person.
    pub note: Option<String>,
    /// Wall time.
    pub now: WallTime,
}

/// Change of one alert.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum AlertChange {
    /// New or changed alert.
    Kept(Box<Alert>),
    /// Pending alert that came to nothing, and was deleted.
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
        let before = match records.active_alert(subject, sighting.kind).await? {
            Some(StoredAlert::Known(alert)) => Some(*alert),
            None => None,
            // What an instance of a newer version has made of it stays.
            Some(StoredAlert::Newer(_)) => return Ok(None),
        };
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

/// Standing of an alert's robot with the alert in its present condition; `None` for an alert about
/// several robots.
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
        let before = before.known().ok_or(AlertRefused::Newer)?;
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

/// Acknowledgement of several alerts, all or none.
#[derive(Debug, Clone)]
pub struct AcknowledgeAll(pub Vec<Acknowledge>);

#[async_trait]
impl Job for AcknowledgeAll {
    type Done = Vec<Alert>;

    async fn run(&self, records: &mut dyn Records) -> Result<Vec<Alert>, StoreError> {
        let mut acknowledged = Vec::new();
        for one in &self.0 {
            acknowledged.push(one.run(records).await?);
        }
        Ok(acknowledged)
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
        state: alert.condition.name().into(),
        what: alert.what.clone(),
        by,
        note,
    };
    let kept = limits::ALERT_CHANGES_MAX;
    records.add_alert_moment(alert.id, &moment, kept).await
}
