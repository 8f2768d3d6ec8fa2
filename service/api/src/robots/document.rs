//! Documents of a robot.

use fleetcal_domain::deviation::Deviation;
use fleetcal_domain::robot::{
    AnnouncedTopic, Counters, PairingReport, RobotConfig, RobotState, RobotView, StreamView,
    Warning,
};
use fleetcal_domain::standing::Standing;
use fleetcal_fleet::Configured;
use fleetcal_fleet::document::vehicle_document;
use fleetcal_model::{Label, Stream, Tags, Version, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::{EstimateDocument, VehicleDocument};
use fleetcal_store::RobotRecord;
use jiff::Timestamp;
use serde::Serialize;

use super::connection::ConnectionDocument;
use super::retirement::RetirementDocument;
use super::view::Listed;
use crate::approval::CalibrationSummary;
use crate::cluster::Owners;
use crate::time;

/// Robot in the list.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct RobotSummary {
    /// Id of the robot.
    pub(super) id: RobotId,
    /// State of its estimate, in one word.
    pub(super) state: RobotState,
    /// Standing by its estimate, its calibration's life cycle and its alerts: the most urgent that
    /// applies.
    pub(super) standing: Standing,
    /// True if nothing was received for some seconds.
    pub(super) stale: bool,
    /// True if its liveliness token is present.
    pub(super) alive: bool,
    /// Last receipt of any data.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub(super) last_seen: Option<Timestamp>,
    /// Connection: online, silent, or switched off on purpose.
    connection: ConnectionDocument,
    /// Retirement; absent unless the robot is retired, and then in no list.
    #[serde(skip_serializing_if = "Option::is_none")]
    retired: Option<RetirementDocument>,
    /// Instance that estimates it; absent while there is none, and for a single service.
    #[serde(skip_serializing_if = "Option::is_none")]
    instance: Option<String>,
    /// Latest estimate, once there is one.
    pub(super) estimate: Option<EstimateDocument>,
    /// Vehicle of the robot; absent before its configuration.
    vehicle: Option<VehicleDocument>,
    /// Site of the robot.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    site: Option<Label>,
    /// Type of the vehicle by its maker.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    vehicle_type: Option<Label>,
    /// Further groups of the robot.
    #[schema(value_type = Vec<String>)]
    tags: Tags,
    /// Deviation of the estimate from the calibration in use; absent while no converged value can
    /// be compared.
    deviation: Option<Deviation>,
    /// Streams that it sends.
    streams: Vec<StreamDocument>,
    /// State of its calibration.
    calibration: CalibrationSummary,
    /// Distance that the estimator of the values in verification has followed, m; absent without a
    /// verification.
    verification_distance_m: Option<f64>,
}

impl RobotSummary {
    /// Summary of a robot.
    pub(super) fn of(robot: &Listed, owners: &Owners, now: WallTime) -> Self {
        let Listed { view, ledger, .. } = robot;
        let config = view.config.as_ref();
        Self {
            standing: robot.standing,
            instance: owners.of(&view.id),
            retired: ledger.shadow.retired.as_ref().map(RetirementDocument::of),
            connection: ConnectionDocument::of(view, ledger, now),
            vehicle: config.map(|config| vehicle_document(&config.vehicle())),
            site: config.and_then(|config| config.site.clone()),
            vehicle_type: config.and_then(|config| config.vehicle_type.clone()),
            tags: config.map(|config| config.tags.clone()).unwrap_or_default(),
            deviation: robot.deviation,
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
            id: view.id.clone(),
            state: view.state,
            stale: view.connection.stale,
            alive: view.connection.alive,
            last_seen: view.connection.last_heard().map(time::of),
            estimate: view.estimate.as_deref().cloned(),
        }
    }
}

/// Robot with its configuration. Its `ETag` is `version`, which only a change of `config` moves.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct RobotDocument {
    #[serde(flatten)]
    summary: RobotSummary,
    /// Configuration of the robot; absent before the first one.
    config: Option<RobotConfig>,
    /// Version, incremented with every change of `config`; 0 before the first one.
    version: Version,
    /// Time of the last change of `config`.
    #[schema(value_type = Option<String>, format = DateTime)]
    configured: Option<Timestamp>,
    /// Counts of its messages by their outcome: `received = processed + dropped_… + refused +
    /// ignored + waiting`.
    counters: Counters,
    /// Restarts of its estimator after a failure.
    estimator_restarts: u32,
    /// Pairing of steering and speed, for a robot that sends them on different topics.
    pairing: Option<PairingReport>,
    /// Warnings about its data.
    warnings: Vec<Warning>,
    /// Announced ROS 2 topics, by name.
    topics: Vec<AnnouncedTopic>,
    /// Keys of `config` whose change restarts its estimate, in the answer to `PUT`; absent if the
    /// estimate continues.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[schema(required = false)]
    estimate_begins_again_by: Vec<&'static str>,
}

impl RobotDocument {
    /// Document of a robot and its stored record.
    pub(super) fn of(
        robot: &Listed,
        record: Option<&RobotRecord>,
        owners: &Owners,
        now: WallTime,
    ) -> Self {
        let view = &robot.view;
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
            summary: RobotSummary::of(robot, owners, now),
        }
    }

    /// Adds the effect of a configuration on the robot.
    pub(super) fn configured(mut self, configured: Configured) -> Self {
        if let Configured::BeginsAgain(keys) = configured {
            self.estimate_begins_again_by = keys;
        }
        self
    }
}

/// Traffic of one stream of a robot.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = StreamCounts)]
struct StreamDocument {
    /// Stream that was received.
    stream: Stream,
    /// Messages received.
    messages: u64,
    /// Messages per second, over the last seconds.
    rate_hz: f64,
    /// Receipt of the last message.
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

/// State, standing and presence of a robot on the event stream.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = RobotStateUpdate)]
pub(crate) struct RobotStateDocument {
    robot: RobotId,
    /// State of its estimate, in one word.
    state: RobotState,
    /// Standing of the robot, in one word.
    standing: Standing,
    /// Deviation of the estimate from the calibration in use; absent while no converged value can
    /// be compared.
    deviation: Option<Deviation>,
    /// True if nothing was received for some seconds.
    stale: bool,
    /// True if its liveliness token is present.
    alive: bool,
}

impl RobotStateDocument {
    /// Document of a robot with this standing and deviation.
    pub(crate) fn of(view: &RobotView, standing: Standing, deviation: Option<Deviation>) -> Self {
        Self {
            robot: view.id.clone(),
            state: view.state,
            standing,
            deviation,
            stale: view.connection.stale,
            alive: view.connection.alive,
        }
    }

    /// Robot of the document.
    pub(crate) const fn robot(&self) -> &RobotId {
        &self.robot
    }

    /// Standing of the robot.
    pub(crate) const fn standing(&self) -> Standing {
        self.standing
    }

    /// Deviation of the robot.
    pub(crate) const fn deviation(&self) -> Option<Deviation> {
        self.deviation
    }
}
