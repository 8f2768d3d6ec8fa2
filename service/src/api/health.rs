//! `/healthz` and `/readyz`: whether the process runs, and whether it can do its work.

use std::sync::Arc;
use std::time::Duration;

use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use tokio::sync::Mutex;

use super::ApiState;
use super::extract::{NoParameters, Parameters};
use crate::limits;
use crate::store::Store;

/// The last answer of the database, so that everybody may ask without making it write each time.
#[derive(Debug, Clone, Default)]
pub(super) struct ReadyProbe {
    last: Arc<Mutex<Option<Probed>>>,
}

/// An answer of the database, and when it was given on the running clock.
#[derive(Debug)]
struct Probed {
    at: Duration,
    answer: Result<(), String>,
}

impl ReadyProbe {
    /// Whether the database can be written, as of the last second.
    async fn database(&self, store: &Store, elapsed: Duration) -> Result<(), String> {
        let mut last = self.last.lock().await;
        if let Some(probed) = last.as_ref()
            && elapsed.saturating_sub(probed.at) < limits::READY_PROBE_EVERY
        {
            return probed.answer.clone();
        }
        let answer = store.probe().await.map_err(|error| error.to_string());
        *last = Some(Probed {
            at: elapsed,
            answer: answer.clone(),
        });
        answer
    }
}

/// What the service needs for its work.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct Readiness {
    /// Whether all of it is there.
    ready: bool,
    /// Whether the database can be written; else why not.
    database: Check,
    /// Whether the database has this program's schema.
    migrations: Check,
    /// Whether the Zenoh session is open.
    zenoh: Check,
}

/// One thing that the service needs.
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

/// Says that the process runs.
#[utoipa::path(get, path = "/healthz", tag = "service",
    responses((status = OK, description = "The process runs", body = String,
        content_type = "text/plain")))]
pub(super) async fn healthz(Parameters(NoParameters {}): Parameters<NoParameters>) -> &'static str {
    "ok\n"
}

/// Says whether the service can do its work: the database can be written and has this program's
/// schema, and the Zenoh session is open.
#[utoipa::path(get, path = "/readyz", tag = "service",
    responses(
        (status = OK, description = "It can", body = Readiness),
        (status = SERVICE_UNAVAILABLE, description = "It cannot", body = Readiness),
    ))]
pub(super) async fn readyz(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Response {
    let database = api.ready.database(&api.store, api.clock.elapsed()).await;
    let migrations = match api.store.schema().await {
        Ok((found, known)) if found == known => Ok(()),
        Ok((found, known)) => Err(format!("the schema is {found} instead of {known}")),
        Err(error) => Err(error.to_string()),
    };
    let zenoh = if *api.link_open.borrow() {
        Ok(())
    } else {
        Err("the Zenoh session is not open".to_owned())
    };
    let ready = database.is_ok() && migrations.is_ok() && zenoh.is_ok();
    let document = Readiness {
        ready,
        database: Check::of(database),
        migrations: Check::of(migrations),
        zenoh: Check::of(zenoh),
    };
    let status = if ready {
        StatusCode::OK
    } else {
        StatusCode::SERVICE_UNAVAILABLE
    };
    (status, Json(document)).into_response()
}
