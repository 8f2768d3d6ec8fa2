//! Route `/metrics` for Prometheus, by its conventions: names end in their unit, counters in
//! `_total`, and one quantity is one family with labels.

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::fmt;
use std::iter;

use axum::body::Body;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::IntoResponse;
use fleetcal_cluster::Membership;
use fleetcal_domain::alert::{AlertKind, ConditionName};
use fleetcal_domain::robot::{CheckState, ConnectionState};
use fleetcal_domain::standing::Standing;
use fleetcal_fleet::{FleetCounters, SessionClosed};
use fleetcal_http::Turned;
use fleetcal_metrics::robots::{self, RobotFigures};
use fleetcal_metrics::{RequestDurations, cluster, counter, counters, gauge, gauges};
use fleetcal_operations::webhook_dispatcher::WebhookDispatcherCounters;
use fleetcal_store::StoreCounters;
use futures::stream;
use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, EncodeMetric, text};
use prometheus_client::metrics::MetricType;
use prometheus_client::metrics::gauge::ConstGauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::metrics::info::Info;
use prometheus_client::registry::Registry;

use super::extract::{NoParameters, Parameters};
use super::problem::Problem;
use super::robots::connection_state;
use super::{ApiState, BuildInfo};

/// Returns counters of the service and of each robot, in the text format that Prometheus reads.
#[utoipa::path(get, path = "/metrics", tag = "service",
    responses(
        (status = OK,
            description = "Counters and gauges as OpenMetrics text, `application/openmetrics-text`"),
    ))]
