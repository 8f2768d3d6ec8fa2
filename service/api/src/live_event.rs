//! Events of the stream, and their contents.

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

/// Event of the stream: its name is `event` of the server-sent event, and the JSON of its content
/// is `data`.
#[derive(Debug, Serialize, utoipa::ToSchema, EnumDiscriminants)]
#[serde(tag = "event", content = "data", rename_all = "snake_case")]
#[strum_discriminants(name(EventName), vis(pub(super)), derive(IntoStaticStr))]
#[strum_discriminants(strum(serialize_all = "snake_case"))]
#[cfg_attr(test, strum_discriminants(derive(strum::EnumIter)))]
pub(super) enum LiveEvent<'a> {
    /// Estimate of a robot, once a second for each robot.
    Estimate(&'a EstimateDocument),
    /// Lean rows of the robots whose displayed values have changed, once a second; with the topic
    /// `fleet` alone.
    Rows(&'a [Row]),
    /// Change of a robot's state, standing or presence.
    RobotState(RobotStateDocument),
    /// Event of a robot.
    Event(EventDocument),
    /// Change of a robot's proposal, deployment or shadow.
    Approval(ApprovalUpdate<'a>),
    /// Change of an alert. The state `normal` ends it.
    Alert(AlertDocument),
    /// Begin or end of the deployment freeze.
    Freeze(NoData),
    /// Change of the approval policy.
    Policy(NoData),
    /// Change of a roll-out.
    Rollout(NoData),
    /// First event of a new client.
    Ready(NoData),
    /// Request to reload, as the client missed updates; the first event of a client that returns
    /// with `Last-Event-ID`.
    Resync(NoData),
}

/// Change of a robot's proposal, deployment or shadow.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct ApprovalUpdate<'a> {
    /// Robot of the records.
    robot: &'a RobotId,
}

/// Content of an event whose name suffices: an empty object.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct NoData {}

impl EventName {
    /// The name in the stream.
    pub(super) fn as_str(self) -> &'static str {
        self.into()
    }
}

impl<'a> LiveEvent<'a> {
    /// Event of an update of the fleet; `None` for a robot's state, whose present value is sent
    /// instead.
    pub(super) fn of(update: &'a LiveUpdate, now: WallTime) -> Option<Self> {
        Some(match update {
            LiveUpdate::RobotState { .. } => return None,
            LiveUpdate::Estimate { document, .. } => Self::Estimate(document),
            LiveUpdate::Approval { robot } => Self::Approval(ApprovalUpdate { robot }),
            LiveUpdate::Alert { alert, .. } => Self::Alert(AlertDocument::of(alert)),
            LiveUpdate::Freeze => Self::Freeze(NoData {}),
            LiveUpdate::Policy => Self::Policy(NoData {}),
            LiveUpdate::Rollout => Self::Rollout(NoData {}),
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

    /// JSON of its content; `None`, after a log line, if it cannot be written.
    pub(super) fn data(&self) -> Option<String> {
        let written = match self {
            Self::Estimate(estimate) => serde_json::to_string(estimate),
            Self::Rows(rows) => serde_json::to_string(rows),
            Self::RobotState(state) => serde_json::to_string(state),
            Self::Event(event) => serde_json::to_string(event),
            Self::Approval(update) => serde_json::to_string(update),
            Self::Alert(alert) => serde_json::to_string(alert),
            Self::Freeze(none)
            | Self::Policy(none)
            | Self::Rollout(none)
            | Self::Ready(none)
            | Self::Resync(none) => serde_json::to_string(none),
        };
        written
            .inspect_err(|error| tracing::error!(%error, "a live update cannot be written"))
            .ok()
    }
}

/// Robot of an update; `None` for one about all or several.
pub(super) fn robot_of(update: &LiveUpdate) -> Option<&RobotId> {
    match update {
        LiveUpdate::Estimate { robot, .. }
        | LiveUpdate::RobotState { robot, .. }
        | LiveUpdate::Approval { robot }
        | LiveUpdate::Event { robot, .. } => Some(robot),
        LiveUpdate::Alert { robot, .. } => robot.as_ref(),
        LiveUpdate::Freeze | LiveUpdate::Policy | LiveUpdate::Rollout => None,
    }
}
