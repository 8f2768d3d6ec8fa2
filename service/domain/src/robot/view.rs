//! View of a robot for the rest of the service.

use std::sync::Arc;

use fleetcal_model::{AuditId, Generation, RobotId, Stream, WallTime};
use fleetcal_proto::estimate::{EstimateDocument, EstimatedBy};
use fleetcal_proto::ros2_key::KeyLayout;
use serde::{Deserialize, Serialize};
use strum::{IntoStaticStr, VariantArray};

use super::checks::{CheckFinding, ChecksReport, LeftOut};
use super::config::RobotConfig;

/// State of a robot, in one word.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Serialize,
    Deserialize,
    IntoStaticStr,
    VariantArray,
)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum RobotState {
    /// Robot that sends data, without a configured vehicle.
    Unregistered,
    /// Configured robot that sends no data.
    NoData,
    /// Estimator stopped after too many failures.
    Failed,
    /// Vehicle changed since it was calibrated; the new values are being learnt.
    Changed,
    /// Parameters not converged yet.
    Learning,
    /// Every parameter that its motions make observable has converged.
    Calibrated,
}

impl RobotState {
    /// Every state.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// The name in documents.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Traffic of one stream.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StreamView {
    /// The stream.
    pub stream: Stream,
    /// Messages received.
    pub messages: u64,
    /// Messages per second of receipt time, over the last seconds.
    pub rate_hz: f64,
    /// Receipt of the last message, wall time; `None` before the first.
    pub last_received_ns: Option<WallTime>,
}

/// Connection of a robot.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Connection {
    /// Last receipt of any data since the service started, wall time.
    pub last_seen_ns: Option<WallTime>,
    /// Last receipt before that, accurate to the seconds between two stored estimates.
    pub heard_before_ns: Option<WallTime>,
    /// True if nothing was received for [`crate::limits::STALE_AFTER`].
    pub stale: bool,
    /// True if its liveliness token is present.
    pub alive: bool,
    /// Streams that it sends.
    pub streams: Vec<StreamView>,
}

impl Connection {
    /// Last receipt of any data, before or after the service started.
    pub fn last_heard(&self) -> Option<WallTime> {
        self.last_seen_ns.or(self.heard_before_ns)
    }
}

/// Counts of a robot's messages by their outcome: `received = processed + dropped_… + refused +
/// ignored + waiting`, always.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Counters {
    /// Messages received.
    pub received: u64,
    /// Messages processed by the estimator.
    pub processed: u64,
    /// Drive samples in the processed messages.
    #[serde(default)]
    pub drive_samples: u64,
    /// Messages of wheel odometry dropped because the mailbox was full.
    pub dropped_wheel_odometry: u64,
    /// Drive samples in those messages.
    #[serde(default)]
    pub dropped_drive_samples: u64,
    /// Scans and poses dropped because the mailbox was full.
    pub dropped_scans: u64,
    /// Notes dropped because the mailbox was full.
    pub dropped_notes: u64,
    /// Messages that could not be decoded or hold impossible values.
    pub refused: u64,
    /// Reason of the last refusal.
    pub last_refusal: Option<String>,
    /// Messages received while the robot was not configured.
    pub ignored: u64,
    /// Messages in the mailbox or being processed.
    pub waiting: u64,
}

/// Pairing of steering and speed.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = Pairing))]
pub struct PairingReport {
    /// Drive samples made from two messages.
    pub paired: u64,
    /// Speeds dropped for lack of a steering angle near enough in time.
    pub unpaired: u64,
    /// Mean time from a speed to the nearest angle, s.
    pub error_mean_s: f64,
    /// Largest of these times, s.
    pub error_max_s: f64,
}

/// Availability of a robot's data, in one word.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Serialize,
    Deserialize,
    IntoStaticStr,
    VariantArray,
)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum ConnectionState {
    /// Robot sends data, in maintenance or not.
    Online,
    /// Robot should send data and does not.
    Silent,
    /// Robot is switched off on purpose and sends nothing.
    Maintenance,
}

impl ConnectionState {
    /// Every value.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// Availability of a robot that is or is not `stale` (has sent nothing for some seconds) and in
    /// maintenance.
    pub const fn of(stale: bool, in_maintenance: bool) -> Self {
        match (stale, in_maintenance) {
            (false, _) => Self::Online,
            (true, true) => Self::Maintenance,
            (true, false) => Self::Silent,
        }
    }

