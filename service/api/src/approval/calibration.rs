//! Routes of calibrations that robots fetch over HTTP, and of their answers.

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use fleetcal_domain::access::Role;
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::{Applied, Confirmed, Envelope};
use fleetcal_proto::offer::{Offered, Question};
use serde::{Deserialize, Serialize};

use super::deployments::known;
use crate::ApiState;
use crate::access::Caller;
use crate::etag::client_has;
use crate::extract::{Body, NoParameters, Parameters, RobotPath};
use crate::problem::Problem;

/// Parameters of a robot's request.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct CalibrationParameters {
    /// New random number, 32 lower-case hexadecimal digits, which the signed `offer` repeats: it
    /// proves to the robot that the answer is not replayed.
    #[param(value_type = Option<String>)]
    question: Option<Question>,
}

/// Returns the signed calibration that a robot should use.
///
/// The `ETag` is the document's SHA-256. A request of the robot itself counts as an offer, and its
/// answer includes an `offer`.
#[utoipa::path(
    get,
    path = "/robots/{id}/calibration",
    tag = "approval",
    params(
        ("id" = RobotId, Path, description = "The robot."),
        CalibrationParameters,
        ("If-None-Match" = Option<String>, Header,
            description = "The ETag of an earlier response."),
    ),
    responses(
        (status = OK, description = "The signed calibration", body = Offered,
            headers(("ETag" = String, description = "SHA-256 of the document."))),
        (status = NOT_MODIFIED, description = "The client has the current calibration"),
        (status = NOT_FOUND, description = "The robot is unknown, or no calibration is approved"),
    )
)]
pub(super) async fn get_calibration(
    State(api): State<ApiState>,
    caller: Caller,
    RobotPath(id): RobotPath,
    Parameters(CalibrationParameters { question }): Parameters<CalibrationParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    known(&api, &id)?;
    let offered = if caller.actor.role == Some(Role::Robot) {
        api.lifecycle.approved(&id, question).await?
    } else {
        api.lifecycle.desired(&id).await?.map(Offered::from)
    };
    let offered = offered.ok_or_else(|| {
        let detail = format!("no calibration of {id} is approved");
        Problem::new(StatusCode::NOT_FOUND, "nothing_approved", detail)
    })?;
    let tag = HeaderValue::from_str(&format!("\"{}\"", offered.envelope.sha256));
    let tag = tag.unwrap_or(HeaderValue::from_static("\"\""));
    if client_has(&headers, &tag) {
        return Ok((StatusCode::NOT_MODIFIED, [(header::ETAG, tag)]).into_response());
    }
    Ok(([(header::ETAG, tag)], Json(offered)).into_response())
}

/// Stores a robot's answer about a document: applied, refused, failed or reverted.
///
/// The answer is stored when this returns.
#[utoipa::path(
    put,
    path = "/robots/{id}/calibration/applied",
    tag = "approval",
    params(("id" = RobotId, Path, description = "The robot.")),
    request_body = Applied,
    responses(
        (status = OK, description = "The answer is stored and confirmed", body = Confirmed),
        (status = ACCEPTED,
            description = "The answer is stored, but the robot should not keep the applied values"),
        (status = NOT_FOUND, description = "The robot is unknown"),
        (status = CONFLICT, description = "The deployment is not in a state that this answer fits"),
    )
)]
pub(super) async fn put_applied(
    State(api): State<ApiState>,
    caller: Caller,
    RobotPath(id): RobotPath,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    Body { value: applied, .. }: Body<Applied>,
) -> Result<Response, Problem> {
    known(&api, &id)?;
    let generation = applied.generation;
    api.lifecycle
        .acknowledge(&id, applied, caller.actor)
        .await?;
    let confirmed = api.lifecycle.confirmed(&id);
    Ok(match confirmed.filter(|one| one.generation == generation) {
        Some(confirmed) => Json(confirmed).into_response(),
        None => StatusCode::ACCEPTED.into_response(),
    })
}

/// Public half of the key that signs calibrations.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct SigningKeyDocument {
    /// Short name of the key, which every signed document carries.
    key_id: String,
    /// Algorithm, always `Ed25519`.
    algorithm: &'static str,
    /// Base64 of the key's 32 bytes, for the agent's configuration.
    public_key: String,
    /// Changes that led to this key, oldest first: texts of schema `fleetcal.key_change/1`.
    changes: Vec<Envelope>,
}

/// Returns the public half of the key that signs calibrations.
#[utoipa::path(get, path = "/signing-key", tag = "approval",
    responses(
        (status = OK, description = "The public key", body = SigningKeyDocument),
    ))]
pub(super) async fn get_signing_key(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<Json<SigningKeyDocument>, Problem> {
    let key = api.lifecycle.public_key();
    Ok(Json(SigningKeyDocument {
        key_id: key.id(),
        algorithm: "Ed25519",
        public_key: key.to_string(),
        changes: api.lifecycle.key_changes().envelopes(),
    }))
}
