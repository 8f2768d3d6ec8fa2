//! The approval policy as it was set over the API.

use fleetcal_domain::approval::Policy;
use fleetcal_model::{Version, WallTime};
use serde::Serialize;

/// The policy that was set, and by whom.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StoredPolicy {
    /// Goes up with every change of it.
    pub version: Version,
    /// The policy; `None` when what the configuration file says counts.
    pub policy: Option<Policy>,
    /// Who changed it last.
    pub by: Option<String>,
    /// When, ns since 1970, wall time.
    pub at_ns: Option<WallTime>,
    /// Why.
    pub reason: Option<String>,
}
