//! The approved calibration, as a ROS 2 topic: `calibration/approved` of each robot, a `std_msgs/msg/String`
//! whose text is the signed envelope in JSON.
//!
//! The topic is transient-local: whoever subscribes later asks for what was said before, with the
//! query that Zenoh's advanced subscriber sends, and is answered from the database. One is said again
//! whenever a robot comes back, so a subscriber that was there before the service hears it too.

use fleetcal_operations::lifecycle::Lifecycle;
use fleetcal_proto::RobotId;
use fleetcal_proto::offer::Offered;
use fleetcal_proto::ros::{RosMessage, StringMessage};
use fleetcal_proto::ros2_key::{Attachment, GID_BYTES, KeyLayout, LatchedTopic, NO_HASH, TopicKey};
use zenoh::bytes::Encoding;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::{Query, Queryable};
use zenoh::{Result, Session, Wait};

use super::{Ros2, RouteTable};
use crate::questions::Questions;

/// Name of the topic below its robot.
const TOPIC: &str = "calibration/approved";
/// Type in keys of `rmw_zenoh`; the hash follows it where there is one.
const DDS_TYPE: &str = "std_msgs::msg::dds_::String_";
const TYPE_HASH: &str = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";
/// Name of the node that publishes it.
const NODE: &str = "fleetcal";
/// Suffix of a key by which an advanced subscriber queries earlier messages.
const HISTORY: &str = "@adv";

/// Place of a robot's ROS 2 topics.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Home {
    /// Prefix of its topics in keys.
    pub prefix: String,
    /// Layout of the keys.
    pub layout: KeyLayout,
}

impl Home {
    /// Returns the key of the robot's topic.
    pub fn key(&self) -> String {
        let prefix = &self.prefix;
        match self.layout {
            KeyLayout::RmwZenoh => format!("{prefix}/{TOPIC}/{DDS_TYPE}/{TYPE_HASH}"),
            KeyLayout::RmwZenohWithoutHash => format!("{prefix}/{TOPIC}/{DDS_TYPE}/{NO_HASH}"),
            KeyLayout::BridgeRos2dds => format!("{prefix}/{TOPIC}"),
        }
    }

    /// Returns the tokens that announce the topic to `rmw_zenoh`, by the node of that number in the
    /// session; `None` for a bridge, which makes tokens of its own for what it carries.
    pub fn tokens(&self, session: &str, number: u64) -> Option<[String; 2]> {
        let hash = match self.layout {
            KeyLayout::RmwZenoh => TYPE_HASH,
            KeyLayout::RmwZenohWithoutHash => NO_HASH,
            KeyLayout::BridgeRos2dds => return None,
        };
        let topic = LatchedTopic {
            prefix: &self.prefix,
            topic: TOPIC,
            dds_type: DDS_TYPE,
            hash,
            node: NODE,
            session,
            number,
        };
        topic.tokens()
    }
}

/// True if a path is the calibration topic of some robot, whichever service publishes it.
pub fn is_topic(path: &str) -> bool {
    path.strip_suffix(TOPIC)
        .is_some_and(|prefix| prefix.ends_with('/'))
}

/// Returns the key expressions of the tokens that announce it.
pub fn token_expressions() -> Vec<String> {
    LatchedTopic::token_expressions(TOPIC, DDS_TYPE, NODE)
}

/// Returns the key expressions of the topic of every robot.
pub fn expressions(table: &RouteTable) -> Vec<String> {
    let mut all = table.bridge_paths(TOPIC);
    all.push(format!("**/{TOPIC}/{DDS_TYPE}/*"));
    all
}

/// Returns the key expressions under which subscribers query earlier messages.
pub fn history_expressions(table: &RouteTable) -> Vec<String> {
    let behind = |text: String| format!("{text}/{HISTORY}/**");
    expressions(table).into_iter().map(behind).collect()
}

/// Publishes the approved calibration for a robot on its topic.
pub async fn publish(
    session: &Session,
    ros2: &Ros2,
    robot: &RobotId,
    offered: &Offered,
) -> Result<()> {
    if !ros2.table().settings().publish_calibration {
        return Ok(());
    }
    for home in ros2.homes(robot) {
        let put = session
            .put(home.key(), payload(offered)?)
            .encoding(Encoding::APPLICATION_CDR)
            .attachment(ros2.attachment(session))
            .congestion_control(CongestionControl::Block)
            .priority(Priority::InteractiveHigh);
        if !ros2.shared.gate.lets(robot) {
            return Ok(());
        }
        put.await?;
    }
    Ok(())
}

fn payload(offered: &Offered) -> Result<Vec<u8>> {
    let data = serde_json::to_string(offered)?;
    Ok(StringMessage { data }.to_cdr())
}

