//! Signed documents by their generation, and the values that a robot uses.

use fleetcal_model::{Generation, RevisionId, RobotTime};
use fleetcal_proto::calibration::CalibrationValues;
use serde::{Deserialize, Serialize};

/// A signed document that a robot is to hold.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct GenerationRef {
    /// Its generation.
    pub generation: Generation,
    /// SHA-256 of the document, lower-case hexadecimal.
    pub sha256: String,
    /// The revision in it.
    pub revision: RevisionId,
    /// The person who rolled the robot back to it; absent for an approved calibration and for an
    /// automatic roll-back. Only people replace what a person chose.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chosen_by: Option<String>,
}

/// Values that a robot compensates with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct InUse {
    /// Generation of the document; 0 for its factory calibration.
    pub generation: Generation,
    /// The revision; `None` for its factory calibration.
    pub revision: Option<RevisionId>,
    /// The values.
    pub values: CalibrationValues,
    /// Since when, ns since 1970, by the robot's clock.
    pub since_ns: RobotTime,
}
