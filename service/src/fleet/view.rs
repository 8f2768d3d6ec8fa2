//! What the rest of the service sees of a robot.

use std::collections::BTreeMap;
use std::sync::Arc;

use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::{ChangeDocument, EstimateDocument};
use fleetcal_proto::event::RobotEvent;
use fleetcal_proto::ros2_key::KeyLayout;
use serde::{Deserialize, Serialize};

use crate::alert::Alert;
use crate::config::RobotConfig;
use crate::fleet::pairing::PairingReport;

/// A stream that a robot sends.
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
    utoipa::ToSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Stream {
    /// Measured speed and steering.
    Drive,
    /// Measured steering alone, of a robot whose speed comes on a topic of its own.
    Steering,
    /// Measured speed alone.
    Speed,
    /// Raw sweeps.
    Scan,
    /// Poses of the LiDAR, made on the robot.
    LidarOdometry,
    /// Notes of people and tools.
    Event,
}

impl Stream {
    /// All of them.
    pub const ALL: [Self; Self::COUNT] = [
        Self::Drive,
        Self::Steering,
        Self::Speed,
        Self::Scan,
        Self::LidarOdometry,
        Self::Event,
    ];
    /// How many there are.
    pub const COUNT: usize = 6;

    /// Its place in [`Self::ALL`].
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Whether it tells how the vehicle drives.
    pub const fn is_drive(self) -> bool {
        matches!(self, Self::Drive | Self::Steering | Self::Speed)
    }

    /// The name in keys and documents.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Drive => "drive",
            Self::Steering => "steering",
            Self::Speed => "speed",
            Self::Scan => "scan",
            Self::LidarOdometry => "lidar_odometry",
            Self::Event => "event",
        }
    }
}

/// Where a robot stands, in one word.
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
    utoipa::ToSchema,
)]
#[serde(rename_all = "snake_case")]
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
    pub const fn name(self) -> &'static str {
        match self {
            Self::Unregistered => "unregistered",
            Self::NoData => "no_data",
            Self::Failed => "failed",
            Self::Changed => "changed",
            Self::Learning => "learning",
            Self::Calibrated => "calibrated",
        }
    }
}

/// What has come in on one stream.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StreamView {
    /// Which stream.
    pub stream: Stream,
    /// Messages received.
    pub messages: u64,
    /// Messages per second of receipt time, over the last seconds.
    pub rate_hz: f64,
    /// When the last one was received, wall time; `None` before the first.
    pub last_received_ns: Option<i64>,
}

/// Whether the robot is there.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Connection {
    /// When anything was last received since the service started, wall time.
    pub last_seen_ns: Option<i64>,
    /// When it was last heard before that, to the few seconds after which estimates are stored.
    pub heard_before_ns: Option<i64>,
    /// Whether nothing has come for [`crate::limits::STALE_AFTER`].
    pub stale: bool,
    /// Whether its liveliness token stands.
    pub alive: bool,
    /// What it sends.
    pub streams: Vec<StreamView>,
}

impl Connection {
    /// When anything was last received, before or after the service started.
    pub fn last_heard_ns(&self) -> Option<i64> {
        self.last_seen_ns.or(self.heard_before_ns)
    }
}

/// What became of a robot's messages:
/// `received = processed + shed_… + refused + ignored + waiting`, always.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, utoipa::ToSchema)]
pub struct Counters {
    /// Messages that came in.
    pub received: u64,
    /// Messages that the estimator has taken.
    pub processed: u64,
    /// Drive samples shed because the mailbox was full.
    pub shed_drive: u64,
    /// Scans and poses shed because the mailbox was full.
    pub shed_scans: u64,
    /// Notes shed because the mailbox was full.
    pub shed_notes: u64,
    /// Messages that could not be decoded or hold values that cannot be.
    pub refused: u64,
    /// Why the last one was refused.
    pub last_refusal: Option<String>,
    /// Messages that came while the robot was not configured.
    pub ignored: u64,
    /// Messages that wait in the mailbox or are being worked on.
    pub waiting: u64,
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
    pub fresh: Option<(u64, Arc<EstimateDocument>)>,
    /// What became of its messages.
    pub counters: Counters,
    /// Times that its estimator was started anew after a panic.
    pub estimator_restarts: u32,
    /// How well steering and speed of different topics fit together; `None` of a robot that sends
    /// both in one.
    pub pairing: Option<PairingReport>,
    /// What looks wrong with what it sends.
    pub warnings: Vec<Warning>,
    /// The ROS 2 topics that it has announced, by name.
    pub topics: Arc<[AnnouncedTopic]>,
}

