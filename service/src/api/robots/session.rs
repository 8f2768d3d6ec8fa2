//! `GET /robots/{id}/session`: a robot's session as it drives, as MCAP for Foxglove.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use fleetcal_proto::RobotId;
use futures::StreamExt;
use serde::Deserialize;
use tokio::sync::{Semaphore, mpsc};
use tokio_stream::wrappers::ReceiverStream;
use tokio_util::sync::CancellationToken;

use crate::api::ApiState;
use crate::api::access::{Caller, permission_ended};
use crate::api::extract::{Parameters, RobotPath, number_within};
use crate::api::problem::Problem;
use crate::limits;
use crate::session_export::live;

/// What recordings of sessions share.
#[derive(Debug, Clone)]
pub(in crate::api) struct Sessions {
    places: Arc<Semaphore>,
    /// Ends them all.
    stop: CancellationToken,
}

impl Sessions {
    /// Of a service that runs until `stop`.
    pub(in crate::api) fn new(stop: CancellationToken) -> Self {
        let places = Arc::new(Semaphore::new(limits::SESSIONS_MAX));
        Self { places, stop }
    }
}

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct SessionParameters {
    /// How long it is recorded, s, 1 to 3600; 60 unless given.
    #[param(value_type = Option<u32>)]
    duration_s: Option<String>,
}

/// An MCAP file.
#[derive(utoipa::ToSchema)]
#[schema(value_type = String, format = Binary)]
#[expect(dead_code, reason = "it is described, and written piece by piece")]
pub(super) struct SessionFile(Vec<u8>);

/// Records a robot's session from now on and gives it as it is written: an MCAP file that Foxglove
/// opens, with the robot's own messages, `/tf`, `/{robot}/estimate` and `/{robot}/events`, all logged
/// by the robot's clock. It is whole after `duration_s`, at the service's end, or when it has 1 GiB.
/// Nothing of it is kept. What came faster than it was fetched is missing; the metadata
/// `fleetcal.session` say how much.
#[utoipa::path(
    get,
    path = "/robots/{id}/session",
    tag = "robots",
    params(("id" = RobotId, Path, description = "The robot."), SessionParameters),
    responses(
        (status = OK, description = "The recording", body = inline(SessionFile),
            content_type = "application/octet-stream"),
        (status = "4XX", description = "Refused, unknown, or not registered", body = Problem,
            content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, description = "Too many are recorded", body = Problem,
            content_type = "application/problem+json"),
    )
)]
pub(super) async fn get_session(
    State(api): State<ApiState>,
    RobotPath(id): RobotPath,
    Parameters(query): Parameters<SessionParameters>,
    caller: Caller,
) -> Result<Response, Problem> {
    let seconds = number_within(
        "duration_s",
        query.duration_s.as_deref(),
        1..=limits::SESSION_DURATION_MAX_S,
        limits::SESSION_DURATION_DEFAULT_S,
    )?;
    let places = Arc::clone(&api.sessions.places);
    let place = places.try_acquire_owned().map_err(|_| {
        let detail = format!(
            "{} sessions are recorded already, which is the limit",
            limits::SESSIONS_MAX
        );
        Problem::new(StatusCode::SERVICE_UNAVAILABLE, "sessions_full", detail)
    })?;
    let tap = api.fleet.tap(&id)?;
    let (pieces, receiver) = mpsc::channel(limits::SESSION_PIECES_WAITING_MAX);
    let file = HeaderValue::try_from(format!("attachment; filename=\"{id}.mcap\""));
    let stop = api.sessions.stop.clone();
    tokio::spawn(async move {
        let end = async {
            tokio::select! {
                () = tokio::time::sleep(Duration::from_secs(seconds.into())) => {}
                () = stop.cancelled() => {}
                () = permission_ended(api, caller) => {}
            }
        };
        if let Err(error) = live::record(id.clone(), tap, pieces, end).await {
            tracing::error!(robot.id = %id, %error, "the session cannot be recorded on");
        }
        drop(place);
    });
    let body = ReceiverStream::new(receiver).map(Ok::<Vec<u8>, Infallible>);
    let mut response = Body::from_stream(body).into_response();
    let headers = response.headers_mut();
    let bytes = HeaderValue::from_static("application/octet-stream");
    headers.insert(header::CONTENT_TYPE, bytes);
    if let Ok(file) = file {
        headers.insert(header::CONTENT_DISPOSITION, file);
    }
    // It is packed already.
    let identity = HeaderValue::from_static("identity");
    headers.insert(header::CONTENT_ENCODING, identity);
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    Ok(response)
}
