//! Descriptions that ROS 2 robots publish of themselves: `robot_description` and `tf_static` in the
//! robot's namespace.
//!
//! Both topics are transient-local: a message that was published before this service listened is
//! queried from its publisher, as Zenoh's advanced subscriber does, once a token announces the topic,
//! and once the robot is known as a vehicle: until then its description is left out.

use fleetcal_fleet::DescriptionTopic;
use fleetcal_proto::ros2_key::{KeyLayout, TopicKey};
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;
use zenoh::pubsub::Subscriber;
use zenoh::query::{ConsolidationMode, QueryTarget, ReplyKeyExpr};
use zenoh::sample::{Locality, Sample};
use zenoh::{Result, Session};

use super::Ros2;
use crate::description;

/// Suffix of a key by which an advanced subscriber queries earlier messages.
const HISTORY: &str = "@adv/**";

/// Returns the type of a topic in keys of `rmw_zenoh`.
const fn dds_type(topic: DescriptionTopic) -> &'static str {
    match topic {
        DescriptionTopic::RobotDescription => "std_msgs::msg::dds_::String_",
        DescriptionTopic::TfStatic => "tf2_msgs::msg::dds_::TFMessage_",
    }
}

/// Returns the key expressions of the descriptions of all robots in any namespace.
pub fn expressions() -> Vec<String> {
    let of_topic = |topic: DescriptionTopic| {
        let path = format!("**/{}", topic.name());
        let typed = format!("{path}/{}/*", dds_type(topic));
        [path, typed]
    };
    DescriptionTopic::ALL
        .into_iter()
        .flat_map(of_topic)
        .collect()
}

/// Returns the key expressions of their earlier messages.
pub fn history_expressions() -> Vec<String> {
    let behind = |text: String| format!("{text}/{HISTORY}");
    expressions().into_iter().map(behind).collect()
}

/// Returns the topic of a path, if it is a description's.
fn topic_of(path: &str) -> Option<DescriptionTopic> {
    DescriptionTopic::by_name(path.rsplit('/').next()?)
}

/// Returns the key expression of the earlier messages of an announced topic.
pub fn announced(path: &str, layout: KeyLayout) -> Option<String> {
    let topic = topic_of(path)?;
    Some(match layout {
        KeyLayout::BridgeRos2dds => format!("{path}/{HISTORY}"),
        KeyLayout::RmwZenoh | KeyLayout::RmwZenohWithoutHash => {
            format!("{path}/{}/*/{HISTORY}", dds_type(topic))
        }
    })
}

/// Returns the key expressions of the earlier messages of the topics below a prefix.
pub fn below(prefix: &str, layout: KeyLayout) -> impl Iterator<Item = String> {
    let paths = DescriptionTopic::ALL.map(|topic| format!("{prefix}/{}", topic.name()));
    paths
        .into_iter()
        .filter_map(move |path| announced(&path, layout))
}

/// Subscribes to the descriptions.
pub async fn subscribe(session: &Session, ros2: &Ros2) -> Result<Vec<Subscriber<()>>> {
    let mut subscribers = Vec::new();
    for text in expressions() {
        let own = ros2.clone();
        let subscriber = session
            .declare_subscriber(text)
            .allowed_origin(Locality::Remote)
            .callback(move |sample| take(&own, &sample))
            .await?;
        subscribers.push(subscriber);
    }
    Ok(subscribers)
}

/// Queries the earlier messages of announced topics until `stop`.
pub async fn query(
    session: Session,
    ros2: Ros2,
    mut announced: mpsc::Receiver<String>,
    stop: CancellationToken,
) {
    loop {
        let expression = tokio::select! {
            () = stop.cancelled() => return,
            expression = announced.recv() => expression,
        };
        let Some(expression) = expression else {
            return;
        };
        let own = ros2.clone();
        let asked = session
            .get(expression)
            .target(QueryTarget::All)
            .consolidation(ConsolidationMode::None)
            .accept_replies(ReplyKeyExpr::Any)
            .callback(move |reply| {
                if let Ok(sample) = reply.result() {
                    take(&own, sample);
                }
            });
        if let Err(error) = asked.await {
            tracing::warn!(error, "a robot's description was not asked for");
        }
    }
}

/// Passes the message of a robot's namespace on. It runs on Zenoh's receiving threads and never blocks.
fn take(ros2: &Ros2, sample: &Sample) {
    let key = TopicKey::parse(sample.key_expr().as_str());
    let Some(topic) = topic_of(key.path) else {
        return;
    };
    let placed = ros2.table().nearest(key.path, key.layout);
    let fleet = &ros2.shared.fleet;
    if let Some(placed) = placed
        && placed.topic == topic.name()
        && fleet.robot(&placed.robot).is_some()
    {
        description::take(fleet, &placed.robot, topic, sample);
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use fleetcal_domain::streams::Ros2Settings;
    use fleetcal_proto::key::KeyRoot;
    use zenoh::key_expr::KeyExpr;

    use super::*;
    use crate::ros2::RouteTable;

    #[test]
    fn every_robots_description_and_its_history_are_among_the_expressions() {
        let settings = Ros2Settings::default();
        let table = RouteTable::new(&settings, &KeyRoot::default(), BTreeMap::new());
        let among = |all: Vec<String>, key: &str| {
            let key = KeyExpr::try_from(key.to_owned()).unwrap();
            all.into_iter()
                .any(|text| KeyExpr::try_from(text).unwrap().includes(&key))
        };
        for (path, layout, key) in [
            (
                "0/tugger_01/robot_description",
                KeyLayout::RmwZenoh,
                "0/tugger_01/robot_description/std_msgs::msg::dds_::String_/RIHS01_df66",
            ),
            (
                "tugger_01/tf_static",
                KeyLayout::BridgeRos2dds,
                "tugger_01/tf_static",
            ),
        ] {
            assert!(among(expressions(), key), "{key}");
            let asked = announced(path, layout).unwrap();
            assert!(among(history_expressions(), &asked), "{asked}");
            let placed = table.nearest(path, layout).unwrap();
            assert_eq!(placed.robot.as_str(), "tugger_01");
        }
        assert_eq!(announced("tugger_01/scan", KeyLayout::BridgeRos2dds), None);
        assert!(!among(expressions(), "tugger_01/scan"));
    }
}
