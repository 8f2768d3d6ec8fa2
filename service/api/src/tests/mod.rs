//! Every route from a client's side.

mod access;
mod alerts;
mod approval;
mod bulk;
mod certificates;
mod checks;
mod cluster;
mod described;
mod description;
mod export;
mod grafana;
mod metrics;
mod metrics_text;
mod moments;
mod notes;
mod permission;
mod policy;
mod preview;
mod recording;
mod robots;
mod rollouts;
mod server;
mod service;
mod standing;
mod stream;
mod trace;
mod views;
mod writes;

use std::collections::BTreeMap;
use std::sync::Arc;

use axum::Router;
use axum::body::Body;
use axum::http::{HeaderMap, Request, StatusCode};
use fleetcal_clock::MockClock;
use fleetcal_cluster::Membership;
use fleetcal_contract::TestDatabase;
use fleetcal_domain::access::{AccountName, Actor, Grant, Role, SetupCode, TokenValue};
use fleetcal_domain::alert::AlertPolicy;
use fleetcal_domain::approval::Policy;
use fleetcal_domain::robot::RobotConfig;
use fleetcal_estimator::EstimatorSettings;
use fleetcal_fleet::{FleetHandle, FleetSetup};
use fleetcal_http::{SecurityContact, SecurityContacts, TrustedProxies};
use fleetcal_model::WallTime;
use fleetcal_moments::Moments;
use fleetcal_operations::accounts::{KeepSetupCode, TokenChange, change_token};
use fleetcal_operations::alert_evaluator::{AlertEvaluator, AlertEvaluatorSetup};
use fleetcal_operations::lifecycle::{Lifecycle, LifecycleSetup};
use fleetcal_operations::peers::Peers;
use fleetcal_operations::robots::configure;
use fleetcal_operations::webhook_dispatcher::{WebhookDispatcher, WebhookDispatcherSetup};
use fleetcal_proto::RobotId;
use fleetcal_proto::signing::SigningKey;
use fleetcal_store::{Expected, Store};
use futures::StreamExt;
use serde_json::Value;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;
use tower::ServiceExt;

use super::{AccessSetup, ApiSetup, BuildInfo, Connections, router};

/// Time 2026-01-01T00:00:00Z.
const NOW_NS: i64 = 1_767_225_600_000_000_000;

/// Service without its Zenoh link. Requests without a credential of their own are sent with the
/// token of an administrator named "tester".
struct Bench {
    /// Data folder of the moments.
    data: tempfile::TempDir,
    setup: ApiSetup,
    routes: Router,
    fleet: FleetHandle,
    lifecycle: Lifecycle,
    store: Store,
    link_open: watch::Sender<bool>,
    stop: CancellationToken,
    clock: Arc<MockClock>,
    token: String,
    setup_code: String,
    _database: TestDatabase,
}

/// Answer to a client.
struct Answer {
    status: StatusCode,
    headers: HeaderMap,
    body: String,
}

