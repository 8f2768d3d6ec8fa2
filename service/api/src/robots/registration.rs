//! Routes `GET` and `PUT /robots/{id}`: a robot and its configuration.

use std::collections::BTreeMap;

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use fleetcal_domain::access::Actor;
use fleetcal_domain::limits;
use fleetcal_domain::robot::RobotConfig;
use fleetcal_domain::streams::TopicName;
use fleetcal_fleet::{Configured, FleetRefused};
use fleetcal_model::Version;
use fleetcal_operations::robots::configure;
use fleetcal_proto::RobotId;
use fleetcal_store::{Expected, StoreError};
use serde::Deserialize;

use super::document::RobotDocument;
use super::view::Listed;
use crate::ApiState;
use crate::access::Caller;
use crate::cluster::Owners;
use crate::etag::{expected, versioned_json};
use crate::extract::{Body, NoParameters, Parameters, RobotPath};
use crate::problem::Problem;

/// Returns one robot: its state, its streams, and its configuration.
///
/// The `ETag` is the version of the configuration.
#[utoipa::path(
    get,
    path = "/robots/{id}",
    tag = "robots",
    params(("id" = RobotId, Path, description = "The robot.")),
    responses(
        (status = OK, description = "The robot", body = RobotDocument,
            headers(("ETag" = String, description = "Version of the configuration."))),
        (status = NOT_FOUND, description = "The robot is unknown"),
    )
)]
pub(super) async fn get_robot(
    State(api): State<ApiState>,
    RobotPath(id): RobotPath,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<Response, Problem> {
    answer(&api, &id, StatusCode::OK, Configured::GoesOn).await
}

/// Registers a robot or changes its configuration.
///
/// The first configuration is sent with `If-None-Match: *`, a change with `If-Match` and the `ETag`
/// of `GET`. A robot's estimate restarts if its vehicle, nominal extrinsics, estimator settings,
/// joints or the meaning of its steering angles change, which the answer then reports; topics,
/// scans and `rear_axle_in_base_link` do not affect it. A dry run checks and reports the same, and
/// stores nothing.
#[utoipa::path(
    put,
    path = "/robots/{id}",
    tag = "robots",
    params(
        ("id" = RobotId, Path, description = "The robot."),
        ("If-Match" = Option<String>, Header, description = "The ETag of GET."),
        ("If-None-Match" = Option<String>, Header, description = "`*` for a new robot."),
        PutParameters,
    ),
    request_body = RobotConfig,
    responses(
        (status = OK, description = "The changed robot", body = RobotDocument,
            headers(("ETag" = String, description = "Version of the configuration."))),
        (status = CREATED, description = "The registered robot", body = RobotDocument,
            headers(("ETag" = String, description = "Version of the configuration."))),
        (status = CONFLICT, description = "The limit of robots is reached, or the robot is retired"),
        (status = PRECONDITION_FAILED,
            description = "The configuration has changed since `If-Match`, or exists despite `If-None-Match`"),
        (status = PRECONDITION_REQUIRED,
            description = "Neither `If-Match` nor `If-None-Match` is given"),
    )
)]
pub(super) async fn put_robot(
    State(api): State<ApiState>,
    RobotPath(id): RobotPath,
    Parameters(PutParameters { dry_run }): Parameters<PutParameters>,
    caller: Caller,
    headers: HeaderMap,
    Body { value: config, .. }: Body<RobotConfig>,
) -> Result<Response, Problem> {
    if dry_run {
        return tried(&api, &id, config, expected(&headers)?).await;
    }
    store(api, id, config, &headers, caller.actor).await
}

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct PutParameters {
    /// True to check the change of a robot's configuration and store nothing.
    #[serde(default)]
    dry_run: bool,
}

/// Checks a change of a robot's configuration; answers with the robot as it is, and with the keys
/// whose change would restart its estimate.
async fn tried(
    api: &ApiState,
    id: &RobotId,
    mut config: RobotConfig,
    expected: Expected,
) -> Result<Response, Problem> {
    check_change(api, id, &config)?;
    let record = api.store.load_robot(id).await?;
    let found = record.as_ref().map_or(Version(0), |record| record.version);
    if !expected.accepts(found) {
        let robot = id.clone();
        return Err(StoreError::VersionConflict { robot, found }.into());
    }
    let stored = record.and_then(|record| record.config);
    let configured = stored.map_or(Configured::First, |stored| {
        config.streams.keep_former_topic(&stored.streams);
        Configured::by_change(&stored, &config, api.fleet.estimator())
    });
    answer(api, id, StatusCode::OK, configured).await
}

