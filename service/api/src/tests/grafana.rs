//! The Grafana dashboard against the metrics of a service.

use std::collections::BTreeSet;

use super::metrics_text::{Family, parse};
use super::*;

const DASHBOARD: &str = include_str!("../../../../packaging/grafana/fleetcal.json");
/// Words of `PromQL` whose parentheses list labels.
const LISTS: [&str; 5] = ["by", "without", "on", "ignoring", "group_left"];

/// Names of a family's samples.
fn names(name: &str, kind: &str) -> Vec<String> {
    let endings: &[&str] = match kind {
        "counter" => &["_total"],
        "info" => &["_info"],
        "histogram" => &["_bucket", "_sum", "_count"],
        _ => &[""],
    };
    endings
        .iter()
        .map(|ending| format!("{name}{ending}"))
        .collect()
}

/// Returns the metrics that an expression names, with the labels that it selects them by.
fn selectors(expr: &str) -> Vec<(String, Vec<String>)> {
    let is_word = |letter: char| letter.is_ascii_alphanumeric() || letter == '_';
    let mut found = Vec::new();
    let mut rest = expr;
    while let Some(at) = rest.find(['f', 'p']) {
        let (before, from) = rest.split_at(at);
        let end = from.find(|letter| !is_word(letter)).unwrap_or(from.len());
        let (word, after) = from.split_at(end);
        let begins = !before.ends_with(is_word);
        if begins && (word.starts_with("fleetcal_") || word.starts_with("process_")) {
            let labels = after
                .strip_prefix('{')
                .and_then(|list| list.split_once('}'));
            let labels = labels.map_or(Vec::new(), |(list, _)| {
                let pairs = list.split(", ");
                pairs
                    .filter_map(|pair| pair.split('=').next().map(str::to_owned))
                    .collect()
            });
            found.push((word.to_owned(), labels));
        }
        rest = after;
    }
    found
}

/// Returns the labels that an expression groups or joins by.
fn grouped(expr: &str) -> Vec<String> {
    let mut found = Vec::new();
    for word in LISTS {
        for (at, _) in expr.match_indices(&format!("{word} (")) {
            let list = &expr[at + word.len() + 2..];
            let end = list.find(')').unwrap_or(list.len());
            found.extend(list[..end].split(", ").map(str::to_owned));
        }
    }
    found
}

/// Returns what an expression names that these families do not have. Labels of a family without a
/// sample are not known.
fn unknown(expr: &str, families: &BTreeMap<String, Family>) -> Vec<String> {
    let mut unknown = Vec::new();
    // Prometheus adds these two.
    let mut labels: BTreeSet<&str> = BTreeSet::from(["job", "instance"]);
    for (metric, selected_by) in selectors(expr) {
        let of = |(name, family): &(&String, &Family)| names(name, &family.kind).contains(&metric);
        let Some((_, family)) = families.iter().find(of) else {
            unknown.push(metric);
            continue;
        };
        let Some(sample) = family.samples.first() else {
            labels.extend(["robot", "parameter"]);
            continue;
        };
        labels.extend(
            family
                .samples
                .iter()
                .flat_map(|one| one.labels.keys().map(String::as_str)),
        );
        let has = |label: &String| sample.labels.contains_key(label) || label == "job";
        unknown.extend(selected_by.into_iter().filter(|label| !has(label)));
    }
    let missing = |label: &String| !labels.contains(label.as_str());
    unknown.extend(grouped(expr).into_iter().filter(missing));
    unknown
}

/// Returns every expression of the dashboard's panels, and those that fill its variables.
fn expressions(dashboard: &serde_json::Value) -> Vec<String> {
    let panels = dashboard["panels"].as_array().unwrap();
    let targets = panels
        .iter()
        .filter_map(|panel| panel["targets"].as_array());
    let exprs = targets.flatten().map(|target| &target["expr"]);
    let variables = dashboard["templating"]["list"].as_array().unwrap();
    let filled = variables
        .iter()
        .filter(|variable| variable["type"] == "query")
        .map(|variable| &variable["definition"]);
    let all = exprs.chain(filled);
    all.map(|text| text.as_str().unwrap().to_owned()).collect()
}

#[tokio::test]
async fn the_dashboard_of_grafana_asks_for_metrics_that_there_are() {
    let bench = bench(&["agv_1"]).await;
    // Each request is counted once it is answered.
    bench.get("/metrics").await;
    let answer = bench.get("/metrics").await;
    let families = parse(&answer.body).unwrap();
    let dashboard: serde_json::Value = serde_json::from_str(DASHBOARD).unwrap();
    let expressions = expressions(&dashboard);
    assert!(expressions.len() > 25, "{}", expressions.len());
    for expr in &expressions {
        assert_eq!(unknown(expr, &families), [""; 0], "{expr}");
    }
    let planted = "sum by (kind) (rate(fleetcal_gone_total[5m]) * fleetcal_robots{colour=\"red\"})";
    let gone = unknown(planted, &families);
    assert_eq!(gone, ["fleetcal_gone_total", "colour", "kind"]);
}
