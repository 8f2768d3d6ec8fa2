//! Strict reading of `/metrics`.

#![expect(clippy::float_cmp, reason = "what is counted is a whole number")]

use fleetcal_domain::limits;
use fleetcal_domain::standing::Standing;
use fleetcal_model::Stream;
use fleetcal_proto::Encoding;

use super::metrics_text::{Family, Sample, parse};
use super::*;

impl Bench {
    async fn metrics(&self) -> BTreeMap<String, Family> {
        let answer = self.get("/metrics").await;
        let kind = "application/openmetrics-text; version=1.0.0; charset=utf-8";
        assert_eq!(answer.header("content-type"), kind);
        parse(&answer.body).unwrap_or_else(|wrong| panic!("{wrong} in\n{}", answer.body))
    }
}

/// Sum of a family's samples with these labels.
fn sum(family: &Family, labels: &[(&str, &str)]) -> f64 {
    let is_of = |sample: &&Sample| {
        let mut labels = labels.iter();
        labels.all(|(key, value)| sample.labels.get(*key).map(String::as_str) == Some(value))
    };
    family
        .samples
        .iter()
        .filter(is_of)
        .map(|one| one.value)
        .sum()
}

#[tokio::test]
async fn metrics_are_strict_openmetrics_text() {
    let bench = bench(&["agv_1"]).await;
    bench.get("/api/v1/robots/agv_1").await;
    bench.get("/api/v1/robots/none").await;
    bench.get("/nowhere").await;
    bench.send("BREW", "/api/v1/robots", &[]).await;
    let families = bench.metrics().await;
    for (name, family) in &families {
        assert!(!family.help.ends_with('.'), "{name}: {}", family.help);
        let is_ours = ["fleetcal_", "process_"]
            .iter()
            .any(|prefix| name.starts_with(prefix));
        assert!(is_ours, "{name}");
    }
    let build = &families["fleetcal_build"].samples[0];
    assert_eq!(build.name, "fleetcal_build_info");
    assert_eq!(build.labels["version"], "1.2.3");
    assert_eq!(build.labels["commit"], "abcdef0");
    let started = families["process_start_time_seconds"].samples[0].value;
    assert!((started - NOW_NS as f64 / 1e9).abs() < 1.0, "{started}");
    assert_eq!(sum(&families["fleetcal_zenoh_session_up"], &[]), 1.0);
    let memory = &families["process_resident_memory_bytes"];
    assert!(sum(memory, &[]) > 1e6);
}

#[tokio::test]
async fn what_is_lost_is_one_family() {
    let bench = bench(&["agv_1"]).await;
    let families = bench.metrics().await;
    let dropped = &families["fleetcal_messages_dropped"];
    // Every reason is there before anything is lost, so that a rate sees the first.
    assert_eq!(sum(dropped, &[]), 0.0);
    assert_eq!(dropped.samples.len(), 16);
    bench.fleet.count_foreign_key();
    bench.fleet.count_unanswered_question();
    let form = Encoding::Cdr;
    let huge = limits::payload_bytes_max(Stream::Event) + 1;
    let id = robot("agv_1");
    bench
        .fleet
        .receive(&id, Stream::Event, form, huge, Vec::new);
    bench
        .fleet
        .receive(&robot("new"), Stream::Event, form, 1, || vec![0]);
    let families = bench.metrics().await;
    let dropped = &families["fleetcal_messages_dropped"];
    for reason in ["unknown_key", "query_limit", "oversized"] {
        assert_eq!(sum(dropped, &[("reason", reason)]), 1.0, "{reason}");
    }
    let messages = &families["fleetcal_robot_messages"];
    let of = |robot, outcome| sum(messages, &[("robot", robot), ("outcome", outcome)]);
    assert_eq!(
        (of("agv_1", "refused"), of("agv_1", "processed")),
        (1.0, 0.0)
    );
    assert_eq!(of("new", "ignored"), 1.0);
    assert_eq!(sum(&families["fleetcal_messages_received"], &[]), 3.0);
}

#[tokio::test]
async fn requests_and_transactions_are_timed() {
    let bench = bench(&["agv_1"]).await;
    bench.get("/api/v1/robots/agv_1").await;
    bench.get("/api/v1/robots/none").await;
    bench.get("/nowhere/at/all").await;
    let families = bench.metrics().await;
    let requests = &families["fleetcal_http_request_duration_seconds"];
    let counted = |route, status| {
        let all = |sample: &&Sample| sample.name.ends_with("_count");
        let counts = Family {
            samples: requests.samples.iter().filter(all).cloned().collect(),
            ..requests.clone()
        };
        sum(
            &counts,
            &[("route", route), ("status", status), ("method", "GET")],
        )
    };
    assert_eq!(counted("/api/v1/robots/{id}", "2xx"), 1.0);
    assert_eq!(counted("/api/v1/robots/{id}", "4xx"), 1.0);
    // Of a page that is nowhere, whatever the answer is.
    let other = ["2xx", "4xx"].map(|status| counted("other", status));
    assert_eq!(other.iter().sum::<f64>(), 1.0);
    let transactions = &families["fleetcal_store_transaction_duration_seconds"];
    let count = |path| {
        let mut samples = transactions.samples.iter();
        let is = |one: &&Sample| one.name.ends_with("_count") && one.labels["path"] == path;
        samples.find(is).map(|one| one.value)
    };
    // The robot and the token were written.
    assert!(count("records") >= Some(2.0), "{:?}", count("records"));
    assert!(count("telemetry").is_some());
    assert!(families.contains_key("fleetcal_estimator_scan_duration_seconds"));
}

#[tokio::test]
async fn robots_are_counted_by_how_they_stand() {
    let bench = bench(&["agv_1", "agv_2"]).await;
    bench
        .fleet
        .receive(&robot("new"), Stream::Event, Encoding::Cdr, 1, || vec![0]);
    let families = bench.metrics().await;
    let robots = &families["fleetcal_robots"];
    assert_eq!(robots.samples.len(), Standing::ALL.len());
    assert_eq!(sum(robots, &[]), 3.0);
    assert_eq!(sum(robots, &[("standing", "no_data")]), 2.0);
    assert_eq!(sum(robots, &[("standing", "unregistered")]), 1.0);
}
