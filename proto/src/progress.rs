//! Progress of the service with a robot's streams, by which a sender paces itself.

use fleetcal_model::RobotTime;
use serde::{Deserialize, Serialize};

/// What the service has taken in of one robot since it began to listen to it.
///
/// A sender that may be faster than real time asks for it and never runs further ahead than the
/// robot's mailbox holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Progress {
    /// Drive samples worked through.
    pub drive_samples: u64,
    /// Scans or LiDAR poses worked through.
    pub scans: u64,
    /// Messages given up because the mailbox was full, or refused.
    #[serde(rename = "shed")]
    pub dropped: u64,
    /// Header stamp of the newest message worked through, ns since 1970; 0 before the first.
    pub stamp_ns: RobotTime,
}
