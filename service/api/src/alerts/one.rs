//! Routes of `/alerts/{id}`: an alert's history and acknowledgement.

use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use fleetcal_domain::alert::{Alert, AlertDocument, AlertRefused, ConditionName, Named};
use fleetcal_domain::limits;
use fleetcal_model::{AlertId, Version};
use fleetcal_store::{AlertMoment, StoreError};
use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use crate::ApiState;
use crate::access::Caller;
use crate::etag::{expected_version, versioned_json};
use crate::extract::{Body, NoParameters, Parameters, check_length};
use crate::problem::Problem;
use crate::time;

/// Alert with its history.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = AlertWithHistory)]
pub(super) struct WholeAlert {
    /// Alert itself.
    alert: AlertDocument,
    /// Changes of the alert, the oldest first.
    history: Vec<MomentDocument>,
}

/// Change of an alert.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = AlertChange)]
struct MomentDocument {
    #[schema(value_type = String, format = DateTime)]
    time: Timestamp,
    /// Version of the alert afterwards.
    version: Version,
    /// Condition of the alert afterwards; of one that a newer version has stored, its name there.
    #[schema(value_type = ConditionName)]
    state: Named<ConditionName>,
    /// Description of the observation.
    what: String,
    /// Person or tool that acknowledged it; `null` for a change of its state.
    by: Option<String>,
    /// Note of the person.
    note: Option<String>,
}

impl MomentDocument {
    fn of(moment: AlertMoment) -> Self {
        Self {
            time: time::of(moment.at_ns),
            version: moment.version,
            state: moment.state,
            what: moment.what,
            by: moment.by,
            note: moment.note,
        }
    }
}

/// Returns an alert with its history.
///
/// The `ETag` is its version.
#[utoipa::path(
    get,
    path = "/alerts/{id}",
    tag = "alerts",
    params(("id" = u64, Path, description = "The alert.")),
    responses(
        (status = OK, description = "The alert with its history", body = WholeAlert,
            headers(("ETag" = String, description = "Version of the alert."))),
        (status = NOT_FOUND, description = "The alert is unknown"),
    )
)]
pub(super) async fn get_alert(
    State(api): State<ApiState>,
    Path(id): Path<String>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<Response, Problem> {
    let id = alert_number(&id)?;
    let found = api.store.alert(id).await?;
    let (alert, history) = found.ok_or(StoreError::Alert(AlertRefused::Unknown(id)))?;
    let document = WholeAlert {
        alert: AlertDocument::of_stored(&alert),
        history: history.into_iter().map(MomentDocument::of).collect(),
    };
    Ok(versioned_json(StatusCode::OK, alert.version(), document))
}

/// Acknowledgement of an alert.
#[derive(Debug, Clone, Deserialize, utoipa::ToSchema)]
#[schema(as = AcknowledgementRequest)]
#[serde(deny_unknown_fields)]
pub(crate) struct AcknowledgementBody {
    /// Note of the person, at most 1000 characters.
    #[serde(default)]
    #[schema(max_length = 1000)]
    note: Option<String>,
}

/// Acknowledges an alert, which shows everybody who looks after it since when.
///
/// The acknowledgement is independent of the problem: an acknowledged alert lasts until its problem
/// is solved, and an ended alert can still be acknowledged.
#[utoipa::path(
    post,
    path = "/alerts/{id}/ack",
    tag = "alerts",
    params(
        ("id" = u64, Path, description = "The alert."),
        ("If-Match" = String, Header, description = "The ETag of GET."),
    ),
    request_body = AcknowledgementBody,
    responses(
        (status = OK, description = "The acknowledged alert", body = AlertDocument,
            headers(("ETag" = String, description = "Version of the alert."))),
        (status = NOT_FOUND, description = "The alert is unknown"),
        (status = CONFLICT, description = "The alert is acknowledged already, or of a newer version"),
    )
)]
pub(super) async fn acknowledge_alert(
    State(api): State<ApiState>,
    caller: Caller,
    Path(id): Path<String>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    headers: HeaderMap,
    Body { value, .. }: Body<AcknowledgementBody>,
) -> Result<Response, Problem> {
    let id = alert_number(&id)?;
    let version = expected_version(&headers)?;
    let alerts = acknowledge(&api, &caller, &[(id, version)], value).await?;
    let alert = alerts.first().ok_or_else(Problem::panicked)?;
    let document = AlertDocument::of(alert);
    Ok(versioned_json(StatusCode::OK, alert.version, document))
}

/// Acknowledges the versions of alerts that the caller read, all or none.
pub(crate) async fn acknowledge(
    api: &ApiState,
    caller: &Caller,
    alerts: &[(AlertId, Version)],
    body: AcknowledgementBody,
) -> Result<Vec<Alert>, Problem> {
    let note = body.note.filter(|note| !note.trim().is_empty());
    check_length(
        "note",
        note.as_deref().unwrap_or(""),
        limits::NOTE_CHARS_MAX,
    )?;
    let acknowledged = api
        .evaluator
        .acknowledge(alerts, &caller.actor, note.as_deref());
    Ok(acknowledged.await?)
}

fn alert_number(id: &str) -> Result<AlertId, Problem> {
    id.parse()
        .map_err(|_| Problem::refused("id", id, "the number of an alert"))
}
