//! Route `POST /fleet/import`: registration of many robots, all or none.

use std::collections::BTreeMap;

use axum::Json;
use axum::extract::{Request, State};
use axum::http::{StatusCode, header};
use fleetcal_domain::access::Actor;
use fleetcal_domain::limits;
use fleetcal_domain::robot::RobotConfig;
use fleetcal_operations::robots::register_all;
use fleetcal_proto::RobotId;
use serde::{Deserialize, Serialize};

use super::entries::{self, Entry, ImportBody, WrongLine};
use crate::ApiState;
use crate::access::{Caller, count_writes};
use crate::extract::{Parameters, bytes_of, parsed};
use crate::problem::Problem;
use crate::robots::{Prefixes, check_config, prefixes};

/// Wrong lines that a refusal names; a dry run lists all.
const NAMED_IN_REFUSAL: usize = 3;

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct ImportParameters {
    /// True to check the robots and register none.
    #[serde(default)]
    dry_run: bool,
}

/// Outcome of a registration of many robots.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = RegistrationOfMany)]
pub(super) struct ImportAnswer {
    /// True if nothing was to be registered.
    dry_run: bool,
    /// Number of robots that are right, and registered unless it is a dry run.
    robots: usize,
    /// Lines that are wrong.
    wrong: Vec<WrongLine>,
}

/// Registers many robots, all or none.
///
/// The body is a list in JSON, or a table (`Content-Type: text/csv`), whose first line names its columns: `id`, `model`,
/// `wheelbase_m` and any other field of a configuration, nested ones with dots, such as
/// `nominal_extrinsics.x_m`. A dry run names every wrong line. Robots that exist are not changed,
/// but refused, so that a repeated request registers nothing twice.
#[utoipa::path(
    post,
    path = "/fleet/import",
    tag = "robots",
    params(ImportParameters),
    request_body = ImportBody,
    responses(
        (status = OK, description = "The outcome of a dry run", body = ImportAnswer),
        (status = CREATED, description = "All robots are registered", body = ImportAnswer),
        (status = CONFLICT, description = "The limit of robots is reached"),
        (status = UNSUPPORTED_MEDIA_TYPE,
            description = "The body is sent neither as `application/json` nor as `text/csv`"),
        (status = UNPROCESSABLE_ENTITY, description = "Lines are wrong; none is registered"),
    )
)]
pub(super) async fn import_robots(
    State(api): State<ApiState>,
    caller: Caller,
    Parameters(ImportParameters { dry_run }): Parameters<ImportParameters>,
    request: Request,
) -> Result<(StatusCode, Json<ImportAnswer>), Problem> {
    let entries = read(&api, request).await?;
    let (robots, wrong) = checked(&api, &entries);
    let answer = ImportAnswer {
        dry_run,
        robots: robots.len(),
        wrong,
    };
    if dry_run {
        return Ok((StatusCode::OK, Json(answer)));
    }
    if !answer.wrong.is_empty() {
        return Err(refused(&answer.wrong, entries.len()));
    }
    // The request itself counts as one.
    let further = u32::try_from(robots.len() - 1).unwrap_or(u32::MAX);
    count_writes(&api, &caller, further)?;
    // A task of its own: what is stored reaches the fleet, even if the client goes away meanwhile.
    let registered = tokio::spawn(register(api.clone(), robots, caller.actor));
    registered.await.map_err(|_| Problem::panicked())??;
    Ok((StatusCode::CREATED, Json(answer)))
}

async fn read(api: &ApiState, request: Request) -> Result<Vec<Entry>, Problem> {
    let media = request.headers().get(header::CONTENT_TYPE);
    let media = media.and_then(|value| value.to_str().ok()).unwrap_or("");
    let media = media
        .split(';')
        .next()
        .unwrap_or("")
        .trim()
        .to_ascii_lowercase();
    let read = match media.as_str() {
        "application/json" => entries::of_json,
        "text/csv" => entries::of_csv,
        _ => {
            let detail = "the body must be sent as Content-Type: application/json or text/csv";
            let status = StatusCode::UNSUPPORTED_MEDIA_TYPE;
            return Err(Problem::new(status, "not_json", detail).of_field("Content-Type"));
        }
    };
    let bytes = bytes_of(request, api, limits::BULK_BODY_BYTES_MAX).await?;
    read(&bytes)
}

/// Robots to register, and the lines that are wrong.
fn checked(api: &ApiState, entries: &[Entry]) -> (BTreeMap<RobotId, RobotConfig>, Vec<WrongLine>) {
    let mut robots = BTreeMap::new();
    let owners = prefixes(api);
    let mut lines = BTreeMap::new();
    let mut wrong = Vec::new();
    for entry in entries {
        let found = robot_of(api, &owners, entry).and_then(|(id, config)| {
            if robots.contains_key(&id) {
                let accepted = "each robot once; an earlier line has it";
                return Err(Problem::refused("id", &entry.id, accepted));
            }
            if let Some(prefix) = &config.streams.fields().prefix
                && let Some(earlier) = lines.insert(prefix.clone(), entry.line)
            {
                let accepted = format!("one that no other robot has; line {earlier} has it");
                return Err(Problem::refused(
                    "streams.prefix",
                    prefix.as_str(),
                    &accepted,
                ));
            }
            Ok((id, config))
        });
        match found {
            Ok((id, config)) => {
                robots.insert(id, config);
            }
            Err(problem) => wrong.push(entry.wrong(&problem)),
        }
    }
    (robots, wrong)
}

/// Robot of an entry, if it may be registered.
fn robot_of(
    api: &ApiState,
    owners: &Prefixes,
    entry: &Entry,
) -> Result<(RobotId, RobotConfig), Problem> {
    let id = RobotId::parse(&entry.id)
        .map_err(|error| Problem::refused("id", &entry.id, &error.to_string()))?;
    if api
        .fleet
        .robot(&id)
        .is_some_and(|view| view.config.is_some())
    {
        let accepted = "a robot that is not registered yet";
        return Err(Problem::refused("id", &entry.id, accepted));
    }
    let config: RobotConfig = parsed(entry.config.to_string().as_bytes())?;
    check_config(api, owners, &id, &config)?;
    Ok((id, config))
}

fn refused(wrong: &[WrongLine], lines: usize) -> Problem {
    let named = wrong.iter().take(NAMED_IN_REFUSAL);
    let named = named.map(|one| format!("line {}: {}", one.line, one.detail));
    let named: Vec<_> = named.collect();
    let (count, named) = (wrong.len(), named.join("; "));
    let detail = format!(
        "{count} of {lines} robots are wrong, and none was registered: {named}; dry_run=true lists \
         all"
    );
    Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "lines_refused", detail)
}

/// Stores the configurations in one transaction, and passes all of them to the fleet.
async fn register(
    api: ApiState,
    robots: BTreeMap<RobotId, RobotConfig>,
    actor: Actor,
) -> Result<(), Problem> {
    register_all(&api.store, &robots, &actor).await?;
    let configured = robots.into_iter();
    let configured = configured.map(|(id, config)| api.fleet.configure(&id, config));
    // Each of them, before the first refusal is the answer.
    let configured: Vec<_> = configured.collect();
    configured.into_iter().try_for_each(|one| one.map(drop))?;
    Ok(())
}
