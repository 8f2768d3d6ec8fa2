//! Route `GET /robots/{id}/support`: what somebody needs who looks into a robot's trouble elsewhere.

use axum::Json;
use axum::body::{Body, to_bytes};
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Response};
use fleetcal_domain::limits;
use fleetcal_http::csv;
use fleetcal_proto::RobotId;
use fleetcal_support::{Archive, lines_of};
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::{checks, cross_track, estimate, events, moments, registration};
use crate::ApiState;
use crate::extract::{NoParameters, Parameters, RobotPath};
use crate::forwarding::OwnRobot;
use crate::problem::Problem;
use crate::time;

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct SupportParameters {
    /// `true` for the list of the files instead of the archive.
    list: Option<String>,
}

/// File of a support bundle.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = SupportFile)]
pub(super) struct FileDocument {
    /// Name, with folders.
    name: String,
    /// Size, bytes.
    bytes: usize,
}

/// Files of a support bundle.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = SupportList)]
pub(super) struct SupportDocument {
    /// The files.
    files: Vec<FileDocument>,
}

/// Archive in the ZIP format.
#[derive(utoipa::ToSchema)]
#[schema(value_type = String, format = Binary)]
#[expect(dead_code, reason = "a schema; the archive is written as it is")]
pub(super) struct ZipFile(Vec<u8>);

/// Returns a support bundle of a robot: its configuration, estimate, checks, calibration, latest
/// events, log lines and moments, as one archive; or the list of its files.
///
/// It consists of documents that this API answers with and of log lines, none of which has a secret.
#[utoipa::path(
    get,
    path = "/robots/{id}/support",
    tag = "robots",
    params(("id" = RobotId, Path, description = "The robot."), SupportParameters),
    responses(
        (status = OK, description = "The bundle, or with `list=true` what it has",
            content((ZipFile = "application/zip"), (SupportDocument = "application/json"))),
        (status = NOT_FOUND, description = "The robot is unknown"),
    )
)]
pub(super) async fn get_support(
    State(api): State<ApiState>,
    OwnRobot(id): OwnRobot,
    Parameters(query): Parameters<SupportParameters>,
) -> Result<Response, Problem> {
    let is_list = match query.list.as_deref() {
        None | Some("false") => false,
        Some("true") => true,
        Some(other) => return Err(Problem::refused("list", other, "true or false")),
    };
    let unknown = || Problem::robot_unknown(id.as_str());
    api.fleet.robot(&id).ok_or_else(unknown)?;
    let archive = bundle(&api, &id).await;
    if is_list {
        let file = |(name, bytes): (&str, usize)| FileDocument {
            name: name.to_owned(),
            bytes,
        };
        let files = archive.list().map(file).collect();
        return Ok(Json(SupportDocument { files }).into_response());
    }
    let name = format!("{id}-support.zip");
    Ok(csv::file(
        "application/zip",
        &name,
        Body::from(archive.into_zip()),
    ))
}

/// Gathers the bundle. A document that the robot lacks is the problem that the API answers with.
async fn bundle(api: &ApiState, id: &RobotId) -> Archive {
    let state = || State(api.clone());
    let path = || RobotPath(id.clone());
    let own = || OwnRobot(id.clone());
    let nothing = || Parameters(NoParameters {});
    let latest = events::EventParameters::default();
    let documents = [
        (
            "robot",
            registration::get_robot(state(), path(), nothing())
                .await
                .into_response(),
        ),
        (
            "estimate",
            estimate::get_estimate(state(), path(), nothing(), HeaderMap::new())
                .await
                .into_response(),
        ),
        (
            "checks",
            checks::get_checks(state(), own(), nothing())
                .await
                .into_response(),
        ),
        (
            "cross_track_error",
            cross_track::get_cross_track_error(state(), path(), nothing())
                .await
                .into_response(),
        ),
        (
            "events",
            events::list_events(state(), path(), Parameters(latest))
                .await
                .into_response(),
        ),
        (
            "moments",
            moments::list_moments(state(), own(), nothing())
                .await
                .into_response(),
        ),
        (
            "shadow",
            crate::approval::shadow_of(api, id).into_response(),
        ),
    ];
    let mut archive = Archive::default();
    let about = json!({
        "robot": id,
        "made_at": time::of(api.clock.now()).to_string(),
        "version": api.build.version,
        "commit": api.build.commit,
        "instance_started_at": time::of(api.started_ns).to_string(),
    });
    archive.add("about.json", format!("{about:#}\n").into_bytes());
    for (name, document) in documents {
        let body = to_bytes(document.into_body(), limits::SUPPORT_DOCUMENT_BYTES_MAX).await;
        archive.add(&format!("{name}.json"), body.unwrap_or_default().into());
    }
    let log = lines_of(id).join("\n") + "\n";
    archive.add("log.txt", log.into_bytes());
    for moment in api.moments.of(id) {
        let Some((_, path)) = api.moments.find(id, moment.id) else {
            continue;
        };
        // It may have been dropped meanwhile.
        if let Ok(data) = tokio::fs::read(path).await {
            archive.add(&format!("moments/{}.mcap", moment.id), data);
        }
    }
    archive
}
