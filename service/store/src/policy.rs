//! Approval policy that was set over the API.

use fleetcal_domain::approval::Policy;
use fleetcal_model::{Version, WallTime};
use serde::Serialize;

/// Stored policy and its last change.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StoredPolicy {
    /// Version, incremented with every change.
    pub version: Version,
    /// Policy; `None` if the configuration file's is in force.
    pub policy: Option<Policy>,
    /// Person or tool that changed it last.
    pub by: Option<String>,
    /// Time of the change, ns since 1970, wall time.
    pub at_ns: Option<WallTime>,
    /// Reason for the change.
    pub reason: Option<String>,
}
