//! HTTP service: the API under `/api/v1`, health, metrics, and the dashboard's pages.
//!
//! Nothing outside this crate knows axum. Each route is registered once, by a macro that gives the
//! router and the OpenAPI document the same path; [`openapi`] therefore lists every route of the
//! API with its methods, and a layer in [`router`] sees a request's `MatchedPath`.

mod access;
mod alerts;
mod answers;
mod approval;
mod bulk;
mod certificates;
mod cluster;
mod dashboard;
mod documentation;
mod durations;
mod each;
mod export;
mod forwarding;
mod health;
mod layers;
mod live_event;
mod metrics;
mod request_head;
mod robots;
mod rollouts;
mod rows;
mod serving;
mod standings;
mod stream;
mod topics;
mod webhooks;

#[cfg(test)]
mod tests;

use axum::Router;
use axum::http::HeaderMap;
use axum::middleware;
use axum::response::Response;
use fleetcal_clock::SharedClock;
use fleetcal_cluster::Membership;
use fleetcal_fleet::FleetHandle;
use fleetcal_http::{Connections, Exports, SecurityContacts, host};
use fleetcal_metrics::RequestDurations;
use fleetcal_model::WallTime;
use fleetcal_moments::Moments;
use fleetcal_operations::alert_evaluator::AlertEvaluator;
use fleetcal_operations::lifecycle::Lifecycle;
use fleetcal_operations::peers::Peers;
use fleetcal_operations::webhook_dispatcher::WebhookDispatcher;
use fleetcal_requests::{cookie, etag, extract, listing, page, password, problem, time};
use fleetcal_store::Store;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;
use utoipa::openapi::security::{ApiKey, ApiKeyValue, HttpAuthScheme, HttpBuilder, SecurityScheme};
use utoipa::{Modify, OpenApi};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

pub use access::AccessSetup;
pub use serving::serve;

use access::AccessState;
use etag::tagged_json;
use extract::{NoParameters, Parameters};
use health::ReadyProbe;
use problem::Problem;
use request_head::HeadCheck;
use stream::StreamHub;

/// Version and commit of the program, for `/metrics`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BuildInfo {
    /// Version of the program.
    pub version: &'static str,
    /// Commit of its sources; `unknown` if the build had none.
    pub commit: &'static str,
}

/// Parts of the service that the API uses.
#[derive(Debug, Clone)]
pub struct ApiSetup {
    /// Version and commit of the program.
    pub build: BuildInfo,
    /// Robots of the fleet.
    pub fleet: FleetHandle,
    /// Life cycle of their calibrations.
    pub lifecycle: Lifecycle,
    /// Evaluator of their alerts.
    pub evaluator: AlertEvaluator,
    /// Dispatcher of webhook messages.
    pub dispatcher: WebhookDispatcher,
    /// Moments of the robots.
    pub moments: Moments,
    /// Store of all records.
    pub store: Store,
    /// Clock of the service.
    pub clock: SharedClock,
    /// True while the Zenoh session is open.
    pub link_open: watch::Receiver<bool>,
    /// Membership of this process in a cluster.
    pub membership: Membership,
    /// Other instances.
    pub peers: Peers,
    /// Settings of the access.
    pub access: AccessSetup,
    /// Contacts for reports of vulnerabilities.
    pub security_contacts: SecurityContacts,
    /// Connections of [`serve`].
    pub connections: Connections,
    /// Token that ends the event streams; the other requests end with [`serve`].
    pub stop: CancellationToken,
}

/// State of every handler.
#[derive(Debug, Clone)]
struct ApiState {
    build: BuildInfo,
    /// Time at which the process started, wall time.
    started_ns: WallTime,
    durations: RequestDurations,
    fleet: FleetHandle,
    lifecycle: Lifecycle,
    evaluator: AlertEvaluator,
    dispatcher: WebhookDispatcher,
    moments: Moments,
    store: Store,
    clock: SharedClock,
    link_open: watch::Receiver<bool>,
    membership: Membership,
    peers: Peers,
    stream: StreamHub,
    recordings: robots::Recordings,
    exports: Exports,
    connections: Connections,
    ready: ReadyProbe,
    access: AccessState,
    security_contacts: SecurityContacts,
}

impl ApiState {
    fn start(setup: ApiSetup) -> Self {
        Self {
            build: setup.build,
            started_ns: setup.clock.now().minus(setup.clock.elapsed()),
            durations: RequestDurations::default(),
            recordings: robots::Recordings::new(setup.stop.clone()),
            exports: Exports::default(),
            stream: StreamHub::start(&setup),
            fleet: setup.fleet,
            lifecycle: setup.lifecycle,
            evaluator: setup.evaluator,
            dispatcher: setup.dispatcher,
            moments: setup.moments,
            store: setup.store,
            clock: setup.clock,
            link_open: setup.link_open,
            membership: setup.membership,
            peers: setup.peers,
            connections: setup.connections,
            ready: ReadyProbe::default(),
            access: AccessState::new(&setup.access),
            security_contacts: setup.security_contacts,
        }
    }
}