/// Stores a configuration under the preconditions of a request, and answers with the robot.
pub(super) async fn store(
    api: ApiState,
    id: RobotId,
    config: RobotConfig,
    headers: &HeaderMap,
    actor: Actor,
) -> Result<Response, Problem> {
    let expected = expected(headers)?;
    check_change(&api, &id, &config)?;
    // A task of its own: what is stored reaches the fleet, even if the client goes away meanwhile.
    let registered = tokio::spawn(register(api.clone(), id.clone(), config, expected, actor));
    let (version, configured) = registered.await.map_err(|_| Problem::panicked())??;
    let status = if version == Version(1) {
        StatusCode::CREATED
    } else {
        StatusCode::OK
    };
    answer(&api, &id, status, configured).await
}

/// Stores the configuration and passes it to the fleet; returns its version and its effect. A
/// configuration without a topic of wheel odometry keeps that of the one it replaces.
async fn register(
    api: ApiState,
    id: RobotId,
    mut config: RobotConfig,
    expected: Expected,
    actor: Actor,
) -> Result<(Version, Configured), Problem> {
    if let Some(stored) = api.fleet.robot(&id).and_then(|robot| robot.config) {
        config.streams.keep_former_topic(&stored.streams);
    }
    let version = configure(&api.store, &id, &config, expected, actor).await?;
    let configured = api.fleet.configure(&id, config)?;
    Ok((version, configured))
}

/// Refuses a configuration that cannot be stored.
fn check_change(api: &ApiState, id: &RobotId, config: &RobotConfig) -> Result<(), Problem> {
    check_retired(api, id)?;
    check_room(api, id)?;
    check_config(api, &prefixes(api), id, config)
}

/// Refuses a retired robot, which has to be brought back first.
fn check_retired(api: &ApiState, id: &RobotId) -> Result<(), Problem> {
    if api.lifecycle.ledger(id).shadow.retired.is_some() {
        return Err(FleetRefused::Retired(id.clone()).into());
    }
    Ok(())
}

/// Refuses a robot beyond the fleet's limit, before it is stored.
fn check_room(api: &ApiState, id: &RobotId) -> Result<(), Problem> {
    let known = api.fleet.robot(id);
    let is_new = known.is_none_or(|robot| robot.config.is_none());
    let robots = api.fleet.robots();
    let configured = robots.iter().filter(|robot| robot.config.is_some());
    if is_new && configured.count() >= limits::ROBOTS_MAX {
        return Err(FleetRefused::RobotsMax.into());
    }
    Ok(())
}

/// Refuses a configuration that contradicts another robot's, or the service's.
pub(crate) fn check_config(
    api: &ApiState,
    owners: &Prefixes,
    id: &RobotId,
    config: &RobotConfig,
) -> Result<(), Problem> {
    check_prefix(owners, id, config)?;
    check_estimator(api, config)
}

/// Robots by the prefixes of their topics.
pub(crate) type Prefixes = BTreeMap<TopicName, RobotId>;

/// Robots of the fleet by the prefixes of their topics.
pub(crate) fn prefixes(api: &ApiState) -> Prefixes {
    let streams = api.fleet.streams().into_iter();
    let named = streams.filter_map(|(id, streams)| Some((streams.fields().prefix.clone()?, id)));
    named.collect()
}

/// Refuses the prefix of another robot, whose messages would be attributed to this one.
fn check_prefix(owners: &Prefixes, id: &RobotId, config: &RobotConfig) -> Result<(), Problem> {
    let Some(prefix) = &config.streams.fields().prefix else {
        return Ok(());
    };
    match owners.get(prefix).filter(|owner| *owner != id) {
        None => Ok(()),
        Some(other) => {
            let accepted = format!("one that no other robot has; this is that of {other}");
            Err(Problem::refused(
                "streams.prefix",
                prefix.as_str(),
                &accepted,
            ))
        }
    }
}

/// Refuses estimator settings that contradict those of the service.
fn check_estimator(api: &ApiState, config: &RobotConfig) -> Result<(), Problem> {
    let Some(own) = &config.estimator else {
        return Ok(());
    };
    let settings = own.over(api.fleet.estimator());
    settings.map(|_| ()).map_err(|refused| {
        let accepted = format!("settings that go with [estimator] of the service ({refused})");
        Problem::refused("estimator", "others", &accepted)
    })
}

async fn answer(
    api: &ApiState,
    id: &RobotId,
    status: StatusCode,
    configured: Configured,
) -> Result<Response, Problem> {
    let record = api.store.load_robot(id).await?;
    let view = api
        .fleet
        .robot(id)
        .ok_or_else(|| Problem::robot_unknown(id.as_str()))?;
    let now = api.clock.now();
    let owners = Owners::now(&api.membership);
    let robot = Listed::of(api, view, now);
    let document = RobotDocument::of(&robot, record.as_ref(), &owners, now).configured(configured);
    Ok(versioned_json(
        status,
        record.map_or(Version(0), |record| record.version),
        document,
    ))
}
