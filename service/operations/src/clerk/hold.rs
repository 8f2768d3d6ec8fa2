//! The site-wide stop.

use async_trait::async_trait;
use fleetcal_domain::access::Actor;
use fleetcal_domain::approval::may_change;
use fleetcal_domain::audit::Action;
use fleetcal_store::{AuditEntry, Job, Records, SiteHold, StoreError};

/// A change of the site-wide stop.
#[derive(Debug, Clone)]
pub struct SetHold {
    /// Whether it is to be held.
    pub held: bool,
    /// The version that was looked at.
    pub version: u64,
    /// Who.
    pub actor: Actor,
    /// When, wall time.
    pub now_ns: i64,
    /// Why.
    pub reason: String,
}

#[async_trait]
impl Job for SetHold {
    type Done = SiteHold;

    async fn run(&self, records: &mut dyn Records) -> Result<SiteHold, StoreError> {
        let before = records.site_hold().await?;
        may_change(before.version, self.version, &self.reason)?;
        let after = SiteHold {
            version: before.version + 1,
            held: self.held,
            by: Some(self.actor.name.clone()),
            at_ns: Some(self.now_ns),
            reason: Some(self.reason.clone()),
        };
        records.save_site_hold(&after).await?;
        let entry = AuditEntry {
            at_ns: self.now_ns,
            actor: self.actor.clone(),
            action: if self.held {
                Action::Hold
            } else {
                Action::Release
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
