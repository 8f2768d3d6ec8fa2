//! The rules that the lifecycle goes by: what the configuration file says, or what was set since.

use std::sync::{Arc, PoisonError, RwLock};

use async_trait::async_trait;
use fleetcal_domain::access::Actor;
use fleetcal_domain::approval::{Policy, may_change};
use fleetcal_domain::audit::Action;
use fleetcal_fleet::live::LiveUpdate;
use fleetcal_model::{Version, WallTime};
use fleetcal_store::{AuditEntry, Job, Records, StoreError, StoredPolicy};

use super::Lifecycle;

/// A change of the policy.
#[derive(Debug, Clone)]
pub struct SetPolicy {
    /// The new one; `None` to go back to what the configuration file says.
    pub policy: Option<Policy>,
    /// The version that was looked at.
    pub version: Version,
    /// Who.
    pub actor: Actor,
    /// When, wall time.
    pub now: WallTime,
    /// Why.
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

/// The rules in force, and where they come from.
#[derive(Debug)]
pub(super) struct Rules {
    /// What the configuration file says.
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

    /// Takes what is stored, unless something newer is known; whether it was news.
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
    /// The rules in force.
    pub fn policy(&self) -> Arc<Policy> {
        let rules = &self.inner.rules;
        let stored = rules.stored.read().unwrap_or_else(PoisonError::into_inner);
        stored
            .policy
            .map_or_else(|| Arc::clone(&rules.given), Arc::new)
    }

    /// What the configuration file says, whatever was set since.
    pub(super) fn given_policy(&self) -> Arc<Policy> {
        Arc::clone(&self.inner.rules.given)
    }

    /// What was set over the API, and by whom.
    pub fn stored_policy(&self) -> StoredPolicy {
        self.inner.rules.stored()
    }

    /// Sets the rules, or with `None` goes back to those of the configuration file. What is decided
    /// from now on goes by them.
    ///
    /// # Errors
    /// [`StoreError::Refused`] when they changed since they were looked at, or the database's
    /// failure.
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
