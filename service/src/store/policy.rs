//! The approval policy as it was set over the API.

use serde::Serialize;

use super::Store;
use super::error::StoreError;
use super::writer::Command;
use crate::access::Actor;
use crate::approval::Policy;

/// The policy that was set, and by whom.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StoredPolicy {
    /// Goes up with every change of it.
    pub version: u64,
    /// The policy; `None` when what the configuration file says counts.
    pub policy: Option<Policy>,
    /// Who changed it last.
    pub by: Option<String>,
    /// When, ns since 1970, wall time.
    pub at_ns: Option<i64>,
    /// Why.
    pub reason: Option<String>,
}

/// A change of the policy.
#[derive(Debug, Clone)]
pub struct PolicyWrite {
    /// The new one; `None` to go back to what the configuration file says.
    pub policy: Option<Policy>,
    /// The version that was looked at.
    pub version: u64,
    /// Who.
    pub actor: Actor,
    /// When, wall time.
    pub now_ns: i64,
    /// Why.
    pub reason: String,
}

impl Store {
    /// Sets the policy.
    ///
    /// # Errors
    /// [`StoreError::Refused`] when it changed since it was looked at; otherwise the database's
    /// failure.
    pub async fn write_policy(&self, write: PolicyWrite) -> Result<StoredPolicy, StoreError> {
        self.ask(|reply| Command::Policy(Box::new(write), reply))
            .await
    }

    /// The policy that was set.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn stored_policy(&self) -> Result<StoredPolicy, StoreError> {
        self.shared.reader.policy().await
    }
}
