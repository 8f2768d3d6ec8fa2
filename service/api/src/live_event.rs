//! The events of the stream, and what each carries.

use fleetcal_domain::alert::AlertDocument;
use fleetcal_fleet::live::LiveUpdate;
use fleetcal_model::WallTime;
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::EstimateDocument;
use fleetcal_store::NewEvent;
use serde::Serialize;
use strum::{EnumDiscriminants, IntoStaticStr};

use super::robots::{EventDocument, RobotStateDocument};
use super::rows::Row;

/// An event of the stream: its name is `event` of the server-sent event, and the JSON of its
/// content is `data`.
#[derive(Debug, Serialize, utoipa::ToSchema, EnumDiscriminants)]
#[serde(tag = "event", content = "data", rename_all = "snake_case")]
#[strum_discriminants(name(EventName), vis(pub(super)), derive(IntoStaticStr))]
#[strum_discriminants(strum(serialize_all = "snake_case"))]
#[cfg_attr(test, strum_discriminants(derive(strum::EnumIter)))]
pub(super) enum LiveEvent<'a> {
    /// A robot's estimate, once a second for each robot.
    Estimate(&'a EstimateDocument),
    /// Lean rows of the robots whose shown values have changed, once a second; only with the topic
    /// `fleet`.
    Rows(&'a [Row]),
    /// A robot's state, standing or presence has changed.
    RobotState(RobotStateDocument),
    /// What happened to a robot.
    Event(EventDocument),
    /// A proposal, deployment or shadow of a robot has changed.
    Approval(ApprovalUpdate<'a>),
    /// An alert has changed. The state `normal` ends it.
    Alert(AlertDocument),
    /// The deployment freeze began or ended.
    Freeze(NoData),
    /// The approval policy changed.
    Policy(NoData),
    /// The first event of a new client.
    Ready(NoData),
    /// The client missed updates and reads again what it shows; the first event of a client that
    /// returns with `Last-Event-ID`.
    Resync(NoData),
}

/// A proposal, deployment or shadow of a robot has changed.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct ApprovalUpdate<'a> {
    /// The robot.
    robot: &'a RobotId,
}

/// The event says all by its name: an empty object.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct NoData {}

impl EventName {
    /// The name in the stream.
    pub(super) fn as_str(self) -> &'static str {
        self.into()
    }
}

impl<'a> LiveEvent<'a> {
    /// The event of an update of the fleet; `None` of a robot's state, which is told as it is by
    /// then.
    pub(super) fn of(update: &'a LiveUpdate, now: WallTime) -> Option<Self> {
        Some(match update {
            LiveUpdate::RobotState { .. } => return None,
            LiveUpdate::Estimate { document, .. } => Self::Estimate(document),
            LiveUpdate::Approval { robot } => Self::Approval(ApprovalUpdate { robot }),
            LiveUpdate::Alert { alert, .. } => Self::Alert(AlertDocument::of(alert)),
            LiveUpdate::Freeze => Self::Freeze(NoData {}),
            LiveUpdate::Policy => Self::Policy(NoData {}),
            LiveUpdate::Event {
                robot,
                event,
                author,
            } => {
                let event = NewEvent::of(robot, event, now);
                Self::Event(EventDocument::of(match author {
                    Some(author) => event.noted_by(author.clone()),
                    None => event,
                }))
            }
        })
    }

    /// The JSON of its content; `None`, which is logged, when it cannot be written.
    pub(super) fn data(&self) -> Option<String> {
        let written = match self {
            Self::Estimate(estimate) => serde_json::to_string(estimate),
            Self::Rows(rows) => serde_json::to_string(rows),
            Self::RobotState(state) => serde_json::to_string(state),
            Self::Event(event) => serde_json::to_string(event),
            Self::Approval(update) => serde_json::to_string(update),
            Self::Alert(alert) => serde_json::to_string(alert),
            Self::Freeze(none) | Self::Policy(none) | Self::Ready(none) | Self::Resync(none) => {
                serde_json::to_string(none)
            }
        };
        written
            .inspect_err(|error| tracing::error!(%error, "a live update cannot be written"))
            .ok()
    }
}

/// The robot that an update is about; `None` for one about all or several.
pub(super) fn robot_of(update: &LiveUpdate) -> Option<&RobotId> {
    match update {
        LiveUpdate::Estimate { robot, .. }
        | LiveUpdate::RobotState { robot, .. }
        | LiveUpdate::Approval { robot }
        | LiveUpdate::Event { robot, .. } => Some(robot),
        LiveUpdate::Alert { robot, .. } => robot.as_ref(),
        LiveUpdate::Freeze | LiveUpdate::Policy => None,
    }
}
