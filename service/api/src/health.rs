//! Routes `/healthz` and `/readyz`: whether a restart of the process is needed, and whether it can
//! work; and `security.txt`, the contacts of its operator.

use std::sync::Arc;
use std::time::Duration;

use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use fleetcal_cluster::{Cluster, InstanceId, Member, Membership};
use fleetcal_domain::limits;
use fleetcal_store::Store;
use serde::Serialize;
use tokio::sync::Mutex;

use super::ApiState;
use super::extract::{NoParameters, Parameters};
use super::problem::Problem;

/// True if a request is a probe, which is answered under any load.
pub(super) fn is_probe(path: &str) -> bool {
    matches!(path, "/healthz" | "/readyz")
}

/// Cache of the database's last answer, so that each probe does not cause a write.
#[derive(Debug, Clone, Default)]
pub(super) struct ReadyProbe {
    last: Arc<Mutex<Option<Probed>>>,
}

/// Answer of the database, and its time on the running clock.
#[derive(Debug)]
struct Probed {
    at: Duration,
    answer: Result<(), String>,
}

impl ReadyProbe {
    /// Writability of the database, as of the last second.
    async fn database(&self, store: &Store, elapsed: Duration) -> Result<(), String> {
        let mut last = self.last.lock().await;
        if let Some(probed) = last.as_ref()
            && elapsed.saturating_sub(probed.at) < limits::READY_PROBE_EVERY
        {
            return probed.answer.clone();
        }
        let answer = match tokio::time::timeout(limits::READY_PROBE_TIMEOUT, store.probe()).await {
            Ok(answer) => answer.map_err(|error| error.to_string()),
            Err(_) => Err("the database did not answer in time".to_owned()),
        };
        *last = Some(Probed {
            at: elapsed,
            answer: answer.clone(),
        });
        answer
    }
}

/// Readiness of the service.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct Readiness {
    /// True if all checks pass.
    ready: bool,
    /// Check that the database can be written, with the reason if not.
    database: Check,
    /// Survival of acknowledged decisions after the loss of the database's machine, because a
    /// second one has them by then. `unknown` if the database does not report it.
    survives_machine_loss: Survival,
    /// Check that the database has a schema for this program.
    migrations: Check,
    /// Check that the Zenoh session is open and, for an instance of a cluster, connected to a
    /// router. The detail also names the client whose further sessions get no place.
    zenoh: Check,
    /// Check that this instance is a member of its cluster; absent for a single service. The detail
    /// also names the instances that it does not receive over Zenoh.
    #[serde(skip_serializing_if = "Option::is_none")]
    cluster: Option<Check>,
}

/// Certainty of a survival.
#[derive(Debug, Clone, Copy, Serialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
enum Survival {
    Yes,
    No,
    Unknown,
}

/// Check of one requirement.
#[derive(Debug, Serialize, utoipa::ToSchema)]
struct Check {
    ok: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    detail: Option<String>,
}

impl Check {
    fn of(result: Result<(), String>) -> Self {
        Self {
            ok: result.is_ok(),
            detail: result.err(),
        }
    }
}

/// Checks whether the process works: it fails if only a restart would make it write again.
///
/// A database that accepts no writes is no reason, since a restart would not help; `/readyz`
/// reports it.
#[utoipa::path(get, path = "/healthz", tag = "service",
    responses(
        (status = OK, description = "The process runs", body = String,
            content_type = "text/plain"),
        (status = SERVICE_UNAVAILABLE, description = "The database accepts writes, but this process \
            has written nothing for a minute: restart it", body = Problem,
            content_type = "application/problem+json"),
    ))]
pub(super) async fn healthz(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<&'static str, Problem> {
    if api.store.is_stuck() {
        let detail = "the database takes writes, but this process does not write: restart it";
        let status = StatusCode::SERVICE_UNAVAILABLE;
        return Err(Problem::new(status, "writer_stuck", detail));
    }
    Ok("ok\n")
}

/// Returns the contacts for reports of vulnerabilities, as RFC 9116 asks for.
#[utoipa::path(get, path = "/.well-known/security.txt", tag = "service",
    responses(
        (status = OK, description = "The contacts, valid for 180 days", body = String),
        (status = NOT_FOUND, description = "No `security_contacts` are configured"),
    ))]