pub(super) async fn metrics(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<impl IntoResponse, Problem> {
    let waiting_deliveries = api.store.waiting_deliveries().await.ok();
    let (snapshot, robots) = Snapshot::of(&api, waiting_deliveries);
    let mut registry = Registry::default();
    registry.register_collector(Box::new(snapshot));
    let mut written = String::new();
    text::encode_registry(&mut written, &registry).map_err(|error| {
        Problem::new(
            StatusCode::INTERNAL_SERVER_ERROR,
            "not_serializable",
            error.to_string(),
        )
    })?;
    let pieces = iter::once(written)
        .chain(robots::pieces(robots))
        .chain(iter::once("# EOF\n".to_owned()));
    // Each piece is written when the client has taken the one before: the text of 4,096 robots has
    // megabytes, and a client may read slowly.
    let body = Body::from_stream(stream::iter(pieces.map(Ok::<_, Infallible>)));
    let kind = "application/openmetrics-text; version=1.0.0; charset=utf-8";
    Ok(([(header::CONTENT_TYPE, kind)], body))
}

/// Counters at one moment.
#[derive(Debug)]
struct Snapshot {
    build: BuildInfo,
    /// Start of the process, s since 1970.
    started_s: f64,
    fleet: FleetCounters,
    /// Messages of this process's robots that found a full mailbox.
    mailbox_full: u64,
    membership: Membership,
    lost_answers: [(&'static str, u64); 3],
    /// Number of robots of each connection state.
    heard: BTreeMap<ConnectionState, u64>,
    /// Number of robots of each standing.
    standings: BTreeMap<Standing, u64>,
    /// Number of joining checks in each state, over this process's robots.
    checks: BTreeMap<CheckState, u64>,
    store: StoreCounters,
    /// Durations of transactions, by path.
    transactions: [(&'static str, Histogram); 2],
    /// Times of the estimators for a scan.
    scans: Histogram,
    /// Times from a scan's arrival until it is processed.
    scan_latencies: Histogram,
    /// Durations of requests.
    requests: RequestDurations,
    alerts: BTreeMap<(AlertKind, ConditionName), u64>,
    dispatcher: WebhookDispatcherCounters,
    /// Number of waiting deliveries; `None` if the database fails.
    waiting_deliveries: Option<u64>,
    link_open: bool,
    sessions: usize,
    sessions_closed: [(&'static str, u64); SessionClosed::ALL.len()],
    connections: usize,
    turned_away: [(&'static str, u64); Turned::ALL.len()],
}

impl Snapshot {
    /// Counters of this process: each robot of a cluster is reported by its own instance alone.
    fn of(api: &ApiState, waiting_deliveries: Option<u64>) -> (Self, Vec<RobotFigures>) {
        let mut robots = api.fleet.robots();
        robots.retain(|robot| api.lifecycle.ledger(&robot.id).shadow.retired.is_none());
        let standings = api.evaluator.standings();
        let now = api.clock.now();
        let mut heard: BTreeMap<_, _> = ConnectionState::ALL.iter().map(|one| (*one, 0)).collect();
        let mut checks: BTreeMap<_, _> = CheckState::ALL.iter().map(|one| (*one, 0)).collect();
        let mut stand: BTreeMap<_, _> = Standing::ALL.iter().map(|one| (*one, 0)).collect();
        for robot in &robots {
            let ledger = api.lifecycle.ledger(&robot.id);
            *heard
                .entry(connection_state(robot, &ledger, now))
                .or_default() += 1;
            *stand.entry(standings.of(robot, &ledger)).or_default() += 1;
            if api.membership.has(&robot.id) {
                for finding in &robot.checks.findings {
                    *checks.entry(finding.state).or_default() += 1;
                }
            }
        }
        let own = robots.iter().filter(|robot| api.membership.has(&robot.id));
        let own = own.map(|robot| {
            let ledger = api.lifecycle.ledger(&robot.id);
            RobotFigures::of(robot, standings.deviation(robot, &ledger))
        });
        let own: Vec<_> = own.collect();
        let snapshot = Self {
            build: api.build,
            started_s: api.started_ns.0 as f64 / 1e9,
            fleet: api.fleet.counters(),
            mailbox_full: own.iter().map(RobotFigures::mailbox_full).sum(),
            membership: api.membership.clone(),
            lost_answers: api.lifecycle.answer_counters(),
            heard,
            standings: stand,
            checks,
            store: api.store.counters(),
            transactions: api.store.transaction_durations(),
            scans: api.fleet.scan_durations(),
            scan_latencies: api.fleet.scan_latencies(),
            requests: api.durations.clone(),
            alerts: api.evaluator.counts(),
            dispatcher: api.dispatcher.counters(),
            waiting_deliveries,
            link_open: *api.link_open.borrow(),
            sessions: api.fleet.peers().open(),
            sessions_closed: api.fleet.peers().closed(),
            connections: api.connections.open(),
            turned_away: api.connections.turned(),
        };
        (snapshot, own)
    }
}

impl Collector for Snapshot {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> fmt::Result {
        let out = &mut encoder;
        self.encode_process(out)?;
        self.encode_http(out)?;
        self.encode_messages(out)?;
        self.encode_dropped(out)?;
        self.encode_store(out)?;
        self.encode_alerts(out)?;
        self.encode_webhooks(out)?;
        cluster::encode(out, &self.membership)?;
        self.encode_robots(out)
    }
}

impl Snapshot {
    fn encode_process(&self, out: &mut DescriptorEncoder<'_>) -> fmt::Result {
        let BuildInfo { version, commit } = self.build;
        let info = Info::new([("version", version), ("commit", commit)]);
        // The encoder ends its name in `_info`.
        let help = "What this program was built from";
        info.encode(out.encode_descriptor("fleetcal_build", help, None, MetricType::Info)?)?;
        gauge(
            out,
            "process_start_time_seconds",
            "When the process started, since 1970",
            self.started_s,
        )?;
        if let Some(bytes) = resident_bytes() {
            let help = "Memory of the process";
            gauge(out, "process_resident_memory_bytes", help, bytes)?;
        }
        gauge(
            out,
            "fleetcal_zenoh_session_up",
            "Whether the Zenoh session is open",
            f64::from(self.link_open),
        )?;
        self.encode_peers(out)
    }

    fn encode_peers(&self, out: &mut DescriptorEncoder<'_>) -> fmt::Result {
        gauge(
            out,
            "fleetcal_zenoh_sessions",
            "Zenoh sessions of robots and others that are open",
            self.sessions as f64,
        )?;
        let by_reason = self.sessions_closed.iter();
        let by_reason = by_reason.map(|(reason, count)| ([("reason", *reason)], *count));
        counters(
            out,
            "fleetcal_zenoh_sessions_closed",
            "Zenoh sessions closed for want of a place, by reason",
            by_reason,
        )
    }

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
        )?;
        self.requests.encode(out)
    }

    fn encode_messages(&self, out: &mut DescriptorEncoder<'_>) -> fmt::Result {
        let fleet = &self.fleet;
        let help = "Messages received, also on unknown keys";
        counter(out, "fleetcal_messages_received", help, fleet.received)?;
        let by_stream = fleet
            .by_stream
            .iter()
            .map(|(stream, value)| ([("stream", *stream)], *value));
        let help = "Messages received from robots, by stream";
        counters(out, "fleetcal_stream_messages", help, by_stream)?;
        let help = "Estimators that failed";
        counter(
            out,
            "fleetcal_estimator_panics",
            help,
            fleet.estimator_panics,
        )?;
        let help = "Time that an estimator takes for one scan";
        let kind = MetricType::Histogram;
        let name = "fleetcal_estimator_scan_duration_seconds";
        self.scans
            .encode(out.encode_descriptor(name, help, None, kind)?)?;
        let help = "Time from a scan's arrival until it is processed";
        let name = "fleetcal_scan_latency_seconds";
        self.scan_latencies
            .encode(out.encode_descriptor(name, help, None, kind)?)
    }

    /// Encodes the lost and unused messages: one family, with every reason from the start.
    fn encode_dropped(&self, out: &mut DescriptorEncoder<'_>) -> fmt::Result {
        let fleet = &self.fleet;
        let by_reason = [
            ("unknown_key", fleet.foreign_keys),
            ("oversized", fleet.oversized),
            ("robot_limit", fleet.beyond_robots_max),
            ("mailbox_full", self.mailbox_full),
            ("missing", fleet.missing),
            ("two_senders", fleet.of_two_senders),
            ("note_budget", fleet.notes_beyond_budget),
            ("event_budget", fleet.events_beyond_budget),
            ("query_limit", fleet.unanswered_questions),
        ];
        let answers = self.lost_answers.iter().copied();
        let left_out = fleet.left_out.iter().copied();
        let all = by_reason.into_iter().chain(left_out).chain(answers);
        let help = "Messages, queries, events and answers that were lost or not used, by reason";
        let all = all.map(|(reason, count)| ([("reason", reason)], count));
        counters(out, "fleetcal_messages_dropped", help, all)
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
                "fleetcal_store_fenced",
                "Rows not written because another instance has their robots by now",
                store.fenced,
            ),
            (
                "fleetcal_store_pruned_rows",
                "Rows deleted for their age",
                store.pruned_rows,
            ),
        ] {
            counter(out, name, help, value)?;
        }
        let help = "Writes that wait in memory";
        gauge(out, "fleetcal_store_waiting", help, store.waiting as f64)?;
        let mut family = out.encode_descriptor(
            "fleetcal_store_transaction_duration_seconds",
            "Time from asking for the connection that writes until the commit or its failure",
            None,
            MetricType::Histogram,
        )?;
        for (path, durations) in &self.transactions {
            durations.encode(family.encode_family(&[("path", *path)])?)?;
        }
        Ok(())
    }

    /// Encodes the alerts: every kind in every active state, so that none appears only with its
    /// first alert.
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
        Ok(())
    }

    fn encode_webhooks(&self, out: &mut DescriptorEncoder<'_>) -> fmt::Result {
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
        let help = "Robots, by how they stand";
        let standings = self.standings.iter();
        let standings = standings.map(|(standing, count)| (standing.as_str(), *count));
        gauges(out, "fleetcal_robots", help, "standing", standings)?;
        let help = "Joining checks of this process's robots, by state";
        let checks = self.checks.iter();
        let checks = checks.map(|(state, count)| (state.name(), *count));
        gauges(out, "fleetcal_joining_checks", help, "state", checks)?;
        let help = "Robots that are online, silent, or switched off on purpose";
        let heard = self.heard.iter();
        let heard = heard.map(|(connection, count)| (connection.name(), *count));
        gauges(
            out,
            "fleetcal_robots_by_connection",
            help,
            "connection",
            heard,
        )
    }
}

/// Resident memory of this process, bytes; `None` if the system does not report it.
fn resident_bytes() -> Option<f64> {
    /// Page size of Linux on the supported machines.
    const PAGE_BYTES: f64 = 4_096.0;
    let statm = std::fs::read_to_string("/proc/self/statm").ok()?;
    let pages: f64 = statm.split(' ').nth(1)?.parse().ok()?;
    Some(pages * PAGE_BYTES)
}
