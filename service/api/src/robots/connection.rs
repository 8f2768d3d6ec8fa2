//! Connection of a robot: online, silent, or switched off on purpose.

use axum::Json;
use axum::extract::State;
use fleetcal_model::WallTime;
use fleetcal_proto::RobotId;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use crate::ApiState;
use crate::access::Caller;
use crate::extract::{Body, NoParameters, Parameters, RobotPath, check_length};
use crate::problem::Problem;
use crate::time;
use fleetcal_domain::approval::{Command, Maintenance, RobotLedger};
use fleetcal_domain::limits;
use fleetcal_domain::robot::{ConnectionState, RobotView};

/// Connection of a robot, independent of its calibration.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Connection)]
pub(super) struct ConnectionDocument {
    state: ConnectionState,
    /// Last receipt of any data; absent if the robot is online, or was never received.
    #[schema(value_type = Option<String>, format = DateTime)]
    silent_since: Option<Timestamp>,
    /// Maintenance of the robot, while it lasts.
    maintenance: Option<MaintenanceDocument>,
}

/// Maintenance: the robot is switched off on purpose, and raises no alert for its silence.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Maintenance)]
struct MaintenanceDocument {
    /// Time at which it ends.
    #[schema(value_type = String, format = DateTime)]
    until: Timestamp,
    /// Person or tool that reported it.
    by: String,
    /// Time of the report.
    #[schema(value_type = String, format = DateTime)]
    at: Timestamp,
    /// Reason for the maintenance.
    reason: String,
}

/// Maintenance of a robot, while it lasts.
fn maintenance(ledger: &RobotLedger, now: WallTime) -> Option<&Maintenance> {
    let maintenance = ledger.shadow.maintenance.as_ref();
    maintenance.filter(|one| one.holds_at(now))
}

/// Connection state of a robot.
pub(crate) fn connection_state(
    view: &RobotView,
    ledger: &RobotLedger,
    now: WallTime,
) -> ConnectionState {
    ConnectionState::of(view.connection.stale, maintenance(ledger, now).is_some())
}

impl ConnectionDocument {
    /// Connection of a robot at `now`.
    pub(super) fn of(view: &RobotView, ledger: &RobotLedger, now: WallTime) -> Self {
        let heard = view.connection.last_heard();
        let silent_since = heard.filter(|_| view.connection.stale);
        Self {
            state: connection_state(view, ledger, now),
            silent_since: silent_since.map(time::of),
            maintenance: maintenance(ledger, now).map(|one| MaintenanceDocument {
                until: time::of(one.until_ns),
                by: one.by.clone(),
                at: time::of(one.at_ns),
                reason: one.reason.clone(),
            }),
        }
    }
}

/// Begin or end of a robot's maintenance.
#[derive(Debug, Clone, Deserialize, utoipa::ToSchema)]
#[schema(as = MaintenanceRequest)]
#[serde(deny_unknown_fields)]
pub(crate) struct MaintenanceBody {
    /// Time at which it ends, at most 90 days from now; null ends it now.
    #[serde(deserialize_with = "Option::deserialize")]
    #[schema(value_type = Option<String>, format = DateTime, required = true)]
    until: Option<Timestamp>,
    /// Reason for the change, 1 to 1000 characters.
    #[schema(min_length = 1, max_length = 1000)]
    reason: String,
}

/// Begins the maintenance of a robot that is switched off on purpose, or ends it.
///
/// During maintenance the robot raises no alert for its silence.
#[utoipa::path(
    put,
    path = "/robots/{id}/maintenance",
    tag = "robots",
    params(("id" = RobotId, Path, description = "The robot.")),
    request_body = MaintenanceBody,
    responses(
        (status = OK, description = "The connection of the robot", body = ConnectionDocument),
        (status = NOT_FOUND, description = "The robot is unknown"),
        (status = CONFLICT, description = "The robot is not in maintenance"),
    )
)]
pub(super) async fn put_maintenance(
    State(api): State<ApiState>,
    caller: Caller,
    RobotPath(id): RobotPath,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    Body { value, .. }: Body<MaintenanceBody>,
) -> Result<Json<ConnectionDocument>, Problem> {
    maintain(&api, &caller, &id, value).await?;
    let view = api.fleet.robot(&id);
    let view = view.ok_or_else(|| Problem::robot_unknown(id.as_str()))?;
    let ledger = api.lifecycle.ledger(&id);
    Ok(Json(ConnectionDocument::of(
        &view,
        &ledger,
        api.clock.now(),
    )))
}

/// Begins the maintenance of a robot, or ends it.
pub(crate) async fn maintain(
    api: &ApiState,
    caller: &Caller,
    id: &RobotId,
    body: MaintenanceBody,
) -> Result<(), Problem> {
    let known = api.fleet.robot(id);
    known.ok_or_else(|| Problem::robot_unknown(id.as_str()))?;
    check_length("reason", &body.reason, limits::NOTE_CHARS_MAX)?;
    let until_ns = body
        .until
        .map(|until| time::wall(until).unwrap_or(WallTime::MAX));
    let command = Command::Maintain {
        until_ns,
        reason: body.reason,
    };
    let actor = caller.actor.clone();
    api.lifecycle.decide(id, command, actor, None).await?;
    Ok(())
}
