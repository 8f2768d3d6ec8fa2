//! Documents of a robot.

use std::sync::Arc;

use fleetcal_domain::approval::RobotLedger;
use fleetcal_domain::robot::{
    AnnouncedTopic, Counters, PairingReport, RobotConfig, RobotState, RobotView, StreamView,
    Warning,
};
use fleetcal_domain::standing::Standing;
use fleetcal_fleet::Configured;
use fleetcal_fleet::document::vehicle_document;
use fleetcal_model::{Stream, Version, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::{EstimateDocument, VehicleDocument};
use fleetcal_store::RobotRecord;
use jiff::Timestamp;
use serde::Serialize;

use super::connection::ConnectionDocument;
use crate::approval::CalibrationSummary;
use crate::cluster::Owners;
use crate::time;

/// A robot in the list.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct RobotSummary {
    /// Its id.
    pub(super) id: RobotId,
    /// Where its estimate stands, in one word.
    pub(super) state: RobotState,
    /// How it stands by its estimate, its calibration's life cycle and its alerts: the most urgent
    /// of what is so.
    pub(super) standing: Standing,
    /// Whether nothing has come for some seconds.
    pub(super) stale: bool,
    /// Whether its liveliness token stands.
    pub(super) alive: bool,
    /// When anything was last received from it.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub(super) last_seen: Option<Timestamp>,
    /// Whether it is heard: online, silent, or switched off on purpose.
    connection: ConnectionDocument,
    /// The instance that estimates it; absent while none does, and where one service has all robots.
    #[serde(skip_serializing_if = "Option::is_none")]
    instance: Option<String>,
    /// The latest estimate, once there is one.
    pub(super) estimate: Option<EstimateDocument>,
    /// Its vehicle; absent for a robot that nobody has described yet.
    vehicle: Option<VehicleDocument>,
    /// What it sends.
    streams: Vec<StreamDocument>,
    /// Where its calibration stands.
    calibration: CalibrationSummary,
    /// Distance that the estimator of the values in verification has followed, m; absent while none are.
    verification_distance_m: Option<f64>,
}

impl RobotSummary {
    /// The summary of a robot.
    pub(super) fn of(
        view: RobotView,
        ledger: &RobotLedger,
        standing: Standing,
        owners: &Owners,
        now: WallTime,
    ) -> Self {
        Self {
            standing,
            instance: owners.of(&view.id),
            connection: ConnectionDocument::of(&view, ledger, now),
            vehicle: view
                .config
                .as_ref()
                .map(|config| vehicle_document(&config.vehicle())),
            streams: view
                .connection
                .streams
                .iter()
                .map(StreamDocument::of)
                .collect(),
            calibration: CalibrationSummary::of(ledger),
            verification_distance_m: view
                .verification
                .as_ref()
                .map(|(_, verification)| verification.distance_m),
            id: view.id,
            state: view.state,
            stale: view.connection.stale,
            alive: view.connection.alive,
            last_seen: view.connection.last_heard().map(time::of),
            estimate: view.estimate.map(Arc::unwrap_or_clone),
        }
    }
}

/// One robot. Its `ETag` is `version`, which only a change of `config` moves.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct RobotDocument {
    #[serde(flatten)]
    summary: RobotSummary,
    /// Its configuration; absent for a robot that nobody has described yet.
    config: Option<RobotConfig>,
    /// Goes up by one with every change of `config`; 0 while there is none.
    version: Version,
    /// When `config` last changed.
    #[schema(value_type = Option<String>, format = DateTime)]
    configured: Option<Timestamp>,
    /// What became of its messages:
    /// `received = processed + dropped_… + refused + ignored + waiting`.
    counters: Counters,
    /// Times that its estimator was restarted after a failure.
    estimator_restarts: u32,
    /// How well steering and speed fit together, of a robot that sends them on different topics.
    pairing: Option<PairingReport>,
    /// What looks wrong with what it sends.
    warnings: Vec<Warning>,
    /// The ROS 2 topics that it has announced, by name.
    topics: Vec<AnnouncedTopic>,
    /// The keys of `config` because of whose change its estimate begins from nothing, in the answer to `PUT`;
    /// absent where the estimate goes on.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[schema(required = false)]
    estimate_begins_again_by: Vec<&'static str>,
}

impl RobotDocument {
    /// The document of a robot and what the store knows of it.
    pub(super) fn of(
        view: RobotView,
        record: Option<&RobotRecord>,
        ledger: &RobotLedger,
        standing: Standing,
        owners: &Owners,
        now: WallTime,
    ) -> Self {
        let configured = record
            .filter(|record| record.version > Version(0))
            .map(|record| record.updated_ns);
        Self {
            config: view.config.clone(),
            version: record.map_or(Version(0), |record| record.version),
            configured: configured.map(time::of),
            counters: view.counters.clone(),
            estimator_restarts: view.estimator_restarts,
            pairing: view.pairing,
            warnings: view.warnings.clone(),
            topics: view.topics.to_vec(),
            estimate_begins_again_by: Vec::new(),
            summary: RobotSummary::of(view, ledger, standing, owners, now),
        }
    }

    /// With what a configuration did to the robot.
    pub(super) fn configured(mut self, configured: Configured) -> Self {
        if let Configured::BeginsAgain(keys) = configured {
            self.estimate_begins_again_by = keys;
        }
        self
    }
}

/// What has come in on one stream of a robot.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = StreamCounts)]
struct StreamDocument {
    /// Which stream.
    stream: Stream,
    /// Messages received.
    messages: u64,
    /// Messages per second, over the last seconds.
    rate_hz: f64,
    /// When the last one was received.
    #[schema(value_type = Option<String>, format = DateTime)]
    last_received: Option<Timestamp>,
}

impl StreamDocument {
    fn of(view: &StreamView) -> Self {
        Self {
            stream: view.stream,
            messages: view.messages,
            rate_hz: view.rate_hz,
            last_received: view.last_received_ns.map(time::of),
        }
    }
}

/// A robot's state, standing and presence on the event stream.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = RobotStateUpdate)]
pub(crate) struct RobotStateDocument {
    robot: RobotId,
    /// Where its estimate stands, in one word.
    state: RobotState,
    /// How it stands, in one word.
    standing: Standing,
    /// Whether nothing has come for some seconds.
    stale: bool,
    /// Whether its liveliness token stands.
    alive: bool,
}

impl RobotStateDocument {
    /// The document of a robot that stands like this.
    pub(crate) fn of(view: &RobotView, standing: Standing) -> Self {
        Self {
            robot: view.id.clone(),
            state: view.state,
            standing,
            stale: view.connection.stale,
            alive: view.connection.alive,
        }
    }

    /// Whose.
    pub(crate) const fn robot(&self) -> &RobotId {
        &self.robot
    }

    /// How it stands.
    pub(crate) const fn standing(&self) -> Standing {
        self.standing
    }
}
