//! The embedded router's access list: what is not named is denied, declarations included.
//!
//! Without it a router relays every robot's data to every other one. Forgotten declarations lose
//! data silently, so each key stands with everything that its use needs, in each direction.

use fleetcal_proto::key::{Keys, StreamKind};
use serde_json::{Value, json};

/// Streams from robots.
pub(super) const FROM_ROBOTS: [StreamKind; 8] = [
    StreamKind::WheelOdometry,
    StreamKind::Scan,
    StreamKind::LidarOdometry,
    StreamKind::Event,
    StreamKind::CalibrationApplied,
    StreamKind::CrossTrackError,
    StreamKind::RobotDescription,
    StreamKind::TfStatic,
];
/// Streams from the service.
pub(super) const FROM_SERVICE: [StreamKind; 3] = [
    StreamKind::Estimate,
    StreamKind::CalibrationApproved,
    StreamKind::CalibrationConfirmed,
];
/// Queries that the service answers.
pub(super) const ANSWERED: [StreamKind; 3] = [
    StreamKind::Progress,
    StreamKind::CalibrationApproved,
    StreamKind::CalibrationConfirmed,
];

/// Makes the access list in the form of Zenoh's configuration: our own keys, and `more`.
pub fn list(keys: &Keys, more: &[Value]) -> Value {
    let of = |kinds: &[StreamKind]| -> Vec<String> {
        kinds.iter().map(|&kind| keys.stream_of_all(kind)).collect()
    };
    let alive = vec![keys.alive_of_all()];
    let service = vec![keys.service_of_all()];
    let mut streams = of(&FROM_ROBOTS);
    // Nothing on it is used; that a robot still puts to it raises an alert.
    streams.push(keys.former_wheel_odometry_of_all());
    let mut subscribed = streams.clone();
    subscribed.push(keys.stream_of_all_kinds());
    let mut rules = vec![
        rule("streams", "ingress", &["put"], &streams),
        rule(
            "streams_wanted",
            "egress",
            &["declare_subscriber"],
            &subscribed,
        ),
        rule("presence", "ingress", &["liveliness_token"], &alive),
        rule(
            "presence_wanted",
            "egress",
            &["declare_liveliness_subscriber"],
            &alive,
        ),
        rule("answers_wanted", "ingress", &["query"], &of(&ANSWERED)),
        rule(
            "answers",
            "egress",
            &["declare_queryable", "reply"],
            &of(&ANSWERED),
        ),
        rule(
            "results_wanted",
            "ingress",
            &["declare_subscriber"],
            &of(&FROM_SERVICE),
        ),
        rule("results", "egress", &["put"], &of(&FROM_SERVICE)),
        rule(
            "service_wanted",
            "ingress",
            &["declare_liveliness_subscriber", "liveliness_query"],
            &service,
        ),
        rule(
            "service",
            "egress",
            &["liveliness_token", "reply"],
            &service,
        ),
    ];
    rules.extend_from_slice(more);
    let names: Vec<&Value> = rules.iter().filter_map(|rule| rule.get("id")).collect();
    json!({
        "enabled": true,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{ "id": "anybody", "link_protocols": ["tcp", "tls", "quic"] }],
        "policies": [{ "rules": names, "subjects": ["anybody"] }],
    })
}

/// Makes the access list for several instances that carry the fleet, each with an embedded router,
/// and forward the robots' messages, queries and subscriptions to each other: every rule holds in
/// both directions. Such a router cannot distinguish instances from robots; a router with the list
/// of `fleetcal acl generate` can.
pub fn list_of_cluster(keys: &Keys, more: &[Value]) -> Value {
    let digests = [keys.digest_of_all()];
    let told = ["put", "declare_subscriber"];
    let mut more = more.to_vec();
    more.push(rule("digests", "ingress", &told, &digests));
    let mut list = list(keys, &more);
    let rules = list.get_mut("rules").and_then(Value::as_array_mut);
    for rule in rules.into_iter().flatten() {
        if let Some(flows) = rule.get_mut("flows") {
            *flows = json!(["ingress", "egress"]);
        }
    }
    list
}

/// Makes one rule that allows `messages` in one direction.
pub fn rule(id: &str, flow: &str, messages: &[&str], key_exprs: &[String]) -> Value {
    json!({
        "id": id,
        "permission": "allow",
        "flows": [flow],
        "messages": messages,
        "key_exprs": key_exprs,
    })
}
