//! Routes of `/robots/{id}/moments`: the latest data of a robot, kept on disk.

use std::io;

use axum::Json;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use fleetcal_domain::limits;
use fleetcal_http::{csv, written};
use fleetcal_moments::{Moment, MomentRefused};
use fleetcal_proto::RobotId;
use serde::{Deserialize, Serialize};

use super::recording::RecordingFile;
use crate::ApiState;
use crate::access::Caller;
use crate::export::Export;
use crate::extract::{NoParameters, Parameters, check_length};
use crate::forwarding::OwnRobot;
use crate::problem::Problem;

/// Moments of a robot.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Moments)]
pub(super) struct MomentsDocument {
    /// The moments, the newest first; at most 20.
    moments: Vec<Moment>,
    /// Moments of all robots that were dropped for newer ones since the service started.
    dropped: u64,
    /// Moments of all robots that could not be written since the service started.
    lost: u64,
    /// Memory that the latest data of all robots take now, bytes.
    memory_bytes: usize,
}

/// Returns the moments of a robot: the data before each change, fault, failed verification and
/// reassembly, and before each request.
///
/// A moment has up to the last minute, less where many robots share the memory for their latest
/// data, 128 MiB or a quarter of what the process may use: each has an equal share, at most 8 MiB.
/// In a cluster they are those of the instance that estimates the robot now.
#[utoipa::path(
    get,
    path = "/robots/{id}/moments",
    tag = "robots",
    params(("id" = RobotId, Path, description = "The robot.")),
    responses(
        (status = OK, description = "The moments", body = MomentsDocument),
        (status = NOT_FOUND, description = "The robot is unknown"),
    )
)]
pub(super) async fn list_moments(
    State(api): State<ApiState>,
    OwnRobot(id): OwnRobot,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<Json<MomentsDocument>, Problem> {
    let unknown = || Problem::robot_unknown(id.as_str());
    api.fleet.robot(&id).ok_or_else(unknown)?;
    let counts = api.moments.counts();
    let moments = api.moments.of(&id);
    Ok(Json(MomentsDocument {
        moments,
        dropped: counts.dropped,
        lost: counts.lost,
        memory_bytes: api.fleet.latest_data_bytes(),
    }))
}

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct MomentParameters {
    /// Reason for the moment, at most 1000 characters.
    note: Option<String>,
}

/// Keeps the robot's latest data: up to the last minute, less where many robots share the memory for
/// them. They are on disk when the request is answered.
#[utoipa::path(
    post,
    path = "/robots/{id}/moments",
    tag = "robots",
    params(("id" = RobotId, Path, description = "The robot."), MomentParameters),
    responses(
        (status = CREATED, description = "The moment", body = Moment),
        (status = NOT_FOUND, description = "The robot is unknown"),
        (status = CONFLICT, description = "The robot has sent nothing within the last minute"),
        (status = SERVICE_UNAVAILABLE,
            description = "Too many moments wait for the disk, it failed, or no instance has the robot"),
    )
)]
pub(super) async fn keep_moment(
    State(api): State<ApiState>,
    OwnRobot(id): OwnRobot,
    Parameters(query): Parameters<MomentParameters>,
) -> Result<Response, Problem> {
    let note = query.note.unwrap_or_default();
    check_length("note", &note, limits::NOTE_CHARS_MAX)?;
    let kept = api.moments.keep(&id, note).await;
    let moment = kept.map_err(refused)?;
    Ok((StatusCode::CREATED, Json(moment)).into_response())
}

fn refused(refused: MomentRefused) -> Problem {
    let detail = refused.to_string();
    match refused {
        MomentRefused::Robot(refused) => refused.into(),
        MomentRefused::NoData(_) => Problem::new(StatusCode::CONFLICT, "robot_silent", detail),
        MomentRefused::Full => {
            Problem::new(StatusCode::SERVICE_UNAVAILABLE, "moments_full", detail)
        }
        MomentRefused::Disk(_) => {
            Problem::new(StatusCode::SERVICE_UNAVAILABLE, "disk_failed", detail)
        }
    }
}

/// Returns the data of a moment: an MCAP file of ROS 2 messages, as `GET /robots/{id}/recording`
/// writes.
#[utoipa::path(
    get,
    path = "/robots/{id}/moments/{moment}",
    tag = "robots",
    params(
        ("id" = RobotId, Path, description = "The robot."),
        ("moment" = i64, Path, description = "Number of the moment."),
    ),
    responses(
        (status = OK, description = "The data", body = inline(RecordingFile),
            content_type = "application/octet-stream"),
        (status = NOT_FOUND, description = "The robot has no such moment"),
        (status = TOO_MANY_REQUESTS,
            description = "Too many files are written for the user or token"),
        (status = SERVICE_UNAVAILABLE,
            description = "Too many files are written, or no instance has the robot"),
    )
)]
pub(super) async fn get_moment(
    State(api): State<ApiState>,
    OwnRobot(id): OwnRobot,
    path: Path<(String, String)>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    caller: Caller,
) -> Result<Response, Problem> {
    let Path((_, number)) = path;
    let unknown = || {
        let detail = format!("robot {id} has no moment {number}");
        Problem::new(StatusCode::NOT_FOUND, "moment_unknown", detail)
    };
    let number_of = number.parse().map_err(|_| unknown())?;
    let (_, path) = api.moments.find(&id, number_of).ok_or_else(unknown)?;
    let export = Export::begin(&api, caller)?;
    // It may have been dropped meanwhile.
    let file = tokio::fs::File::open(&path).await.map_err(|_| unknown())?;
    let mut file = file.into_std().await;
    let pieces = written(move |to| io::copy(&mut file, to).map(|_| ()));
    let name = format!("{id}-{number_of}.mcap");
    let body = export.body(pieces);
    Ok(csv::file("application/octet-stream", &name, body))
}