pub(super) async fn security_txt(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<String, Problem> {
    let expires = api.clock.now().plus(limits::SECURITY_TXT_VALID_FOR);
    let text = api
        .security_contacts
        .text(&crate::time::of(expires).to_string());
    text.ok_or_else(|| Problem::new(StatusCode::NOT_FOUND, "no_contacts", "none is configured"))
}

/// Checks that this program can use the database's schema; else returns the found one. Instances of
/// two versions share a database while they are upgraded one after the other, so for an instance
/// the schema may be newer: a migration keeps everything that the version before it uses.
async fn schema(store: &Store, membership: &Membership) -> Result<(), String> {
    match store.schema().await {
        Ok((found, known)) if found == known => Ok(()),
        Ok((found, known)) if found > known && membership.cluster().is_some() => Ok(()),
        Ok((found, known)) => Err(format!("the schema is {found} instead of {known}")),
        Err(error) => Err(error.to_string()),
    }
}

/// Checks that robots can be received.
fn zenoh(api: &ApiState) -> Result<(), String> {
    if !*api.link_open.borrow() {
        return Err("the Zenoh session is not open".to_owned());
    }
    match own_member(&api.membership) {
        Some(member) if !Member::has_right_time(member.clock_ahead_ns) => {
            let off_s = member.clock_ahead_ns.unsigned_abs() as f64 / 1e9;
            let side = if member.clock_ahead_ns < 0 {
                "behind"
            } else {
                "ahead of"
            };
            let most_s = limits::CLUSTER_CLOCK_USED_UP_TO.as_secs();
            Err(format!(
                "the clock is {off_s:.1} s {side} the database's, more than {most_s} s: other instances take the robots"
            ))
        }
        Some(member) if !member.linked => Err("no Zenoh router is reached".to_owned()),
        _ => Ok(()),
    }
}

/// Checks that this instance can serve requests, and will for a while.
fn joined(cluster: &Cluster, membership: &Membership) -> Result<(), String> {
    if cluster.seat().is_none() {
        return Err("the instance has not joined the cluster".to_owned());
    }
    match own_member(membership) {
        Some(member) if member.draining => Err("the instance is about to end".to_owned()),
        _ => Ok(()),
    }
}

/// Instances that this one does not receive, in words.
fn unheard(membership: &Membership) -> Option<String> {
    let unheard = own_member(membership)?.hearing.unheard_instances;
    let names: Vec<_> = unheard.iter().map(InstanceId::as_str).collect();
    (!names.is_empty()).then(|| format!("not heard over Zenoh: {}", names.join(", ")))
}

/// Row of this instance.
fn own_member(membership: &Membership) -> Option<Member> {
    let cluster = membership.cluster()?;
    cluster.snapshot().member(&cluster.seat()?).cloned()
}

/// Survival of acknowledged decisions after the loss of the database's machine.
async fn survival(store: &Store) -> Survival {
    match store.survives_machine_loss().await {
        Ok(Some(true)) => Survival::Yes,
        Ok(Some(false)) => Survival::No,
        Ok(None) | Err(_) => Survival::Unknown,
    }
}

/// Checks whether the service can work: the database can be written and has a schema that this
/// program can use, and the Zenoh session is open.
///
/// An instance of a cluster must also be a member of it and be connected to a router.
#[utoipa::path(get, path = "/readyz", tag = "service",
    responses(
        (status = OK, description = "The service is ready", body = Readiness),
        (status = SERVICE_UNAVAILABLE, description = "The service is not ready", content(
            (Readiness = "application/json"),
            (Problem = "application/problem+json"),
        )),
    ))]
pub(super) async fn readyz(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Response {
    let database = api.ready.database(&api.store, api.clock.elapsed()).await;
    // A database that does not answer would keep whoever asks waiting for each of the others.
    let answers = database.is_ok();
    let migrations = if answers {
        schema(&api.store, &api.membership).await
    } else {
        Err("the database does not answer".to_owned())
    };
    let zenoh = zenoh(&api);
    let cluster = api.membership.cluster();
    let mut cluster = cluster.map(|cluster| Check::of(joined(cluster, &api.membership)));
    if let Some(check) = cluster.as_mut().filter(|check| check.ok) {
        // Robots go to whoever hears them: it is ready all the same.
        check.detail = unheard(&api.membership);
    }
    let survives_machine_loss = if answers {
        survival(&api.store).await
    } else {
        Survival::Unknown
    };
    let is_in = cluster.as_ref().is_none_or(|check| check.ok);
    let ready = database.is_ok() && migrations.is_ok() && zenoh.is_ok() && is_in;
    let mut zenoh = Check::of(zenoh);
    if let Some(crowd) = api.fleet.peers().crowded().filter(|_| zenoh.ok) {
        // Peers that have fewer still come in, and those that are there go on.
        zenoh.detail = Some(crowd);
    }
    let document = Readiness {
        ready,
        database: Check::of(database),
        survives_machine_loss,
        migrations: Check::of(migrations),
        zenoh,
        cluster,
    };
    let status = if ready {
        StatusCode::OK
    } else {
        StatusCode::SERVICE_UNAVAILABLE
    };
    (status, Json(document)).into_response()
}