#[derive(OpenApi)]
#[openapi(
    info(
        title = "fleetcal",
        description = "Calibration of fleets of wheeled robots: each robot's steering offset and \
            LiDAR extrinsics, their history, and the robot's events.\n\nAngles are in \
            radians, lengths in metres, times RFC 3339 in UTC. Errors are `Problem` documents \
            (RFC 9457). Unknown query parameters are refused by name.",
        license(name = "Apache-2.0", identifier = "Apache-2.0"),
    ),
    tags(
        (name = "robots", description = "Robots, their calibration and their history"),
        (name = "access", description = "Signing in, users and tokens"),
        (name = "approval", description = "Proposals, approvals, deployments and verification"),
        (name = "rollouts", description = "Staged deployments of pending proposals, in waves"),
        (name = "alerts", description = "Alerts, their acknowledgement, and webhooks"),
        (name = "live", description = "Live updates"),
        (name = "service", description = "The service itself"),
    ),
    security(("token" = []), ("session" = [])),
    modifiers(&Credentials),
    components(schemas(
        Problem,
        live_event::LiveEvent,
        fleetcal_proto::audit_head::AuditHeadDocument,
        fleetcal_proto::certificate::CertificateDocument,
    )),
)]
struct Document;

/// Credentials of callers, in the description.
struct Credentials;

impl Modify for Credentials {
    fn modify(&self, document: &mut utoipa::openapi::OpenApi) {
        let token = HttpBuilder::new()
            .scheme(HttpAuthScheme::Bearer)
            .bearer_format("cal_…")
            .description(Some(
                "An API token, of `POST /tokens` or `fleetcal token create`.",
            ))
            .build();
        let session = ApiKeyValue::with_description(
            "fleetcal_session",
            "The cookie of `POST /session`; `__Host-fleetcal_session` over HTTPS.",
        );
        let components = document.components.get_or_insert_default();
        components.add_security_scheme("token", SecurityScheme::Http(token));
        components.add_security_scheme("session", SecurityScheme::ApiKey(ApiKey::Cookie(session)));
    }
}

/// Router with every route and its layers.
pub fn router(setup: ApiSetup) -> Router {
    let cross_origin = access::cross_origin_refused(setup.access.public_url.as_ref());
    let head = HeadCheck {
        own_name: host::own_name(),
        among_instances: setup.peers.own_authority().map(str::to_owned),
        public_url: setup.access.public_url.clone(),
        connections: setup.connections.clone(),
    };
    let state = ApiState::start(setup);
    let (durations, clock) = (state.durations.clone(), state.clock.clone());
    let (routes, _) = documented().split_for_parts();
    let authorise = middleware::from_fn_with_state(state.clone(), access::authorise);
    let routes = routes
        .route_layer(authorise)
        .layer(cross_origin)
        .merge(documentation::routes())
        .fallback(dashboard::pages)
        .with_state(state);
    layers::around(routes, head, durations, clock)
}

/// OpenAPI document of [`router`].
pub fn openapi() -> utoipa::openapi::OpenApi {
    let mut document = documented().into_openapi();
    answers::complete(&mut document);
    document
}

/// Routes with their description. An event stream has no end, so it has no timeout.
fn documented() -> OpenApiRouter<ApiState> {
    let timed = OpenApiRouter::new()
        .merge(robots::routes())
        .merge(bulk::routes())
        .merge(access::routes())
        .merge(approval::routes())
        .merge(rollouts::routes())
        .merge(certificates::routes())
        .merge(alerts::routes())
        .merge(webhooks::routes())
        .routes(routes!(cluster::get_cluster))
        .routes(routes!(get_openapi))
        .layer(middleware::from_fn(layers::in_time));
    let root = OpenApiRouter::new()
        .routes(routes!(health::healthz))
        .routes(routes!(health::readyz))
        .routes(routes!(metrics::metrics))
        .routes(routes!(health::security_txt))
        .layer(middleware::from_fn(layers::in_time));
    OpenApiRouter::with_openapi(Document::openapi())
        .nest("/api/v1", timed.merge(stream::routes()))
        .merge(root)
}

/// Returns this description.
#[utoipa::path(get, path = "/openapi.json", tag = "service",
    params(("If-None-Match" = Option<String>, Header,
        description = "The ETag of an earlier response.")),
    responses(
        (status = OK, description = "The OpenAPI 3.1 document", body = Object,
            headers(("ETag" = String, description = "Hash of the document."))),
        (status = NOT_MODIFIED, description = "The client has the current document"),
    ))]
async fn get_openapi(
    Parameters(NoParameters {}): Parameters<NoParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    tagged_json(&headers, &openapi())
}
