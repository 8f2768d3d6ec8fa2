//! View of a robot for the rest of the service.

use std::sync::Arc;

use fleetcal_model::{AuditId, Generation, RobotId, Stream, WallTime};
use fleetcal_proto::estimate::{EstimateDocument, EstimatedBy};
use fleetcal_proto::ros2_key::KeyLayout;
use serde::{Deserialize, Serialize};
use strum::{IntoStaticStr, VariantArray};

use super::config::RobotConfig;

/// Where a robot stands, in one word.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, IntoStaticStr,
)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum RobotState {
    /// It sends, but nobody has given its vehicle.
    Unregistered,
    /// It is configured and sends nothing.
    NoData,
    /// Its estimator failed too often and was stopped.
    Failed,
    /// Its vehicle is no longer the one that was calibrated; the new values are being learnt.
    Changed,
    /// Its parameters are on their way.
    Learning,
    /// Every parameter that its motions can tell is converged.
    Calibrated,
}

impl RobotState {
    /// The name in documents.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// What has come in on one stream.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StreamView {
    /// Which stream.
    pub stream: Stream,
    /// Messages received.
    pub messages: u64,
    /// Messages per second of receipt time, over the last seconds.
    pub rate_hz: f64,
    /// When the last one was received, wall time; `None` before the first.
    pub last_received_ns: Option<WallTime>,
}

/// Whether the robot is there.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Connection {
    /// When anything was last received since the service started, wall time.
    pub last_seen_ns: Option<WallTime>,
    /// When it was last heard before that, to the few seconds after which estimates are stored.
    pub heard_before_ns: Option<WallTime>,
    /// Whether nothing has come for [`crate::limits::STALE_AFTER`].
    pub stale: bool,
    /// Whether its liveliness token stands.
    pub alive: bool,
    /// What it sends.
    pub streams: Vec<StreamView>,
}

impl Connection {
    /// When anything was last received, before or after the service started.
    pub fn last_heard(&self) -> Option<WallTime> {
        self.last_seen_ns.or(self.heard_before_ns)
    }
}

/// What became of a robot's messages:
/// `received = processed + dropped_… + refused + ignored + waiting`, always.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Counters {
    /// Messages that came in.
    pub received: u64,
    /// Messages that the estimator has taken.
    pub processed: u64,
    /// Drive samples dropped because the mailbox was full.
    pub dropped_wheel_odometry: u64,
    /// Scans and poses dropped because the mailbox was full.
    pub dropped_scans: u64,
    /// Notes dropped because the mailbox was full.
    pub dropped_notes: u64,
    /// Messages that could not be decoded or hold values that cannot be.
    pub refused: u64,
    /// Why the last one was refused.
    pub last_refusal: Option<String>,
    /// Messages that came while the robot was not configured.
    pub ignored: u64,
    /// Messages that wait in the mailbox or are being worked on.
    pub waiting: u64,
}

/// How well steering and speed fit together.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = Pairing))]
pub struct PairingReport {
    /// Drive samples made of two messages.
    pub paired: u64,
    /// Speeds that had no steering angle near enough, and were left out.
    pub unpaired: u64,
    /// Mean distance in time from a speed to the nearest angle, s.
    pub error_mean_s: f64,
    /// Largest of these, s.
    pub error_max_s: f64,
}

/// How a robot is heard, in one word.
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
    /// It sends data, in maintenance or not.
    Online,
    /// It should send data and does not.
    Silent,
    /// It is switched off on purpose and sends nothing.
    Maintenance,
}

