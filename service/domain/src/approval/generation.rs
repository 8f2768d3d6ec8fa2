//! Signed documents by their generation, and values in use.

use fleetcal_model::{Generation, RevisionId, RobotTime};
use fleetcal_proto::calibration::CalibrationValues;
use serde::{Deserialize, Serialize};

/// Signed document for a robot.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct GenerationRef {
    /// Generation of the document.
    pub generation: Generation,
    /// SHA-256 of the document, lower-case hexadecimal.
    pub sha256: String,
    /// Revision in the document.
    pub revision: RevisionId,
    /// The person who rolled the robot back to it; absent for an approved calibration and for an
    /// automatic roll-back. Only people replace what a person chose.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chosen_by: Option<String>,
}

/// Values in use of a robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct InUse {
    /// Generation of the document; 0 for its factory calibration.
    pub generation: Generation,
    /// Revision; `None` for its factory calibration.
    pub revision: Option<RevisionId>,
    /// The values.
    pub values: CalibrationValues,
    /// Begin of their use, ns since 1970, by the robot's clock.
    pub since_ns: RobotTime,
}