    /// The name in documents.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// View of one robot for the rest of the service.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotView {
    /// Its id.
    pub id: RobotId,
    /// Its configuration; `None` for an unregistered robot.
    pub config: Option<RobotConfig>,
    /// State of the robot.
    pub state: RobotState,
    /// Connection and streams.
    pub connection: Connection,
    /// Latest estimate, once there is one.
    pub estimate: Option<Arc<EstimateDocument>>,
    /// Verification estimate from the data since the values of this generation were applied; `None`
    /// without a verification under way.
    pub verification: Option<(Generation, Arc<EstimateDocument>)>,
    /// Counts of its messages by their outcome.
    pub counters: Counters,
    /// Restarts of its estimator after a panic.
    pub estimator_restarts: u32,
    /// Pairing of steering and speed of different topics; `None` if the robot sends both in one.
    pub pairing: Option<PairingReport>,
    /// Warnings about its data.
    pub warnings: Vec<Warning>,
    /// Joining checks of its messages; empty before it has sent anything. Of a robot that another
    /// instance estimates, the named causes alone.
    pub checks: Arc<ChecksReport>,
    /// True if a reassembly was reported, and the calibration is not known again since.
    pub reassembly_open: bool,
    /// Newest note of the audit that its estimator has processed; `None` while unknown.
    pub notes_taken: Option<AuditId>,
    /// Announced ROS 2 topics, by name.
    pub topics: Arc<[AnnouncedTopic]>,
    /// Instance of a cluster that estimates it; `None` while there is none, and for a single
    /// service.
    pub estimated_by: Option<EstimatedBy>,
}

impl RobotView {
    /// True if there is a warning of this kind.
    pub fn is_warned(&self, kind: WarningKind) -> bool {
        self.warnings.iter().any(|warning| warning.kind == kind)
    }
}

/// ROS 2 topic that a robot has announced.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct AnnouncedTopic {
    /// Name below the robot, such as `front/scan`.
    pub topic: String,
    /// Type, such as `sensor_msgs/msg/LaserScan`.
    #[serde(rename = "type")]
    pub type_name: String,
    /// Layout of its messages' Zenoh keys.
    pub layout: KeyLayout,
    /// Streams that it could carry.
    pub suited_for: Vec<Stream>,
    /// True if its robot is configured to use it, but the service's access list, which is built
    /// when the service starts, does not admit it.
    pub blocked: bool,
}

/// Kind of warning about a robot's data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum WarningKind {
    /// Steering angle with neither a sensor's noise nor its lag.
    SteeringLooksCommanded,
    /// Scans of a turning scanner without beam times, or clouds whose points have none.
    ScanBeamTimesMissing,
    /// Tilted scanning plane: the LiDAR sees the floor.
    ScannerSeesFloor,
    /// Two senders under the robot's id.
    TwoSenders,
    /// Messages on a key that is no longer used.
    FormerKey,
    /// Stamps are coarser than the rate of their stream.
    StampsCoarse,
    /// Topic of a bridge that the access list lacks.
    TopicBlocked,
    /// Messages without a stamp.
    StampedOnArrival,
    /// Steering angle computed from a yaw rate.
    SteeringFromYawRate,
    /// Cause that a joining check names.
    JoiningCheck,
    /// Many messages of a stream are not used.
    MessagesLeftOut,
}

/// Warning, with words for people.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = RobotWarning))]
pub struct Warning {
    /// Kind of the warning.
    pub kind: WarningKind,
    /// Observation and advice.
    pub text: String,
}

impl Warning {
    /// Warning of [`WarningKind::SteeringLooksCommanded`].
    pub fn steering_looks_commanded() -> Self {
        Self {
            kind: WarningKind::SteeringLooksCommanded,
            text: "The steering angle has neither a sensor's noise nor its lag: it looks like the \
                   command, not the measurement. What is estimated from it is the error of the \
                   whole steering, and it is wrong while the wheel still turns. Send the measured \
                   angle."
                .to_owned(),
        }
    }

    /// Warning of [`WarningKind::TwoSenders`].
    pub fn two_senders() -> Self {
        Self {
            kind: WarningKind::TwoSenders,
            text: "Two senders use this robot's id at once. Nothing that they send is used until \
                   there is one again. Stop the second one."
                .to_owned(),
        }
    }

    /// Warning of [`WarningKind::StampsCoarse`] about some streams.
    pub fn stamps_coarse(streams: &[Stream]) -> Self {
        Self {
            kind: WarningKind::StampsCoarse,
            text: format!(
                "Most messages of {} have the stamp of the one before, as where stamps are whole \
                 seconds: of each stamp only the first message is used, and nothing can be timed by \
                 it. Stamp each message when it was measured, to a millisecond or better.",
                names(streams)
            ),
        }
    }

    /// Warning of [`WarningKind::StampedOnArrival`] about some streams, if any.
    pub fn stamped_on_arrival(streams: &[Stream]) -> Option<Self> {
        (!streams.is_empty()).then(|| Self {
            kind: WarningKind::StampedOnArrival,
            text: format!(
                "Messages of {} have no stamp and count as measured when they arrive: every delay \
                 on their way, and the difference of the clocks, is an error of their time. Send a \
                 message with a stamp.",
                names(streams)
            ),
        })
    }

