//! What a user can set on an estimator. Each key is the key of `[estimator]` in `fleetcal.toml`.

use serde::{Deserialize, Serialize};

/// Which measurement the filter makes of the LiDAR's motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Measurement {
    /// Motion since a recent anchor whose pose is cloned into the state. The default.
    #[default]
    Clone,
    /// The paper's: motion since the first pose, `T^{L0}_{Lk}` with white noise.
    Anchored,
}

/// What becomes of a parameter that need not be estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Freedom {
    /// Estimated from its prior.
    Estimated,
    /// Held at its value; its doubt stays in the other parameters' sigmas.
    Fixed,
    /// Taken as exactly right.
    Off,
}

/// Settings of an estimator. `fleetcal.toml` documents each key with its default.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EstimatorSettings {
    /// Which measurement the filter makes.
    pub measurement: Measurement,
}
