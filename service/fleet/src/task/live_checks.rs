//! Joining checks of a robot that sends, with the messages that were not used.

use fleetcal_checks::Watch;
use fleetcal_domain::robot::{CheckFinding, RobotConfig};
use fleetcal_estimator::lidar_odometry::OdometryPose;
use fleetcal_model::{Stream, WallTime};

use crate::joining::JoiningChecks;
use crate::left_out::LeftOutReason;

/// Joining checks of a robot that sends.
#[derive(Debug)]
pub(super) struct LiveChecks {
    pub(super) joining: JoiningChecks<Watch>,
    /// Messages that were not used, by stream and reason.
    pub(super) left_out: [[u64; LeftOutReason::COUNT]; Stream::COUNT],
    /// Stream of the message in hand.
    pub(super) stream: Stream,
    /// Speeds without an angle so far.
    pub(super) unpaired: u64,
    /// Time of the last report.
    pub(super) shown_ns: WallTime,
}

impl LiveChecks {
    /// Makes the checks of a robot, with the findings before.
    pub(super) fn new(config: &RobotConfig, findings: &[CheckFinding]) -> Self {
        Self {
            joining: JoiningChecks::of_robot(config, findings),
            left_out: Default::default(),
            stream: Stream::WheelOdometry,
            unpaired: 0,
            shown_ns: WallTime(0),
        }
    }

    /// Takes the pose that LiDAR odometry gives a scan.
    pub(super) fn take_odometry(&mut self, pose: &OdometryPose) {
        self.joining.take_odometry(pose);
    }

    /// Counts messages that were not used.
    pub(super) fn count(&mut self, stream: Stream, reason: LeftOutReason, messages: u64) {
        let of_stream = self.left_out.get_mut(stream.index());
        if let Some(count) = of_stream.and_then(|counts| counts.get_mut(reason as usize)) {
            *count += messages;
        }
    }
}