/// A ROS 2 topic that a robot has announced.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, utoipa::ToSchema)]
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
}

/// Something that looks wrong with what a robot sends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum WarningKind {
    /// The steering angle has neither a sensor's noise nor its lag.
    SteeringLooksCommanded,
}

/// A warning, with words for people.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, utoipa::ToSchema)]
#[schema(as = RobotWarning)]
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
}

/// What the service itself has to say in a robot's history.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ServiceEventKind {
    /// The robot's clock jumped back by more than 5 s: a new session began.
    SessionStarted,
    /// The robot was configured, or configured anew: its estimator begins from nothing.
    Configured,
    /// The estimator panicked and was started anew.
    EstimatorRestarted,
    /// The estimator panicked too often and was stopped.
    EstimatorStopped,
}

/// An entry of a robot's history that the service makes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ServiceEvent {
    /// What happened.
    pub kind: ServiceEventKind,
    /// When, ns since 1970: by the robot's clock where it has sent, else by the service's.
    pub stamp_ns: i64,
    /// More about it, for people.
    #[serde(default)]
    pub note: String,
}

/// An entry of a robot's history. Each has a `kind` and a `stamp_ns`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum HistoryEvent {
    /// The estimator saw a change or a fault.
    Change(ChangeDocument),
    /// A person or a tool attached a note.
    Note(RobotEvent),
    /// The service did something.
    Service(ServiceEvent),
}

impl HistoryEvent {
    /// When it happened, ns since 1970, by the robot's clock.
    pub fn stamp_ns(&self) -> i64 {
        match self {
            Self::Change(change) => change.stamp_ns,
            Self::Note(note) => note.stamp_ns,
            Self::Service(event) => event.stamp_ns,
        }
    }
}

/// Something that a listener of the event stream wants to know at once.
#[derive(Debug, Clone, PartialEq)]
pub enum LiveUpdate {
    /// A robot's new estimate, at most one a second of message time.
    Estimate {
        /// Whose.
        robot: RobotId,
        /// What.
        document: Arc<EstimateDocument>,
    },
    /// A robot's state, connection or configuration changed; at most one a second and robot.
    RobotState {
        /// Whose.
        robot: RobotId,
        /// The new state.
        state: RobotState,
        /// Whether nothing has come for [`crate::limits::STALE_AFTER`].
        stale: bool,
        /// Whether its liveliness token stands.
        alive: bool,
    },
    /// A record of a robot's life cycle changed: what is shown of it should be read again.
    Approval {
        /// Whose.
        robot: RobotId,
    },
    /// An alert of a robot changed.
    Alert {
        /// Whose.
        robot: RobotId,
        /// The alert as it stands now; one that is [`crate::alert::ConditionName::Normal`] is over.
        alert: Arc<Alert>,
    },
    /// Something happened to a robot.
    Event {
        /// Whose.
        robot: RobotId,
        /// What.
        event: Arc<HistoryEvent>,
    },
}

/// Counters of the whole service, for `/metrics`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct FleetCounters {
    /// Messages that came in on any key.
    pub received: u64,
    /// Messages on keys that name no robot or no stream.
    pub foreign_keys: u64,
    /// Messages larger than [`crate::limits::PAYLOAD_BYTES_MAX`].
    pub oversized: u64,
    /// Messages of robots beyond [`crate::limits::UNREGISTERED_ROBOTS_MAX`].
    pub beyond_robots_max: u64,
    /// Questions over Zenoh beyond [`crate::limits::QUESTIONS_MAX`].
    pub unanswered_questions: u64,
    /// Estimators that panicked.
    pub estimator_panics: u64,
    /// Messages received from robots in each stream.
    pub by_stream: BTreeMap<&'static str, u64>,
}