    /// Warning of [`WarningKind::SteeringFromYawRate`].
    pub fn steering_from_yaw_rate() -> Self {
        Self {
            kind: WarningKind::SteeringFromYawRate,
            text: "The steering angle is computed from speed and yaw rate by the configured \
                   wheelbase. Its offset is that of the sensor only if the robot computes the yaw \
                   rate from its steering by the same wheelbase, not from a gyroscope. Send the \
                   measured angle."
                .to_owned(),
        }
    }

    /// Warning of [`WarningKind::TopicBlocked`] for a robot's blocked topics, if any.
    pub fn topic_blocked(topics: &[AnnouncedTopic]) -> Option<Self> {
        let blocked = topics.iter().filter(|topic| topic.blocked);
        let names: Vec<&str> = blocked.map(|topic| topic.topic.as_str()).collect();
        (!names.is_empty()).then(|| Self {
            kind: WarningKind::TopicBlocked,
            text: format!(
                "The robot's bridge offers {}, but nothing of it arrives: the service's access list \
                 was made when the service started, before anybody named it. Restart the service, \
                 or name topics of robots to come in bridge_topics of [ros2].",
                names.join(" and ")
            ),
        })
    }

    /// Warning of [`WarningKind::JoiningCheck`] about the causes that are named, if any.
    pub fn joining_check(checks: &ChecksReport) -> Option<Self> {
        Self::of_all(
            WarningKind::JoiningCheck,
            checks.named().map(CheckFinding::in_words),
        )
    }

    /// Warning of [`WarningKind::MessagesLeftOut`] about the streams of which much is not used, if
    /// any. The text has no numbers, so that it is stable while messages come.
    pub fn messages_left_out(checks: &ChecksReport) -> Option<Self> {
        let text = |(stream, left_out): (&str, &LeftOut)| {
            let reason = left_out.reason.replace('_', " ");
            format!("Many messages of {stream} are not used: {reason}.")
        };
        Self::of_all(
            WarningKind::MessagesLeftOut,
            checks.much_left_out().map(text),
        )
    }

    /// One warning of a kind with several texts.
    fn of_all(kind: WarningKind, texts: impl Iterator<Item = String>) -> Option<Self> {
        let texts: Vec<String> = texts.collect();
        (!texts.is_empty()).then(|| Self {
            kind,
            text: texts.join(" "),
        })
    }

    /// Warning of [`WarningKind::FormerKey`]; `key` is the one to send to.
    pub fn former_key(key: &str) -> Self {
        Self {
            kind: WarningKind::FormerKey,
            text: format!(
                "The robot sends its wheel odometry on the former key, which is no longer used. \
                 Send it on {key}."
            ),
        }
    }

    /// Warning of [`WarningKind::ScannerSeesFloor`]: distance of the floor from the LiDAR, m, and
    /// its direction in the LiDAR's frame, rad. They are rounded to half a metre and 5°, so that
    /// the text is stable while they become more accurate.
    pub fn scanner_sees_floor(distance_m: f64, direction_rad: f64) -> Self {
        let distance_m = 0.5 * (2.0 * distance_m).round();
        let direction_deg = 5 * (direction_rad.to_degrees() / 5.0).round() as i64;
        Self {
            kind: WarningKind::ScannerSeesFloor,
            text: format!(
                "The LiDAR sees the floor some {distance_m:.1} m away, at {direction_deg}° in its frame \
                 (positive to the left): its scanning plane is probably tilted in that direction. \
                 These returns are left out. Level the LiDAR; if it is level, look for an edge that \
                 the robot carries or follows."
            ),
        }
    }

    /// Warning of [`WarningKind::ScanBeamTimesMissing`] for clouds.
    pub fn point_times_missing() -> Self {
        Self {
            kind: WarningKind::ScanBeamTimesMissing,
            text: "The points of the clouds have no times: no field t, time, timestamp, time_stamp \
                   or offset_time, or all the same. A scanner that turns is taken as if it looked \
                   everywhere at once, so the time offset stays unknown and the LiDAR's pose can be \
                   off. Have the driver send the times; for a scanner that takes all points at \
                   once, or clouds that were deskewed, set ignore_times in point_cloud."
                .to_owned(),
        }
    }

    /// Warning of [`WarningKind::ScanBeamTimesMissing`] for laser scans.
    pub fn scan_beam_times_missing() -> Self {
        Self {
            kind: WarningKind::ScanBeamTimesMissing,
            text: "The scans have time_increment 0, but the scanner turns while it measures. The \
                   duration of a scan is estimated from the robot's motion. Set time_increment in \
                   the scanner's driver, and stamp each scan at its first beam."
                .to_owned(),
        }
    }
}

fn names(streams: &[Stream]) -> String {
    let names: Vec<&str> = streams.iter().map(|stream| stream.name()).collect();
    names.join(" and ")
}
