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

/// Whether a robot is heard, apart from how its calibration stands.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Connection)]
pub(super) struct ConnectionDocument {
    state: ConnectionState,
    /// When anything was last received from it; absent of one that is online, and of one that was
    /// never heard.
    #[schema(value_type = Option<String>, format = DateTime)]
    silent_since: Option<Timestamp>,
    /// That it is switched off on purpose, as long as that holds.
    maintenance: Option<MaintenanceDocument>,
}

/// That a robot is switched off on purpose: it raises no alert for sending nothing.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Maintenance)]
struct MaintenanceDocument {
    /// When it ends by itself.
    #[schema(value_type = String, format = DateTime)]
    until: Timestamp,
    /// Who said so.
    by: String,
    /// When.
    #[schema(value_type = String, format = DateTime)]
    at: Timestamp,
    /// Why.
    reason: String,
}

/// The maintenance that a robot is in.
fn maintenance(ledger: &RobotLedger, now: WallTime) -> Option<&Maintenance> {
    let maintenance = ledger.shadow.maintenance.as_ref();
    maintenance.filter(|one| one.holds_at(now))
}

/// How a robot is heard.
pub(crate) fn connection_state(
    view: &RobotView,
    ledger: &RobotLedger,
    now: WallTime,
) -> ConnectionState {
    ConnectionState::of(view.connection.stale, maintenance(ledger, now).is_some())
}

impl ConnectionDocument {
    /// How a robot is heard at this moment.
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

/// Until when a robot is switched off on purpose.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[schema(as = MaintenanceRequest)]
#[serde(deny_unknown_fields)]
pub(super) struct MaintenanceBody {
    /// When it ends by itself, at most 90 days from now; null ends it now.
    #[serde(deserialize_with = "Option::deserialize")]
    #[schema(value_type = Option<String>, format = DateTime, required = true)]
    until: Option<Timestamp>,
    /// Why, 1 to 1000 characters.
    #[schema(min_length = 1, max_length = 1000)]
    reason: String,
}

/// Says that a robot is switched off on purpose until some time, or that it is not any more. As
/// long as it is, it raises no alert for sending nothing.
#[utoipa::path(
    put,
    path = "/robots/{id}/maintenance",
    tag = "robots",
    params(("id" = RobotId, Path, description = "The robot.")),
    request_body = MaintenanceBody,
    responses(
        (status = OK, description = "How the robot is heard now", body = ConnectionDocument),
        (status = NOT_FOUND, description = "The robot is unknown"),
        (status = CONFLICT, description = "The robot is in no maintenance that could end"),
    )
)]
pub(super) async fn put_maintenance(
    State(api): State<ApiState>,
    caller: Caller,
    RobotPath(id): RobotPath,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    Body { value, .. }: Body<MaintenanceBody>,
) -> Result<Json<ConnectionDocument>, Problem> {
    let unknown = || Problem::robot_unknown(id.as_str());
    api.fleet.robot(&id).ok_or_else(unknown)?;
    check_length("reason", &value.reason, limits::NOTE_CHARS_MAX)?;
    let until_ns = value
        .until
        .map(|until| time::wall(until).unwrap_or(WallTime::MAX));
    let command = Command::Maintain {
        until_ns,
        reason: value.reason,
    };
    api.lifecycle
        .decide(&id, command, caller.actor, None)
        .await?;
    let view = api.fleet.robot(&id).ok_or_else(unknown)?;
    let ledger = api.lifecycle.ledger(&id);
    Ok(Json(ConnectionDocument::of(
        &view,
        &ledger,
        api.clock.now(),
    )))
}
