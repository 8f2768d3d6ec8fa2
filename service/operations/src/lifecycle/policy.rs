//! Policy in force: the configuration file's, or the one that was set since.

use std::sync::{Arc, PoisonError, RwLock};

use async_trait::async_trait;
use fleetcal_domain::access::Actor;
use fleetcal_domain::approval::{Policy, may_change};
use fleetcal_domain::audit::Action;
use fleetcal_fleet::live::LiveUpdate;
use fleetcal_model::{Version, WallTime};
use fleetcal_store::{AuditEntry, Job, Records, StoreError, StoredPolicy};

use super::Lifecycle;

/// Change of the policy.
#[derive(Debug, Clone)]
pub struct SetPolicy {
    /// New policy; `None` to restore the configuration file's.
    pub policy: Option<Policy>,
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
impl Job for SetPolicy {
    type Done = StoredPolicy;

    async fn run(&self, records: &mut dyn Records) -> Result<StoredPolicy, StoreError> {
        let before = records.stored_policy().await?;
        may_change(before.version, self.version, &self.reason)?;
        let after = StoredPolicy {
            version: before.version.next(),
            policy: self.policy,
            by: Some(self.actor.name.clone()),
            at_ns: Some(self.now),
            reason: Some(self.reason.clone()),
        };
        records.save_policy(&after).await?;
        let entry = AuditEntry {
            at_ns: self.now,
            actor: self.actor.clone(),
            action: Action::ChangePolicy,
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

/// Policies of the configuration file and of the store.
#[derive(Debug)]
pub(super) struct Rules {
    /// Policy of the configuration file.
    given: Arc<Policy>,
    stored: RwLock<StoredPolicy>,
}

impl Rules {
    pub(super) fn new(given: Policy, stored: StoredPolicy) -> Self {
        Self {
            given: Arc::new(given),
            stored: RwLock::new(stored),
        }
    }

    /// Replaces the stored policy, unless the known one is newer; returns true if it did.
    pub(super) fn take(&self, stored: StoredPolicy) -> bool {
        let known = self.stored.write();
        let mut known = known.unwrap_or_else(PoisonError::into_inner);
        let is_news = known.version < stored.version;
        if is_news {
            *known = stored;
        }
        is_news
    }

    fn stored(&self) -> StoredPolicy {
        let stored = self.stored.read().unwrap_or_else(PoisonError::into_inner);
        stored.clone()
    }
}

impl Lifecycle {
    /// Policy in force.
    pub fn policy(&self) -> Arc<Policy> {
        let rules = &self.inner.rules;
        let stored = rules.stored.read().unwrap_or_else(PoisonError::into_inner);
        stored
            .policy
            .map_or_else(|| Arc::clone(&rules.given), Arc::new)
    }

    /// Policy of the configuration file, even if another one was set since.
    pub(super) fn given_policy(&self) -> Arc<Policy> {
        Arc::clone(&self.inner.rules.given)
    }

    /// Policy that was set over the API, and its last change.
    pub fn stored_policy(&self) -> StoredPolicy {
        self.inner.rules.stored()
    }

    /// Sets the policy, or with `None` restores the configuration file's. It applies to decisions
    /// from now on.
    ///
    /// # Errors
    /// [`StoreError::Refused`] if it changed since it was read, or the database's failure.
    pub async fn change_policy(
        &self,
        policy: Option<Policy>,
        version: Version,
        actor: Actor,
        reason: String,
    ) -> Result<StoredPolicy, StoreError> {
        let write = SetPolicy {
            policy,
            version,
            actor,
            now: self.inner.clock.now(),
            reason,
        };
        let lifecycle = self.clone();
        self.see_through(async move { lifecycle.take_policy(write).await })
            .await
    }

    async fn take_policy(&self, write: SetPolicy) -> Result<StoredPolicy, StoreError> {
        let stored = self.inner.store.transact(write).await?;
        self.inner.rules.take(stored.clone());
        self.inner.fleet.announce(LiveUpdate::Policy);
        Ok(stored)
    }
}
