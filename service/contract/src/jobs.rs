//! Jobs that several tests run.

use async_trait::async_trait;
use fleetcal_domain::access::{AccountName, Actor, Grant, PasswordHash, Role};
use fleetcal_domain::approval::{DeploymentAction, Outcome, RobotLedger};
use fleetcal_domain::audit::Action;
use fleetcal_domain::robot::RobotConfig;
use fleetcal_model::{EventId, UserId, Version, WallTime};
use fleetcal_store::{
    AuditEntry, CertificateRecord, Job, NewEvent, Records, StoreError, UserRecord,
};

use crate::{NOW_S, NS, robot};

/// Adds an administrator of this name.
#[derive(Debug)]
pub struct AddUser(pub &'static str);

#[async_trait]
impl Job for AddUser {
    type Done = UserId;

    async fn run(&self, records: &mut dyn Records) -> Result<UserId, StoreError> {
        let user = UserRecord {
            id: UserId(0),
            name: AccountName::parse(self.0).unwrap(),
            grant: Grant::of_person(Role::Admin).unwrap(),
            password: PasswordHash::stored("hash".to_owned()),
            disabled: false,
            version: Version(1),
            created_ns: WallTime(1),
            updated_ns: WallTime(1),
            signed_in_ns: None,
        };
        records.add_user(&user).await
    }
}

/// Returns whether a user exists.
#[derive(Debug)]
pub struct IsThere(pub &'static str);

#[async_trait]
impl Job for IsThere {
    type Done = bool;

    async fn run(&self, records: &mut dyn Records) -> Result<bool, StoreError> {
        let name = AccountName::parse(self.0).unwrap();
        Ok(records.user_named(&name).await?.is_some())
    }
}

/// Stores the configuration of robot `a` and an event; returns the event's number.
#[derive(Debug)]
pub struct KeepRobot(pub RobotConfig, pub NewEvent);

#[async_trait]
impl Job for KeepRobot {
    type Done = EventId;

    async fn run(&self, records: &mut dyn Records) -> Result<EventId, StoreError> {
        let Self(config, event) = self;
        let version = records.robot(&robot("a")).await?.map_or(0, |a| a.version.0) + 1;
        let now = NOW_S * NS;
        records
            .save_config(&robot("a"), config, None, Version(version), WallTime(now))
            .await?;
        records.add_event(event).await
    }
}

/// Stores a certificate, with the deployment that it is about.
#[derive(Debug)]
pub struct KeepCertificate(pub CertificateRecord);

#[async_trait]
impl Job for KeepCertificate {
    type Done = ();

    async fn run(&self, records: &mut dyn Records) -> Result<(), StoreError> {
        let Self(certificate) = self;
        let deployment = serde_json::json!({
            "id": certificate.number, "robot": certificate.robot, "version": 1,
            "state": "verified", "approved_by": certificate.approved_by,
            "offer": {"generation": 1, "sha256": "ab", "revision": 1}, "earlier": [],
            "created_ns": 1, "expires_ns": 2,
        });
        let outcome = Outcome {
            ledger: RobotLedger::new(certificate.robot.clone()),
            revisions: Vec::new(),
            proposals: Vec::new(),
            deployments: vec![serde_json::from_value(deployment).unwrap()],
            shadow_changed: false,
            envelopes: Vec::new(),
            outbox: Vec::new(),
            sent: None,
            transitions: Vec::new(),
        };
        records.save_outcome(&outcome).await?;
        records.save_certificate(certificate).await
    }
}

/// Appends this number of rows about robot `a` to the audit, numbered from 0 on.
#[derive(Debug)]
pub struct AppendAudit(pub u32);

#[async_trait]
impl Job for AppendAudit {
    type Done = ();

    async fn run(&self, records: &mut dyn Records) -> Result<(), StoreError> {
        for number in 0..self.0 {
            let entry = AuditEntry {
                at_ns: WallTime(NOW_S * NS),
                actor: Actor::service(),
                action: Action::Deployment(DeploymentAction::Offer),
                subject_id: number.to_string(),
                robot: Some(robot("a")),
                before: None,
                after: Some(serde_json::json!({ "state": "offered", "number": number })),
                reason: Some("x;=1+1".to_owned()),
            };
            records.append_audit(&entry).await?;
        }
        Ok(())
    }
}
