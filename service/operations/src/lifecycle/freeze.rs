//! Changes of the deployment freeze.

use async_trait::async_trait;
use fleetcal_domain::access::Actor;
use fleetcal_domain::approval::may_change;
use fleetcal_domain::audit::Action;
use fleetcal_model::{Version, WallTime};
use fleetcal_store::{AuditEntry, DeploymentFreeze, Job, Records, StoreError};

/// Change of the deployment freeze.
#[derive(Debug, Clone)]
pub struct SetFreeze {
    /// True to freeze deployments.
    pub frozen: bool,
    /// Version that the person read.
    pub version: Version,
    /// Actor of the change.
    pub actor: Actor,
    /// Time of the change, wall time.
    pub now: WallTime,
    /// Reason for the change.
    pub reason: String,
}

#[async_trait]
impl Job for SetFreeze {
    type Done = DeploymentFreeze;

    async fn run(&self, records: &mut dyn Records) -> Result<DeploymentFreeze, StoreError> {
        let before = records.deployment_freeze().await?;
        may_change(before.version, self.version, &self.reason)?;
        let after = DeploymentFreeze {
            version: before.version.next(),
            frozen: self.frozen,
            by: Some(self.actor.name.clone()),
            at_ns: Some(self.now),
            reason: Some(self.reason.clone()),
        };
        records.save_deployment_freeze(&after).await?;
        let entry = AuditEntry {
            at_ns: self.now,
            actor: self.actor.clone(),
            action: if self.frozen {
                Action::BeginFreeze
            } else {
                Action::EndFreeze
            },
            subject_id: "1".to_owned(),
            robot: None,
            before: serde_json::to_value(&before).ok(),
            after: serde_json::to_value(&after).ok(),
            reason: Some(self.reason.clone()),
        };
        records.append_audit(&entry).await?;
        Ok(after)
    }
}
