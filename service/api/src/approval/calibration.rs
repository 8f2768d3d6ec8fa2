//! Calibrations that robots pull over HTTP, and their answers.

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use fleetcal_domain::access::Role;
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::{Applied, Confirmed};
use fleetcal_proto::offer::{Offered, Question};
use serde::{Deserialize, Serialize};

use super::deployments::known;
use crate::ApiState;
use crate::access::Caller;
use crate::etag::client_has;
use crate::extract::{Body, NoParameters, Parameters, RobotPath};
use crate::problem::Problem;

/// The number that a robot asks with.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct CalibrationParameters {
    /// A new random number, 32 lower-case hexadecimal digits, which the signed `offer` repeats: so the
    /// robot knows that the answer is not a recording.
    #[param(value_type = Option<String>)]
    question: Option<Question>,
}

/// Gives the signed calibration that a robot should hold. The `ETag` is the document's SHA-256.
/// Asked by the robot itself, it counts as offered, and comes with an `offer`.
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

/// Takes a robot's answer: what became of a document. It is stored when this returns.
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

/// The public half of the key that calibrations are signed with.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct SigningKeyDocument {
    /// Its short name, which every signed document carries.
    key_id: String,
    /// Always `Ed25519`.
    algorithm: &'static str,
    /// Base64 of its 32 bytes: what an agent is given.
    public_key: String,
}

/// Gives the public half of the key that calibrations are signed with.
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
    }))
}
