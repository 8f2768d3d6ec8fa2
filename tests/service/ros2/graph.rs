//! Graph of ROS 2 as a robot of `rmw_zenoh` sees it: the calibration's topic, and no other
//! robot.

use std::collections::BTreeSet;
use std::time::Duration;

use fleetcal_proto::ros2_key::{Announcement, KeyLayout, NO_HASH};
use fleetcal_tests::service::{Service, now};
use zenoh::Session;

use super::robot::RosRobot;
use super::{BRIDGE, HUMBLE, JAZZY, config, topics_of};
use crate::service::hostile::client;

/// Longest wait for a token to appear or disappear.
const PATIENCE: Duration = Duration::from_secs(30);

/// Returns the tokens under a key expression, queried as by a starting node of `rmw_zenoh`.
async fn graph(session: &Session, expression: &str) -> BTreeSet<String> {
    let asked = session.liveliness().get(expression);
    let replies = asked.timeout(Duration::from_secs(5)).await.unwrap();
    let mut tokens = BTreeSet::new();
    while let Ok(reply) = replies.recv_async().await {
        if let Ok(sample) = reply.result() {
            tokens.insert(sample.key_expr().to_string());
        }
    }
    tokens
}

async fn graph_of(session: &Session, expression: &str, tokens: usize) -> BTreeSet<String> {
    let began = now();
    loop {
        let graph = graph(session, expression).await;
        if graph.len() == tokens {
            return graph;
        }
        assert!(began.elapsed() < PATIENCE, "{tokens} tokens: {graph:?}");
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
}

/// Returns the service's own id, by its token.
async fn instance(session: &Session) -> String {
    let tokens = graph_of(session, "fleet/@service/*", 1).await;
    let token = tokens.first().unwrap();
    token.rsplit_once('/').unwrap().1.to_owned()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_calibrations_topic_is_in_the_graph_and_no_other_robot_is() {
    let service = Service::start_with(&config());
    let onlooker = client(&service).await;
    let jazzy = RosRobot::start(&service, "jazzy_01", JAZZY).await;
    let humble = RosRobot::start(&service, "humble_01", HUMBLE).await;
    let bridge = RosRobot::start(&service, "bridge_01", BRIDGE).await;

    // By hand, and by the parser that robots' own tokens go through.
    let zid = instance(&onlooker).await;
    let string = "std_msgs::msg::dds_::String_";
    let hash = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";
    for (domain, robot, hash, layout) in [
        ("0", "jazzy_01", hash, KeyLayout::RmwZenoh),
        ("7", "humble_01", NO_HASH, KeyLayout::RmwZenohWithoutHash),
    ] {
        let tokens = graph_of(&onlooker, &format!("@ros2_lv/{domain}/**"), 2).await;
        let of_kind = |kind: &str| {
            let infix = format!("/{kind}/");
            tokens.iter().find(|token| token.contains(&infix)).unwrap()
        };
        let (node, publisher) = (of_kind("NN"), of_kind("MP"));
        let node: Vec<&str> = node.split('/').collect();
        let publisher_parts: Vec<&str> = publisher.split('/').collect();
        let [
            "@ros2_lv",
            of,
            session,
            node_id,
            id,
            "NN",
            "%",
            namespace,
            "fleetcal",
        ] = node[..]
        else {
            panic!("{node:?}");
        };
        assert_eq!((of, session, id), (domain, zid.as_str(), node_id));
        assert_eq!(namespace, format!("%{robot}"));
        assert_eq!(publisher_parts[..4], node[..4], "a publisher of that node");
        assert_ne!(publisher_parts[4], id);
        let topic = format!("%{robot}%calibration%approved");
        let rest = [namespace, "fleetcal", &topic, string, hash, ":1:,1:,:,:,,"];
        assert_eq!(publisher_parts[7..], rest);
        let read = Announcement::of_token(publisher).unwrap();
        assert_eq!(read.path, format!("{domain}/{robot}/calibration/approved"));
        assert_eq!(read.type_name, "std_msgs/msg/String");
        assert_eq!(read.layout, layout);
    }
    // The robots' own, which the service sees, nobody else does.
    assert_eq!(graph(&onlooker, "@ros2_lv/**").await.len(), 4);
    let own = |topic: &serde_json::Value| topic["topic"] != "calibration/approved";
    let topics = topics_of(&service, "jazzy_01").unwrap();
    assert!(topics.len() == 2 && topics.iter().all(own), "{topics:?}");

    // A node that watches the graph, as every one does, sees it go with the robot.
    let (sender, mut heard) = tokio::sync::mpsc::channel(16);
    let watching = onlooker
        .liveliness()
        .declare_subscriber("@ros2_lv/0/**")
        .history(true)
        .callback(move |sample| {
            sender.try_send(sample.kind()).ok();
        });
    watching.background().await.unwrap();
    let mut kinds = Vec::new();
    let mut jazzy = Some(jazzy);
    while kinds.len() < 4 {
        let kind = tokio::time::timeout(PATIENCE, heard.recv()).await;
        kinds.push(kind.unwrap().unwrap().to_string());
        if kinds.len() == 2
            && let Some(jazzy) = jazzy.take()
        {
            jazzy.stop().await;
        }
    }
    assert_eq!(kinds, ["PUT", "PUT", "DELETE", "DELETE"]);
    graph_of(&onlooker, "@ros2_lv/0/**", 0).await;
    humble.stop().await;
    bridge.stop().await;
}
