//! Every route as a client sees it.

mod robots;
mod server;
mod service;
mod stream;

use std::collections::BTreeMap;
use std::sync::Arc;

use axum::Router;
use axum::body::Body;
use axum::http::{HeaderMap, Request, StatusCode};
use fleetcal_estimator::EstimatorSettings;
use fleetcal_proto::RobotId;
use futures::StreamExt;
use serde_json::Value;
use tempfile::TempDir;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;
use tower::ServiceExt;

use super::{ApiSetup, router};
use crate::clock::MockClock;
use crate::config::RobotConfig;
use crate::fleet::{FleetHandle, FleetSetup};
use crate::store::{Expected, Store};

/// 2026-01-01T00:00:00Z.
const NOW_NS: i64 = 1_767_225_600_000_000_000;

/// A service without its Zenoh link.
struct Bench {
    routes: Router,
    fleet: FleetHandle,
    store: Store,
    link_open: watch::Sender<bool>,
    stop: CancellationToken,
    _folder: TempDir,
}

/// What a client was answered.
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

/// A service that knows these robots.
async fn bench(robots: &[&str]) -> Bench {
    let folder = tempfile::tempdir().unwrap();
    let clock = MockClock::at(NOW_NS);
    let store = Store::open(folder.path(), clock.clone()).await.unwrap();
    for name in robots {
        store
            .save_robot(&robot(name), &config(), Expected::Absent)
            .await
            .unwrap();
    }
    let fleet = FleetHandle::start(FleetSetup {
        clock: clock.clone(),
        journal: Arc::new(store.clone()),
        estimator: EstimatorSettings::default(),
        robots: robots.iter().map(|name| (robot(name), config())).collect(),
        checkpoints: BTreeMap::new(),
    });
    let (link_open, is_open) = watch::channel(true);
    let stop = CancellationToken::new();
    let routes = router(ApiSetup {
        fleet: fleet.clone(),
        store: store.clone(),
        clock,
        link_open: is_open,
        stop: stop.clone(),
    });
    Bench {
        routes,
        fleet,
        store,
        link_open,
        stop,
        _folder: folder,
    }
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
        let mut request = Request::builder().method(method).uri(uri);
        if !headers.iter().any(|(name, _)| *name == "content-type") {
            request = request.header("content-type", "application/json");
        }
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        let request = request.body(body.into()).unwrap();
        let response = self.routes.clone().oneshot(request).await.unwrap();
        let (parts, body) = response.into_parts();
        let bytes = axum::body::to_bytes(body, 16 << 20).await.unwrap();
        Answer {
            status: parts.status,
            headers: parts.headers,
            body: String::from_utf8_lossy(&bytes).into_owned(),
        }
    }

    /// The first bytes of an answer that has no end.
    async fn begin(&self, uri: &str, headers: &[(&str, &str)]) -> axum::body::BodyDataStream {
        let mut request = Request::builder().uri(uri);
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        let request = request.body(Body::empty()).unwrap();
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

    /// Status and, of a problem, what it says; checks that it is a whole problem document.
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

/// The next event of a stream: its name and data.
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
