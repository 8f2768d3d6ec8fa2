//! `/metrics`: counters for Prometheus.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::IntoResponse;
use fleetcal_domain::alert::{AlertKind, ConditionName};
use fleetcal_domain::limits;
use fleetcal_domain::robot::{ConnectionState, RobotView};
use fleetcal_fleet::FleetCounters;
use fleetcal_http::Turned;
use fleetcal_operations::webhook_dispatcher::WebhookDispatcherCounters;
use fleetcal_store::StoreCounters;
use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, EncodeMetric, text};
use prometheus_client::metrics::MetricType;
use prometheus_client::metrics::counter::ConstCounter;
use prometheus_client::metrics::gauge::ConstGauge;
use prometheus_client::registry::Registry;

use super::ApiState;
use super::extract::{NoParameters, Parameters};
use super::problem::Problem;
use super::robots::connection_state;

/// Counters of the service and of each robot, in the text format that Prometheus reads.
#[utoipa::path(get, path = "/metrics", tag = "service",
    responses(
        (status = OK,
            description = "Counters and gauges as OpenMetrics text, `application/openmetrics-text`"),
    ))]
pub(super) async fn metrics(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<impl IntoResponse, Problem> {
    let mut registry = Registry::default();
    let robots = api.fleet.robots();
    registry.register_collector(Box::new(Snapshot {
        fleet: api.fleet.counters(),
        heard: heard(&api, &robots),
        robots: Arc::new(robots),
        lost_answers: api.lifecycle.answer_counters(),
        store: api.store.counters(),
        alerts: api.evaluator.counts(),
        dispatcher: api.dispatcher.counters(),
        waiting_deliveries: api.store.waiting_deliveries().await.ok(),
        link_open: *api.link_open.borrow(),
        connections: api.connections.open(),
        turned_away: api.connections.turned(),
        uptime_s: api.clock.elapsed().as_secs_f64(),
    }));
    let mut written = String::new();
    text::encode(&mut written, &registry).map_err(|error| {
        Problem::new(
            StatusCode::INTERNAL_SERVER_ERROR,
            "not_serializable",
            error.to_string(),
        )
    })?;
    let kind = "application/openmetrics-text; version=1.0.0; charset=utf-8";
    Ok(([(header::CONTENT_TYPE, kind)], written))
}

fn heard(api: &ApiState, robots: &[RobotView]) -> BTreeMap<ConnectionState, u64> {
    let now_ns = api.clock.now_ns();
    let all = ConnectionState::ALL.iter();
    let mut heard: BTreeMap<_, _> = all.map(|one| (*one, 0)).collect();
    for robot in robots {
        let ledger = api.lifecycle.ledger(&robot.id);
        *heard
            .entry(connection_state(robot, &ledger, now_ns))
            .or_default() += 1;
    }
    heard
}

/// The counters at one time.
#[derive(Debug)]
struct Snapshot {
    fleet: FleetCounters,
    robots: Arc<Vec<RobotView>>,
    lost_answers: [(&'static str, u64); 3],
    /// How many robots are heard how.
    heard: BTreeMap<ConnectionState, u64>,
    store: StoreCounters,
    alerts: BTreeMap<(AlertKind, ConditionName), u64>,
    dispatcher: WebhookDispatcherCounters,
    /// `None` while the database does not say.
    waiting_deliveries: Option<u64>,
    link_open: bool,
    connections: usize,
    turned_away: [(&'static str, u64); Turned::ALL.len()],
    uptime_s: f64,
}

impl Collector for Snapshot {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> fmt::Result {
        let out = &mut encoder;
        gauge(
            out,
            "fleetcal_up_seconds",
            "Time since the start",
            self.uptime_s,
        )?;
        gauge(
            out,
            "fleetcal_zenoh_open",
            "Whether the Zenoh session is open",
            f64::from(self.link_open),
        )?;
        encode_process(out)?;
        self.encode_http(out)?;
        self.encode_fleet(out)?;
        self.encode_store(out)?;
        self.encode_alerts(out)?;
        self.encode_robots(out)
    }
}

impl Snapshot {
    fn encode_http(&self, out: &mut DescriptorEncoder<'_>) -> fmt::Result {
        gauge(
            out,
            "fleetcal_http_connections",
            "HTTP connections that are open",
            self.connections as f64,
        )?;
        let by_reason = self
            .turned_away
            .iter()
            .map(|(reason, count)| ([("reason", *reason)], *count));
        counters(
            out,
            "fleetcal_http_turned_away",
            "HTTP connections and requests turned away, by reason",
            by_reason,
        )
    }

    fn encode_fleet(&self, out: &mut DescriptorEncoder<'_>) -> fmt::Result {
        let fleet = &self.fleet;
        for (name, help, value) in [
            ("fleetcal_messages", "Messages received", fleet.received),
            (
                "fleetcal_foreign_keys",
                "Messages whose key names no robot",
                fleet.foreign_keys,
            ),
            (
                "fleetcal_oversized",
                "Messages refused for their size",
                fleet.oversized,
            ),
            (
                "fleetcal_beyond_robots",
                "Messages of robots beyond the limit",
                { fleet.beyond_robots_max },
            ),
            (
                "fleetcal_unanswered_questions",
                "Questions over Zenoh beyond the limit",
                fleet.unanswered_questions,
            ),
            (
                "fleetcal_notes_beyond_budget",
                "Notes of robots beyond their budget",
                fleet.notes_beyond_budget,
            ),
            (
                "fleetcal_events_beyond_budget",
                "Events beyond their robot's budget",
                fleet.events_beyond_budget,
            ),
            (
                "fleetcal_missing",
                "Messages that by their neighbours' stamps were sent and not used, dropped ones included",
                fleet.missing,
            ),
            (
                "fleetcal_of_two_senders",
                "Messages not used since two senders use one id",
                fleet.of_two_senders,
            ),
            (
                "fleetcal_estimator_panics",
                "Estimators that failed",
                fleet.estimator_panics,
            ),
        ] {
            counter(out, name, help, value)?;
        }
        let lost = self
            .lost_answers
            .iter()
            .map(|(reason, count)| ([("reason", *reason)], *count));
        let help = "Answers of robots that were not stored, by reason";
        counters(out, "fleetcal_lost_answers", help, lost)?;
        let by_stream = fleet
            .by_stream
            .iter()
            .map(|(stream, value)| ([("stream", *stream)], *value));
        counters(
            out,
            "fleetcal_stream_messages",
            "Messages received by stream",
            by_stream,
        )
    }

    fn encode_store(&self, out: &mut DescriptorEncoder<'_>) -> fmt::Result {
        let store = &self.store;
        for (name, help, value) in [
            (
                "fleetcal_store_commits",
                "Transactions committed",
                store.commits,
            ),
            (
                "fleetcal_store_failed_commits",
                "Transactions that failed",
                store.failed_commits,
            ),
            (
                "fleetcal_store_history_rows",
                "Seconds of history written",
                store.history_rows,
            ),
            (
                "fleetcal_store_refused",
                "Writes refused by a full queue",
                store.refused,
            ),
            (
                "fleetcal_store_lost",
                "Rows lost by a failing database",
                store.lost,
            ),
            (
                "fleetcal_store_lost_history",
                "Seconds of history lost by a failing database, counted in fleetcal_store_lost too",
                store.lost_history,
            ),
            (
                "fleetcal_store_pruned_rows",
                "Rows deleted for their age",
                store.pruned_rows,
            ),
        ] {
            counter(out, name, help, value)?;
        }
        gauge(
            out,
            "fleetcal_store_waiting",
            "Writes that wait in memory",
            store.waiting as f64,
        )
    }

    /// Every kind in every active state, so that none appears only with its first alert.
    fn encode_alerts(&self, out: &mut DescriptorEncoder<'_>) -> fmt::Result {
        let help = "Active alerts";
        let mut family = out.encode_descriptor("fleetcal_alerts", help, None, MetricType::Gauge)?;
        for kind in AlertKind::ALL {
            for &state in ConditionName::ALL {
                if state == ConditionName::Normal {
                    continue;
                }
                let labels = [
                    ("kind", kind.as_str()),
                    ("severity", kind.severity().as_str()),
                    ("state", state.as_str()),
                ];
                let count = self.alerts.get(&(kind, state)).copied().unwrap_or(0);
                ConstGauge::new(count as f64).encode(family.encode_family(&labels)?)?;
            }
        }
        let dispatcher = &self.dispatcher;
        for (name, help, value) in [
            (
                "fleetcal_webhook_delivered",
                "Messages that a receiver has taken",
                dispatcher.delivered,
            ),
            (
                "fleetcal_webhook_failed_attempts",
                "Attempts to send a message that failed",
                dispatcher.failed_attempts,
            ),
            (
                "fleetcal_webhook_given_up",
                "Messages that were given up",
                dispatcher.given_up,
            ),
        ] {
            counter(out, name, help, value)?;
        }
        match self.waiting_deliveries {
            Some(waiting) => gauge(
                out,
                "fleetcal_webhook_waiting",
                "Messages that wait for their receiver",
                waiting as f64,
            ),
            None => Ok(()),
        }
    }

    fn encode_robots(&self, out: &mut DescriptorEncoder<'_>) -> fmt::Result {
        let all = self.robots.len();
        gauge(out, "fleetcal_robots", "Robots known", all as f64)?;
        let mut family = out.encode_descriptor(
            "fleetcal_robots_by_connection",
            "Robots that are online, silent, or switched off on purpose",
            None,
            MetricType::Gauge,
        )?;
        for (connection, count) in &self.heard {
            let labels = [("connection", connection.name())];
            ConstGauge::new(*count as f64).encode(family.encode_family(&labels)?)?;
        }
        let beyond = all.saturating_sub(limits::METRICS_ROBOTS_MAX);
        gauge(
            out,
            "fleetcal_robots_beyond_metrics",
            "Robots without own counters",
            beyond as f64,
        )?;
        for (name, help, value) in ROBOT_COUNTERS {
            let shown = self.robots.iter().take(limits::METRICS_ROBOTS_MAX);
            let values = shown.map(|robot| ([("robot", robot.id.as_str())], value(robot)));
            counters(out, name, help, values)?;
        }
        Ok(())
    }
}

/// Name, meaning and value of a robot's counter.
type RobotCounter = (&'static str, &'static str, fn(&RobotView) -> u64);

const ROBOT_COUNTERS: [RobotCounter; 8] = [
    (
        "fleetcal_robot_received",
        "Messages of the robot",
        |robot| robot.counters.received,
    ),
    (
        "fleetcal_robot_processed",
        "Messages that its estimator took",
        |robot| robot.counters.processed,
    ),
    (
        "fleetcal_robot_dropped_wheel_odometry",
        "Drive samples dropped",
        |robot| robot.counters.dropped_wheel_odometry,
    ),
    (
        "fleetcal_robot_dropped_scans",
        "Scans and poses dropped",
        |robot| robot.counters.dropped_scans,
    ),
    ("fleetcal_robot_refused", "Messages refused", |robot| {
        robot.counters.refused
    }),
    (
        "fleetcal_robot_ignored",
        "Messages before it was configured",
        |robot| robot.counters.ignored,
    ),
    (
        "fleetcal_robot_unpaired",
        "Speeds without a steering angle near enough",
        |robot| robot.pairing.map_or(0, |pairing| pairing.unpaired),
    ),
    (
        "fleetcal_robot_estimator_restarts",
        "Restarts of its estimator",
        |robot| u64::from(robot.estimator_restarts),
    ),
];

fn counter(out: &mut DescriptorEncoder<'_>, name: &str, help: &str, value: u64) -> fmt::Result {
    let counter = ConstCounter::new(value);
    counter.encode(out.encode_descriptor(name, help, None, MetricType::Counter)?)
}

fn gauge(out: &mut DescriptorEncoder<'_>, name: &str, help: &str, value: f64) -> fmt::Result {
    let gauge = ConstGauge::new(value);
    gauge.encode(out.encode_descriptor(name, help, None, MetricType::Gauge)?)
}

fn counters<'a>(
    out: &mut DescriptorEncoder<'_>,
    name: &str,
    help: &str,
    values: impl Iterator<Item = ([(&'a str, &'a str); 1], u64)>,
) -> fmt::Result {
    let mut family = out.encode_descriptor(name, help, None, MetricType::Counter)?;
    for (labels, value) in values {
        ConstCounter::new(value).encode(family.encode_family(&labels)?)?;
    }
    Ok(())
}

fn encode_process(out: &mut DescriptorEncoder<'_>) -> fmt::Result {
    let Some(bytes) = resident_bytes() else {
        return Ok(());
    };
    gauge(
        out,
        "process_resident_memory_bytes",
        "Memory of the process",
        bytes,
    )
}

/// Resident memory of this process; `None` where the system does not say.
fn resident_bytes() -> Option<f64> {
    /// Linux gives it in pages of this size on the machines that this runs on.
    const PAGE_BYTES: f64 = 4_096.0;
    let statm = std::fs::read_to_string("/proc/self/statm").ok()?;
    let pages: f64 = statm.split(' ').nth(1)?.parse().ok()?;
    Some(pages * PAGE_BYTES)
}