impl ConnectionState {
    /// All of them.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// How a robot is heard that has sent nothing for some seconds (`stale`), or is in maintenance.
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

/// One robot as the rest of the service sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotView {
    /// Its id.
    pub id: RobotId,
    /// Its configuration; `None` for an unregistered robot.
    pub config: Option<RobotConfig>,
    /// Where it stands.
    pub state: RobotState,
    /// Whether it is there, and what it sends.
    pub connection: Connection,
    /// The latest estimate, once there is one.
    pub estimate: Option<Arc<EstimateDocument>>,
    /// An estimate from nothing but what came since the values of this generation are in use;
    /// `None` while nothing is to be verified.
    pub verification: Option<(Generation, Arc<EstimateDocument>)>,
    /// What became of its messages.
    pub counters: Counters,
    /// Times that its estimator was restarted after a panic.
    pub estimator_restarts: u32,
    /// How well steering and speed of different topics fit together; `None` of a robot that sends
    /// both in one.
    pub pairing: Option<PairingReport>,
    /// What looks wrong with what it sends.
    pub warnings: Vec<Warning>,
    /// Whether somebody has reported a reassembly, and the calibration is not known again since.
    pub reassembly_open: bool,
    /// Up to which note of the audit its estimator has taken them; `None` while nobody says so.
    pub notes_taken: Option<AuditId>,
    /// The ROS 2 topics that it has announced, by name.
    pub topics: Arc<[AnnouncedTopic]>,
    /// Which instance of a cluster estimates it; `None` while none does, and where one service has
    /// all robots.
    pub estimated_by: Option<EstimatedBy>,
}

/// A ROS 2 topic that a robot has announced.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct AnnouncedTopic {
    /// Its name below the robot, `front/scan`.
    pub topic: String,
    /// Its type, `sensor_msgs/msg/LaserScan`.
    #[serde(rename = "type")]
    pub type_name: String,
    /// Which Zenoh keys its messages have.
    pub layout: KeyLayout,
    /// The streams that it could be.
    pub suited_for: Vec<Stream>,
    /// Says that its robot is configured to use it, but the service's access list, which is made when
    /// the service starts, lets nothing of it through.
    pub blocked: bool,
}

/// Something that looks wrong with what a robot sends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum WarningKind {
    /// The steering angle has neither a sensor's noise nor its lag.
    SteeringLooksCommanded,
    /// The scans state no beam times, and the scanner turns; or the points of its clouds have none.
    ScanBeamTimesMissing,
    /// The LiDAR's scanning plane is tilted: it sees the floor.
    ScannerSeesFloor,
    /// Two senders use the robot's id.
    TwoSenders,
    /// It sends on a key that is no longer used.
    FormerKey,
    /// Stamps are coarser than the rate of their stream.
    StampsCoarse,
    /// A topic of a bridge is not on the access list.
    TopicBlocked,
}

/// A warning, with words for people.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = RobotWarning))]
pub struct Warning {
    /// Which one.
    pub kind: WarningKind,
    /// What was seen, and what to do.
    pub text: String,
}

impl Warning {
    /// The warning of [`WarningKind::SteeringLooksCommanded`].
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

    /// The warning of [`WarningKind::TwoSenders`].
    pub fn two_senders() -> Self {
        Self {
            kind: WarningKind::TwoSenders,
            text: "Two senders use this robot's id at once. Nothing that they send is used until \
                   there is one again. Stop the second one."
                .to_owned(),
        }
    }

    /// The warning of [`WarningKind::StampsCoarse`]; of which streams.
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

    /// The warning of [`WarningKind::TopicBlocked`] for the topics of a robot that are blocked, if any.
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

    /// The warning of [`WarningKind::FormerKey`]; `key` is the one to send to.
    pub fn former_key(key: &str) -> Self {
        Self {
            kind: WarningKind::FormerKey,
            text: format!(
                "The robot sends its wheel odometry on the former key, which is no longer used. \
                 Send it on {key}."
            ),
        }
    }

    /// The warning of [`WarningKind::ScannerSeesFloor`]; where it sees the floor: how far from the
    /// LiDAR, m, and in which direction of its frame, rad. It is told to half a metre and 5°, so that the
    /// text stays the same while the place is known ever better.
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

    /// The warning of [`WarningKind::ScanBeamTimesMissing`] where the scans are clouds.
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

    /// The warning of [`WarningKind::ScanBeamTimesMissing`] where they are laser scans.
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
