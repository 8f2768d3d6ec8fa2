//! Progress of the service with a robot's streams, by which a sender paces itself.

use fleetcal_model::RobotTime;
use serde::{Deserialize, Serialize};

/// Messages of one robot that the service has processed since it began to receive them.
///
/// A sender that may be faster than real time queries it and never runs further ahead than the
/// robot's mailbox holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Progress {
    /// Messages of wheel odometry processed, of one drive sample or several.
    pub drive_samples: u64,
    /// Scans or LiDAR poses processed.
    pub scans: u64,
    /// Messages dropped because the mailbox was full, or refused.
    #[serde(rename = "shed")]
    pub dropped: u64,
    /// Header stamp of the newest processed message, ns since 1970; 0 before the first.
    pub stamp_ns: RobotTime,
}
