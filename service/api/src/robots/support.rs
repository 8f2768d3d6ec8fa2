//! Route `GET /robots/{id}/support`: what somebody needs who looks into a robot's trouble elsewhere.

use axum::Json;
use axum::body::to_bytes;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Response};
use fleetcal_domain::limits;
use fleetcal_http::{csv, written};
use fleetcal_moments::Moment;
use fleetcal_proto::RobotId;
use fleetcal_support::{Archive, lines_of};
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::{checks, cross_track, estimate, events, innovations, moments, registration};
use crate::ApiState;
use crate::access::Caller;
use crate::export::Export;
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
    bytes: u64,
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
        (status = TOO_MANY_REQUESTS,
            description = "Too many files are written for the user or token"),
        (status = SERVICE_UNAVAILABLE,
            description = "Too many files are written, or no instance has the robot"),
    )
)]
pub(super) async fn get_support(
    State(api): State<ApiState>,
    OwnRobot(id): OwnRobot,
    Parameters(query): Parameters<SupportParameters>,
    caller: Caller,
) -> Result<Response, Problem> {
    let is_list = match query.list.as_deref() {
        None | Some("false") => false,
        Some("true") => true,
        Some(other) => return Err(Problem::refused("list", other, "true or false")),
    };
    let unknown = || Problem::robot_unknown(id.as_str());
    api.fleet.robot(&id).ok_or_else(unknown)?;
    let moments = api.moments.of(&id);
    if is_list {
        let documents = documents(&api, &id).await;
        let list = list_of(&documents, &moments);
        return Ok(Json(list).into_response());
    }
    let export = Export::begin(&api, caller)?;
    let mut archive = documents(&api, &id).await;
    for moment in &moments {
        let Some((_, path)) = api.moments.find(&id, moment.id) else {
            continue;
        };
        // It may have been dropped meanwhile; once it is open it can be read to its end.
        if let Ok(file) = tokio::fs::File::open(path).await {
            archive.add_on_disk(&name_of(moment), file.into_std().await, moment.bytes);
        }
    }
    let name = format!("{id}-support.zip");
    let body = export.body(written(move |to| archive.write(to)));
    Ok(csv::file("application/zip", &name, body))
}

/// Returns the list of a bundle's files, without opening those of moments.
fn list_of(documents: &Archive, moments: &[Moment]) -> SupportDocument {
    let documents = documents.list().map(|(name, bytes)| FileDocument {
        name: name.to_owned(),
        bytes,
    });
    let moments = moments.iter().map(|moment| FileDocument {
        name: name_of(moment),
        bytes: moment.bytes,
    });
    let files = documents.chain(moments).collect();
    SupportDocument { files }
}

/// Returns the name of a moment's data in a bundle.
fn name_of(moment: &Moment) -> String {
    format!("moments/{}.mcap", moment.id)
}

/// Answers of the API about the robot, by name. For a document that the robot lacks it is a problem.
async fn answers(api: &ApiState, id: &RobotId) -> [(&'static str, Response); 8] {
    let state = || State(api.clone());
    let path = || RobotPath(id.clone());
    let own = || OwnRobot(id.clone());
    let nothing = || Parameters(NoParameters {});
    let latest = events::EventParameters::default();
    [
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
            "innovations",
            innovations::get_innovations(state(), own(), nothing())
                .await
                .into_response(),
        ),
        (
            "moments",
            moments::list_moments(state(), own(), nothing())
                .await
                .into_response(),
        ),
        ("shadow", crate::approval::shadow_of(api, id)),
    ]
}

/// Gathers the bundle but for the moments.
async fn documents(api: &ApiState, id: &RobotId) -> Archive {
    let mut archive = Archive::default();
    let about = json!({
        "robot": id,
        "made_at": time::of(api.clock.now()).to_string(),
        "version": api.build.version,
        "commit": api.build.commit,
        "instance_started_at": time::of(api.started_ns).to_string(),
    });
    archive.add("about.json", format!("{about:#}\n").into_bytes());
    for (name, document) in answers(api, id).await {
        let body = to_bytes(document.into_body(), limits::SUPPORT_DOCUMENT_BYTES_MAX).await;
        archive.add(&format!("{name}.json"), body.unwrap_or_default().into());
    }
    let log = lines_of(id).join("\n") + "\n";
    archive.add("log.txt", log.into_bytes());
    archive
}