/// Answers late subscribers.
pub async fn answer_history(
    session: &Session,
    ros2: Ros2,
    lifecycle: Lifecycle,
    questions: &Questions,
) -> Result<Vec<Queryable<()>>> {
    let mut queryables = Vec::new();
    let expressions = history_expressions(&ros2.table());
    for expression in expressions {
        let (ros2, lifecycle, own) = (ros2.clone(), lifecycle.clone(), session.clone());
        let questions = questions.clone();
        let queryable = session
            .declare_queryable(expression)
            .callback(move |query| {
                let (ros2, lifecycle, own) = (ros2.clone(), lifecycle.clone(), own.clone());
                questions.answer(async move { reply(&own, &ros2, &lifecycle, &query).await });
            })
            .await?;
        queryables.push(queryable);
    }
    Ok(queryables)
}

async fn reply(session: &Session, ros2: &Ros2, lifecycle: &Lifecycle, query: &Query) {
    let asked = query.key_expr().as_str().to_owned();
    let Some((key, _)) = asked.split_once(&format!("/{HISTORY}")) else {
        return;
    };
    let Some(robot) = robot_of(ros2, key) else {
        return;
    };
    let offered = match lifecycle.approved(&robot, None).await {
        Ok(Some(offered)) => offered,
        Ok(None) => return,
        Err(error) => {
            tracing::error!(robot.id = %robot, %error, "a question was not answered");
            return;
        }
    };
    let Ok(payload) = payload(&offered) else {
        return;
    };
    let reply = query
        .reply(key.to_owned(), payload)
        .encoding(Encoding::APPLICATION_CDR)
        .attachment(ros2.attachment(session));
    if let Err(error) = reply.wait() {
        tracing::debug!(robot.id = %robot, error, "a question was not answered");
    }
}

/// True if a robot's topic is at that place. Of several robots at one place, one has it.
pub fn is_home(table: &RouteTable, robot: &RobotId, prefix: &str, layout: KeyLayout) -> bool {
    let path = format!("{prefix}/{TOPIC}");
    let nearest = table.nearest(&path, layout);
    nearest.is_some_and(|nearest| nearest.robot == *robot)
}

/// Returns the robot of a topic's key; `None` for a key that names many.
fn robot_of(ros2: &Ros2, key: &str) -> Option<RobotId> {
    if key.contains(['*', '$']) {
        return None;
    }
    let key = TopicKey::parse(key);
    let table = ros2.table();
    let placed = table.nearest(key.path, key.layout)?;
    (placed.topic == TOPIC).then_some(placed.robot)
}

/// Makes the attachment of message `sequence`, sent at `source_ns`, in the session `id`.
pub fn attachment(sequence: i64, source_ns: i64, id: &[u8]) -> Vec<u8> {
    let mut gid = [0; GID_BYTES];
    for (to, from) in gid.iter_mut().zip(id) {
        *to = *from;
    }
    Attachment {
        sequence,
        source_ns,
        gid,
    }
    .to_bytes()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use fleetcal_domain::streams::Ros2Settings;
    use fleetcal_proto::key::KeyRoot;
    use zenoh::key_expr::KeyExpr;

    use super::*;

    #[test]
    fn every_robots_topic_is_among_the_expressions() {
        let settings = Ros2Settings::default();
        let table = RouteTable::new(&settings, &KeyRoot::default(), BTreeMap::new());
        for (prefix, layout) in [
            ("0/tugger_01", KeyLayout::RmwZenoh),
            ("7", KeyLayout::RmwZenohWithoutHash),
            ("tugger_01", KeyLayout::BridgeRos2dds),
        ] {
            let prefix = prefix.to_owned();
            let key = Home {
                prefix: prefix.clone(),
                layout,
            }
            .key();
            let holds = |text: String| {
                let expression = KeyExpr::try_from(text).unwrap();
                let key = KeyExpr::try_from(key.clone()).unwrap();
                expression.includes(&key)
            };
            assert!(expressions(&table).into_iter().any(holds), "{key}");
            let home = Home {
                prefix: prefix.clone(),
                layout,
            };
            for token in home.tokens("3f2a", 0).into_iter().flatten() {
                let announces = |text: String| {
                    let token = KeyExpr::try_from(token.clone()).unwrap();
                    KeyExpr::try_from(text).unwrap().includes(&token)
                };
                assert!(token_expressions().into_iter().any(announces), "{token}");
            }
            let asked = KeyExpr::try_from(format!("{key}/{HISTORY}/**")).unwrap();
            let holds = |text: String| KeyExpr::try_from(text).unwrap().includes(&asked);
            assert!(history_expressions(&table).into_iter().any(holds), "{key}");
        }
    }
}