fn config() -> RobotConfig {
    serde_json::from_str(r#"{"model": "bicycle", "wheelbase_m": 1.2}"#).unwrap()
}

fn robot(name: &str) -> RobotId {
    RobotId::parse(name).unwrap()
}

/// Bench with these robots.
async fn bench(robots: &[&str]) -> Bench {
    bench_of(robots, BTreeMap::new()).await
}

/// Bench of a restarted service that received these robots before.
async fn bench_after_restart(robots: &[&str]) -> Bench {
    let at = WallTime(NOW_NS - 60 * 1_000_000_000);
    let heard = robots.iter().map(|name| (robot(name), at));
    bench_of(robots, heard.collect()).await
}

fn fleet_of(
    robots: &[&str],
    last_heard: BTreeMap<RobotId, WallTime>,
    store: &Store,
    clock: &Arc<MockClock>,
) -> FleetHandle {
    FleetHandle::start(FleetSetup {
        clock: clock.clone(),
        journal: Arc::new(store.clone()),
        estimator: EstimatorSettings::default(),
        robots: robots.iter().map(|name| (robot(name), config())).collect(),
        cross_tracks: BTreeMap::new(),
        checkpoints: BTreeMap::new(),
        last_heard,
        audited: fleetcal_model::AuditId(0),
        membership: fleetcal_cluster::Membership::alone(),
    })
}

async fn bench_of(robots: &[&str], last_heard: BTreeMap<RobotId, WallTime>) -> Bench {
    let database = TestDatabase::new().await;
    let clock = MockClock::at(NOW_NS);
    let store = database.open(clock.clone()).await;
    for name in robots {
        let actor = Actor::service();
        let done = configure(&store, &robot(name), &config(), Expected::Absent, actor);
        done.await.unwrap();
    }
    let fleet = fleet_of(robots, last_heard, &store, &clock);
    let lifecycle = Lifecycle::start(LifecycleSetup {
        store: store.clone(),
        fleet: fleet.clone(),
        clock: clock.clone(),
        policy: Policy::default(),
        keys: SigningKey::from_bytes(&[7; 32]).into(),
        membership: Membership::alone(),
    })
    .await
    .unwrap();
    let (evaluator, dispatcher) = watchers(&store, &fleet, &lifecycle, &clock).await;
    let (link_open, is_open) = watch::channel(true);
    let stop = CancellationToken::new();
    let data = tempfile::tempdir().unwrap();
    let (setup_code, setup_text) = SetupCode::new(&[0xab; 32], WallTime(NOW_NS));
    assert!(store.transact(KeepSetupCode(setup_code)).await.unwrap());
    let setup = ApiSetup {
        build: BuildInfo {
            version: "1.2.3",
            commit: "abcdef0",
        },
        fleet: fleet.clone(),
        lifecycle: lifecycle.clone(),
        evaluator,
        dispatcher,
        moments: Moments::start(data.path(), fleet.clone(), clock.clone()).unwrap(),
        store: store.clone(),
        clock: clock.clone(),
        link_open: is_open,
        membership: Membership::alone(),
        peers: Peers::default(),
        access: AccessSetup { public_url: None },
        security_contacts: SecurityContacts::default(),
        connections: Connections::new(clock.clone(), TrustedProxies::default()),
        stop: stop.clone(),
    };
    let routes = router(setup.clone());
    let token = token(&store, "tester", grant(Role::Admin), None).await;
    Bench {
        data,
        setup,
        routes,
        fleet,
        lifecycle,
        store,
        link_open,
        stop,
        clock,
        token,
        setup_code: setup_text,
        _database: database,
    }
}

/// Evaluator of alerts and dispatcher of their messages.
async fn watchers(
    store: &Store,
    fleet: &FleetHandle,
    lifecycle: &Lifecycle,
    clock: &Arc<MockClock>,
) -> (AlertEvaluator, WebhookDispatcher) {
    let evaluator = AlertEvaluator::start(AlertEvaluatorSetup {
        store: store.clone(),
        fleet: fleet.clone(),
        lifecycle: lifecycle.clone(),
        clock: clock.clone(),
        policy: AlertPolicy::default(),
        membership: Membership::alone(),
    });
    let dispatcher = WebhookDispatcher::start(WebhookDispatcherSetup {
        store: store.clone(),
        clock: clock.clone(),
        jitter: fleetcal_operations::entropy::jitter,
        membership: Membership::alone(),
    });
    (evaluator.await.unwrap(), dispatcher)
}

/// Grant of a role; for the role of a robot, that of robot `a`.
fn grant(role: Role) -> Grant {
    Grant::of_token(role, (role == Role::Robot).then(|| robot("a"))).unwrap()
}

/// Creates a token as the command line does.
async fn token(store: &Store, name: &str, grant: Grant, expires_ns: Option<WallTime>) -> String {
    let mut random = [0; 32];
    random[..name.len()].copy_from_slice(name.as_bytes());
    let value = TokenValue::new(&random);
    let change = TokenChange::Create {
        name: AccountName::parse(name).unwrap(),
        grant,
        hash: value.hash(),
        expires_ns,
        key: None,
    };
    let done = change_token(store, Actor::command_line(), change);
    done.await.unwrap();
    value.reveal().to_owned()
}

impl Bench {
    /// Sends a request without a body.
    async fn send(&self, method: &str, uri: &str, headers: &[(&str, &str)]) -> Answer {
        self.send_body(method, uri, headers, "").await
    }

    async fn get(&self, uri: &str) -> Answer {
        self.send("GET", uri, &[]).await
    }

    /// Sends a request with this body, as JSON unless a header says otherwise.
    async fn send_body(
        &self,
        method: &str,
        uri: &str,
        headers: &[(&str, &str)],
        body: impl Into<Body>,
    ) -> Answer {
        let request = self.request(method, uri, headers, body);
        let response = self.routes.clone().oneshot(request).await.unwrap();
        let (parts, body) = response.into_parts();
        let bytes = axum::body::to_bytes(body, 16 << 20).await.unwrap();
        let answer = Answer {
            status: parts.status,
            headers: parts.headers,
            body: String::from_utf8_lossy(&bytes).into_owned(),
        };
        description::assert_described(method, uri, &answer);
        answer
    }

    /// Makes a request as [`Bench`] describes; an empty `authorization` sends none.
    fn request(
        &self,
        method: &str,
        uri: &str,
        headers: &[(&str, &str)],
        body: impl Into<Body>,
    ) -> Request<Body> {
        let has = |wanted: &str| headers.iter().any(|(name, _)| *name == wanted);
        let mut request = Request::builder().method(method).uri(uri);
        if !has("content-type") {
            request = request.header("content-type", "application/json");
        }
        if !has("authorization") && !has("cookie") {
            request = request.header("authorization", format!("Bearer {}", self.token));
        }
        for (name, value) in headers {
            if (*name, *value) != ("authorization", "") {
                request = request.header(*name, *value);
            }
        }
        request.body(body.into()).unwrap()
    }

    /// Begins to read an answer that has no end.
    async fn begin(&self, uri: &str, headers: &[(&str, &str)]) -> axum::body::BodyDataStream {
        let request = self.request("GET", uri, headers, "");
        let response = self.routes.clone().oneshot(request).await.unwrap();
        assert_eq!(response.status(), StatusCode::OK);
        response.into_body().into_data_stream()
    }
}

impl Answer {
    fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap()
    }

    fn header(&self, name: &str) -> &str {
        self.headers
            .get(name)
            .map_or("", |value| value.to_str().unwrap())
    }

    /// Status, and the text of a problem; checks that it is a complete problem document.
    fn told(&self) -> String {
        let status = self.status.as_u16();
        if status < 400 {
            return status.to_string();
        }
        assert_eq!(
            self.header("content-type"),
            "application/problem+json",
            "{}",
            self.body
        );
        let problem = self.json();
        assert_eq!(problem["type"], "about:blank");
        assert_eq!(problem["status"], status);
        assert_eq!(problem["title"], self.status.canonical_reason().unwrap());
        let field = problem["field"].as_str().map(|field| format!(" [{field}]"));
        let (code, detail) = (&problem["code"], &problem["detail"]);
        format!(
            "{status} {}{}: {}",
            code.as_str().unwrap(),
            field.unwrap_or_default(),
            detail.as_str().unwrap()
        )
    }
}

/// Next event of a stream: its name and data.
async fn next_event(stream: &mut axum::body::BodyDataStream) -> (String, String) {
    let bytes = stream.next().await.unwrap().unwrap();
    let text = String::from_utf8(bytes.to_vec()).unwrap();
    let field = |name: &str| {
        let prefix = format!("{name}: ");
        text.lines()
            .find_map(|line| line.strip_prefix(&prefix))
            .unwrap_or("")
            .to_owned()
    };
    (field("event"), field("data"))
}
