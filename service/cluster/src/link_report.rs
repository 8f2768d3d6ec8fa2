//! What an instance's link to Zenoh says of itself.

use std::collections::BTreeSet;

use crate::InstanceId;

/// What an instance's link to Zenoh says of itself.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct LinkReport {
    /// Whether robots reach this instance.
    pub linked: bool,
    /// Instances whose liveliness tokens stand.
    pub present: BTreeSet<InstanceId>,
}
