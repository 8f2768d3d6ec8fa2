//! Discovery of ROS 2 robots by liveliness tokens.

use std::collections::{BTreeMap, BTreeSet};

use fleetcal_domain::limits;
use fleetcal_domain::robot::AnnouncedTopic;
use fleetcal_domain::streams::STREAMS_OF_TOPICS;
use fleetcal_proto::RobotId;
use fleetcal_proto::message_type::MessageType;
use fleetcal_proto::ros2_key::{Announcement, KeyLayout, TOKENS_OF_BRIDGE, TOKENS_OF_RMW};
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Result, Session};

use super::{Ros2, RouteTable, calibration, description, lock};

/// Tokens that are present.
#[derive(Debug, Default)]
pub struct Discovery {
    tokens: BTreeMap<String, Announcement>,
    /// Tokens of each robot.
    of_robots: BTreeMap<RobotId, BTreeSet<String>>,
    /// Topics reported for each robot, so that only changes are reported.
    told: BTreeMap<RobotId, Vec<AnnouncedTopic>>,
}

/// Follows the tokens, including those that were there before.
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
    if token.len() > limits::ROS2_TOKEN_BYTES_MAX {
        return;
    }
    let Some(announced) = Announcement::of_token(token) else {
        return;
    };
    if calibration::is_topic(&announced.path) {
        // What a service tells robots, this one or another.
        return;
    }
    let stands = sample.kind() == SampleKind::Put;
    let mut discovery = lock(&ros2.shared.discovery);
    let table = ros2.table();
    let places = table.places(&announced.path, announced.layout).into_iter();
    let robots: Vec<RobotId> = places.map(|placed| placed.robot).collect();
    discovery.note(token, stands.then_some(announced.clone()), &robots);
    drop(table);
    if announced.layout == KeyLayout::BridgeRos2dds {
        // A bridge that was restarted announces itself again before its former token is gone.
        let of = discovery.type_of(&announced.path, robots.first());
        ros2.change_table(|table| table.announce(&announced.path, of));
    }
    let is_known = |robot: &RobotId| ros2.shared.fleet.robot(robot).is_some();
    if stands
        && robots.iter().any(is_known)
        && let Some(earlier) = description::announced(&announced.path, announced.layout)
    {
        ros2.query_description(earlier);
    }
    for robot in robots {
        let topics = discovery.topics_of(&ros2.table(), &robot);
        tell(ros2, &mut discovery, &robot, topics);
    }
}

/// Assigns each announced topic to its robot again, after a change of the robots or their prefixes.
pub fn place_anew(ros2: &Ros2) {
    let mut discovery = lock(&ros2.shared.discovery);
    let table = ros2.table();
    discovery.place_all(&table);
    let known = discovery.told.keys().chain(discovery.of_robots.keys());
    let robots: BTreeSet<RobotId> = known.cloned().collect();
    let topics: Vec<_> = robots
        .into_iter()
        .map(|robot| {
            let topics = discovery.topics_of(&table, &robot);
            (robot, topics)
        })
        .collect();
    drop(table);
    let types = discovery.types();
    ros2.change_table(|table| table.set_announced(types));
    for (robot, topics) in topics {
        let home = topics.home.clone();
        tell(ros2, &mut discovery, &robot, topics);
        // One that was registered just now.
        if let Some((prefix, layout)) = home {
            ros2.announces(&robot);
            ros2.seen_at(&robot, &prefix, layout);
        }
    }
}

impl Discovery {
    /// Records a token of robots, or of none; without an announcement it is gone.
    fn note(&mut self, token: &str, announced: Option<Announcement>, robots: &[RobotId]) {
        let Some(announced) = announced else {
            self.tokens.remove(token);
            for robot in robots {
                if let Some(tokens) = self.of_robots.get_mut(robot) {
                    tokens.remove(token);
                    if tokens.is_empty() {
                        self.of_robots.remove(robot);
                    }
                }
            }
            return;
        };
        let is_full = |tokens: &BTreeSet<String>| {
            tokens.len() >= limits::ROS2_TOKENS_OF_ROBOT_MAX && !tokens.contains(token)
        };
        let mut of_robots = robots.iter().filter_map(|robot| self.of_robots.get(robot));
        if self.tokens.len() >= limits::ROS2_TOKENS_MAX || of_robots.any(is_full) {
            return;
        }
        self.tokens.insert(token.to_owned(), announced);
        for robot in robots {
            let tokens = self.of_robots.entry(robot.clone()).or_default();
            tokens.insert(token.to_owned());
        }
    }

    fn place_all(&mut self, table: &RouteTable) {
        self.of_robots.clear();
        for (token, announced) in &self.tokens {
            for placed in table.places(&announced.path, announced.layout) {
                let tokens = self.of_robots.entry(placed.robot).or_default();
                if tokens.len() < limits::ROS2_TOKENS_OF_ROBOT_MAX {
                    tokens.insert(token.clone());
                }
            }
        }
    }

    /// Returns the type that the present tokens of a robot's bridge name for a path.
    fn type_of(&self, path: &str, robot: Option<&RobotId>) -> Option<MessageType> {
        let tokens = self.of_robots.get(robot?)?.iter();
        let mut standing = tokens
            .filter_map(|token| self.tokens.get(token))
            .filter(|one| one.layout == KeyLayout::BridgeRos2dds && one.path == path);
        standing.find_map(|one| MessageType::of_ros_type(&one.type_name))
    }

    /// Returns the types of all paths that belong to a robot.
    fn types(&self) -> BTreeMap<String, MessageType> {
        let tokens = self.of_robots.values().flatten();
        tokens
            .filter_map(|token| self.tokens.get(token))
            .filter(|one| one.layout == KeyLayout::BridgeRos2dds)
            .filter_map(|one| Some((one.path.clone(), MessageType::of_ros_type(&one.type_name)?)))
            .collect()
    }

    fn topics_of(&self, table: &RouteTable, robot: &RobotId) -> Topics {
        let mut topics = Topics::default();
        let tokens = self.of_robots.get(robot).into_iter().flatten();
        for announced in tokens.filter_map(|token| self.tokens.get(token)) {
            let (path, layout) = (&announced.path, announced.layout);
            let places = table.places(path, layout).into_iter();
            let Some(placed) = places.into_iter().find(|placed| placed.robot == *robot) else {
                continue;
            };
            let of = MessageType::of_ros_type(&announced.type_name);
            let suits =
                |stream: &_| of.is_some_and(|of| MessageType::of_stream(*stream).contains(&of));
            let topic = AnnouncedTopic {
                topic: placed.topic.to_owned(),
                type_name: announced.type_name.clone(),
                layout: announced.layout,
                suited_for: STREAMS_OF_TOPICS.into_iter().filter(suits).collect(),
                blocked: table.is_blocked(&placed, path, layout),
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
}

/// Topics that a robot has announced.
#[derive(Debug, Default)]
struct Topics {
    all: BTreeSet<AnnouncedTopic>,
    /// Place of its suitable topics; `None` for a robot without any, which is not a vehicle.
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
        ros2.left(robot);
    } else {
        discovery.told.insert(robot.clone(), all.clone());
    }
    ros2.shared.fleet.set_topics(robot, all);
    if let Some((prefix, layout)) = topics.home
        && came
    {
        ros2.announces(robot);
        ros2.moved(robot, &prefix, layout);
        ros2.came(robot);
        for earlier in description::below(&prefix, layout) {
            ros2.query_description(earlier);
        }
    }
}
