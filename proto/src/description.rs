//! Documents of the configuration that a robot's own description implies.

use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Configuration that a robot's description implies: its URDF and its static transforms.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct DescriptionDocument {
    /// Topics and files of the description.
    pub origins: Vec<String>,
    /// Derived values.
    pub values: Vec<DescribedValue>,
    /// Values that cannot be derived, each with its reason in one sentence.
    pub missing: Vec<String>,
    /// Matters that a person has to know, contradictions among them.
    pub remarks: Vec<String>,
}

/// Value of the configuration by a robot's description.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct DescribedValue {
    /// Key of the configuration, `wheelbase_m` or `streams.joints`; `track_m`, which is none, is for
    /// people.
    pub key: String,
    /// The value, as the configuration has it.
    pub value: Value,
    /// Joints, links or frames that it is derived from.
    pub source: String,
    /// True if it is used: no flag or configuration gives another one.
    pub used: bool,
    /// Value of the configuration; null if it has none.
    pub in_use: Option<Value>,
    /// True if the configuration contradicts it.
    pub contradicted: bool,
}
