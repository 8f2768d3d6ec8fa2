//! Access of ROS 2 robots: send their streams, announce their topics, hear what
//! is approved, and see that topic in their graph.

use fleetcal_proto::message_type::MessageType;
use fleetcal_proto::ros2_key::{TOKENS_OF_BRIDGE, TOKENS_OF_RMW, typed_expressions};
use serde_json::Value;

use super::routes::RouteTable;
use super::{calibration, description};
use crate::access::rule;

/// Makes the rules beside those of our own keys.
pub fn rules(table: &RouteTable) -> Vec<Value> {
    let settings = table.settings();
    let mut streams: Vec<String> = table.bridge_expressions().into_iter().collect();
    let mut tokens: Vec<String> = Vec::new();
    let has_prefixes = !table.robot_expressions().is_empty();
    if !settings.rmw_zenoh.is_empty() || has_prefixes {
        // The type in a key says enough: a robot that registers later may use any topic.
        let of_type = |of| typed_expressions("**", of);
        streams.extend(MessageType::ALL.into_iter().flat_map(of_type));
        tokens.extend(TOKENS_OF_RMW.map(str::to_owned));
    }
    if !settings.bridge.is_empty() || has_prefixes {
        tokens.push(TOKENS_OF_BRIDGE.to_owned());
    }
    let mut rules = Vec::new();
    let mut add = |id: &str, flow: &str, messages: &[&str], keys: &[String]| {
        if !keys.is_empty() {
            rules.push(rule(id, flow, messages, keys));
        }
    };
    add("ros2_streams", "ingress", &["put"], &streams);
    add(
        "ros2_streams_wanted",
        "egress",
        &["declare_subscriber"],
        &streams,
    );
    add("ros2_topics", "ingress", &["liveliness_token"], &tokens);
    add(
        "ros2_topics_wanted",
        "egress",
        &["declare_liveliness_subscriber"],
        &tokens,
    );
    if settings.publish_calibration {
        let results = calibration::expressions(table);
        let stored = calibration::history_expressions(table);
        add(
            "ros2_results_wanted",
            "ingress",
            &["declare_subscriber"],
            &results,
        );
        add("ros2_results", "egress", &["put", "reply"], &results);
        add(
            "ros2_history_wanted",
            "ingress",
            &["query", "declare_liveliness_subscriber"],
            &stored,
        );
        add("ros2_history", "egress", &["declare_queryable"], &stored);
        if !settings.rmw_zenoh.is_empty() || has_prefixes {
            // Who asks for the graph gets our own node's part of it, and no other robot's.
            let graph = TOKENS_OF_RMW.map(str::to_owned);
            let own = calibration::token_expressions();
            let asks = ["declare_liveliness_subscriber", "liveliness_query"];
            add("ros2_graph_wanted", "ingress", &asks, &graph);
            add("ros2_graph", "egress", &["liveliness_token", "reply"], &own);
        }
    }
    rules.extend(of_descriptions());
    rules
}

/// Rules of descriptions: robots publish them, or answer with those that were published before.
fn of_descriptions() -> [Value; 4] {
    let described = description::expressions();
    let earlier = description::history_expressions();
    [
        rule(
            "ros2_descriptions",
            "ingress",
            &["put", "reply"],
            &described,
        ),
        rule(
            "ros2_descriptions_wanted",
            "egress",
            &["declare_subscriber"],
            &described,
        ),
        rule(
            "ros2_earlier_descriptions",
            "ingress",
            &["declare_queryable"],
            &earlier,
        ),
        rule(
            "ros2_earlier_descriptions_wanted",
            "egress",
            &["query"],
            &earlier,
        ),
    ]
}
