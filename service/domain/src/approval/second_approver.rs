//! Reason for a second approver, and the drawing that a change may be measured from.

use fleetcal_proto::calibration::CalibrationValues;
use serde::{Deserialize, Serialize};

/// Values of a robot that is built by its drawing, and the author of that drawing.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawing {
    /// Values of the drawing.
    pub values: CalibrationValues,
    /// Person or tool that gave it; `None` if the configuration file does.
    pub by: Option<String>,
}

/// Reason for which a proposal needs a second approver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum SecondApprover {
    /// The change is beyond `two_approvers_beyond`.
    Beyond,
    /// A scale, the wheelbase or a delay changes considerably.
    Vehicle,
    /// The rear axle's pose in `base_link` differs from that of the values in use.
    Frame,
    /// The robot has neither an approved calibration nor a drawing.
    Unknown,
    /// The robot has no approved calibration, and its drawing is of somebody who proposes or
    /// approves.
    OwnDrawing,
}

/// Number of approvals needed.
pub(super) fn approvals_needed(second: Option<SecondApprover>) -> u32 {
    if second.is_some() { 2 } else { 1 }
}
