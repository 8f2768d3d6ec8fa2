//! Name of the filter's measurement, as former versions store it with settings and filters.

use serde::{Deserialize, Serialize};

/// Measurement that the filter makes of the LiDAR's motion. There is no choice any more.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Measurement {
    /// Motion since a recent anchor whose pose is cloned into the state.
    #[default]
    Clone,
    /// The paper's: motion since the first pose. It can be read, and is refused by
    /// [`EstimatorSettings::check`](super::EstimatorSettings::check).
    Anchored,
}
