//! What ROS 2 robots announce by liveliness tokens.

use std::collections::{BTreeMap, BTreeSet};

use fleetcal_proto::RobotId;
use fleetcal_proto::encoding::MessageType;
use fleetcal_proto::ros2_key::{Announcement, KeyLayout, TOKENS_OF_BRIDGE, TOKENS_OF_RMW};
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Result, Session};

use super::{Ros2, RouteTable, lock};
use crate::fleet::AnnouncedTopic;
use crate::limits;
use crate::streams::{STREAMS_OF_TOPICS, message_types};

/// The tokens that stand.
#[derive(Debug, Default)]
pub struct Discovery {
    tokens: BTreeMap<String, Announcement>,
    /// What was told of each robot, to tell it only when it changes.
    told: BTreeMap<RobotId, Vec<AnnouncedTopic>>,
}

/// Follows the tokens, those that stood before included.
pub async fn watch_tokens(session: &Session, ros2: &Ros2) -> Result<Vec<Subscriber<()>>> {
    let mut subscribers = Vec::new();
    for expression in TOKENS_OF_RMW.into_iter().chain([TOKENS_OF_BRIDGE]) {
        let own = ros2.clone();
        let subscriber = session
            .liveliness()
            .declare_subscriber(expression)
            .history(true)
            .callback(move |sample| take(&own, &sample))
            .await?;
        subscribers.push(subscriber);
    }
    Ok(subscribers)
}

fn take(ros2: &Ros2, sample: &Sample) {
    let token = sample.key_expr().as_str();
    let Some(announced) = Announcement::of_token(token) else {
        return;
    };
    let stands = sample.kind() == SampleKind::Put;
    if announced.layout == KeyLayout::BridgeRos2dds {
        let of = MessageType::of_ros_type(&announced.type_name);
        ros2.change_table(|table| table.announce(&announced.path, of.filter(|_| stands)));
    }
    let mut discovery = lock(&ros2.shared.discovery);
    if !stands {
        discovery.tokens.remove(token);
    } else if discovery.tokens.len() < limits::ROS2_TOKENS_MAX {
        discovery.tokens.insert(token.to_owned(), announced.clone());
    }
    let table = ros2.table();
    let Some(placed) = table.place(&announced.path, announced.layout) else {
        return;
    };
    let robot = placed.robot;
    let topics = topics_of(&discovery, &table, &robot);
    drop(table);
    tell(ros2, &mut discovery, &robot, topics);
}

/// Looks again whose each announced topic is: which robots there are, or their prefixes, changed.
pub fn place_anew(ros2: &Ros2) {
    let mut discovery = lock(&ros2.shared.discovery);
    let table = ros2.table();
    let mut robots: BTreeSet<RobotId> = discovery.told.keys().cloned().collect();
    let tokens = discovery.tokens.values();
    robots.extend(tokens.filter_map(|of| Some(table.place(&of.path, of.layout)?.robot)));
    let topics: Vec<_> = robots
        .into_iter()
        .map(|robot| {
            let topics = topics_of(&discovery, &table, &robot);
            (robot, topics)
        })
        .collect();
    drop(table);
    for (robot, topics) in topics {
        tell(ros2, &mut discovery, &robot, topics);
    }
}

fn topics_of(discovery: &Discovery, table: &RouteTable, robot: &RobotId) -> Topics {
    let mut topics = Topics::default();
    for announced in discovery.tokens.values() {
        let placed = table.place(&announced.path, announced.layout);
        let Some(placed) = placed.filter(|placed| placed.robot == *robot) else {
            continue;
        };
        let of = MessageType::of_ros_type(&announced.type_name);
        let suits = |stream: &_| of.is_some_and(|of| message_types(*stream).contains(&of));
        let topic = AnnouncedTopic {
            topic: placed.topic.to_owned(),
            type_name: announced.type_name.clone(),
            layout: announced.layout,
            suited_for: STREAMS_OF_TOPICS.into_iter().filter(suits).collect(),
        };
        if !topic.suited_for.is_empty() {
            topics.home = Some((placed.prefix.to_owned(), announced.layout));
        }
        if topics.all.len() < limits::ANNOUNCED_TOPICS_MAX {
            topics.all.insert(topic);
        }
    }
    topics
}

/// What a robot has announced.
#[derive(Debug, Default)]
struct Topics {
    all: BTreeSet<AnnouncedTopic>,
    /// Where the topics that suit are; `None` of a robot that has none, which is no vehicle.
    home: Option<(String, KeyLayout)>,
}

fn tell(ros2: &Ros2, discovery: &mut Discovery, robot: &RobotId, topics: Topics) {
    let all: Vec<AnnouncedTopic> = match topics.home {
        Some(_) => topics.all.into_iter().collect(),
        None => Vec::new(),
    };
    let before = discovery.told.get(robot).map_or(&[][..], Vec::as_slice);
    if before == all {
        return;
    }
    let came = before.is_empty();
    if all.is_empty() {
        discovery.told.remove(robot);
    } else {
        discovery.told.insert(robot.clone(), all.clone());
    }
    ros2.shared.fleet.set_topics(robot, all);
    if let Some((prefix, layout)) = topics.home
        && came
    {
        ros2.moved(robot, &prefix, layout);
        ros2.came(robot);
    }
}
