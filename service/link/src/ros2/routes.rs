//! Whose stream a ROS 2 key is, and which keys to subscribe to. Pure.

use std::collections::{BTreeMap, BTreeSet};

use fleetcal_domain::limits;
use fleetcal_domain::streams::{RobotStreams, Ros2Settings, TopicRole, message_types};
use fleetcal_model::Stream;
use fleetcal_proto::RobotId;
use fleetcal_proto::key::KeyRoot;
use fleetcal_proto::message_type::MessageType;
use fleetcal_proto::ros2_key::{KeyLayout, KeyTemplate, Matched, TopicKey, typed_expression};

/// What a message's key says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Route<'k> {
    /// Whose it is.
    pub robot: RobotId,
    /// Which of its streams.
    pub stream: Stream,
    /// What it is, where the key or a token says so.
    pub message_type: Option<MessageType>,
    /// What stands before the topic in the key.
    pub prefix: &'k str,
    /// Which layout the key has.
    pub layout: KeyLayout,
    /// The one key expression of the table that it is taken by, however many others match the key.
    pub expression: String,
}

/// See the module.
#[derive(Debug, Clone)]
pub struct RouteTable {
    settings: Ros2Settings,
    root: String,
    /// Topics of robots that nobody has configured.
    usual: Vec<TopicRole>,
    /// Topics of robots that are configured.
    roles: BTreeMap<RobotId, Vec<TopicRole>>,
    /// Robots whose keys follow no template, by what stands before their topics.
    prefixes: BTreeMap<String, RobotId>,
    /// The same by robot.
    prefix_of: BTreeMap<RobotId, String>,
    /// Configured robots that have announced a topic since this process began.
    announcing: BTreeSet<RobotId>,
    /// Types that tokens of the bridge announced, by path.
    announced: BTreeMap<String, MessageType>,
    /// The robots to hear; `None` for all.
    heard: Option<BTreeSet<RobotId>>,
}

impl RouteTable {
    /// The table of a fleet.
    pub fn new(
        settings: &Ros2Settings,
        root: &KeyRoot,
        robots: BTreeMap<RobotId, RobotStreams>,
    ) -> Self {
        let mut table = Self {
            settings: settings.clone(),
            root: format!("{}/", root.as_str()),
            usual: RobotStreams::default().roles(settings),
            roles: BTreeMap::new(),
            prefixes: BTreeMap::new(),
            prefix_of: BTreeMap::new(),
            announcing: BTreeSet::new(),
            announced: BTreeMap::new(),
            heard: None,
        };
        table.set_robots(robots);
        table
    }

    /// Takes the robots that are configured.
    pub fn set_robots(&mut self, robots: BTreeMap<RobotId, RobotStreams>) {
        self.roles.clear();
        self.prefixes.clear();
        self.prefix_of.clear();
        for (robot, streams) in robots {
            if let Some(prefix) = &streams.fields().prefix {
                let prefix = prefix.as_str().to_owned();
                self.prefixes.insert(prefix.clone(), robot.clone());
                self.prefix_of.insert(robot.clone(), prefix);
            }
            self.roles.insert(robot, streams.roles(&self.settings));
        }
        let roles = &self.roles;
        self.announcing.retain(|robot| roles.contains_key(robot));
    }

    /// Takes that a robot has announced a topic; whether more is to be heard by that.
    pub fn note_announcing(&mut self, robot: &RobotId) -> bool {
        self.knows(robot) && self.announcing.insert(robot.clone()) && self.heard.is_some()
    }

    /// Takes which robots to hear; `None` for all. Each of them has its own key expressions then, once
    /// it has announced a topic or when its configuration names one: one key expression for each
    /// topic and type of robots that are not on ROS 2 would cost Zenoh more than the robots do.
    pub fn set_heard(&mut self, heard: Option<BTreeSet<RobotId>>) {
        self.heard = heard;
    }

    /// Takes what a token of the bridge says about a path; `None` once it is gone.
    pub fn announce(&mut self, path: &str, message_type: Option<MessageType>) {
        match message_type {
            Some(message_type) if self.announced.len() < limits::ROS2_TOKENS_MAX => {
                self.announced.insert(path.to_owned(), message_type);
            }
            Some(_) => {}
            None => {
                self.announced.remove(path);
            }
        }
    }

    /// Takes the types of all paths that tokens of bridges announce.
    pub fn set_announced(&mut self, types: BTreeMap<String, MessageType>) {
        self.announced = types;
    }

    /// Whether a robot is configured.
    pub fn knows(&self, robot: &RobotId) -> bool {
        self.roles.contains_key(robot)
    }

    /// Whether a key is one of our own layout, which has its own subscriber.
    pub fn is_own(&self, key: &str) -> bool {
        key.starts_with(&self.root)
    }

    /// Whose stream a key is; `None` when it is nobody's.
    pub fn route<'k>(&self, key: &'k str) -> Option<Route<'k>> {
        let key = TopicKey::parse(key);
        let (matched, template) = self.find(key.path, key.layout)?;
        let role = self.role(&matched)?;
        let path = match template {
            None => format!("{}/{}", matched.prefix, matched.topic),
            Some(template) => {
                let is_usual = self.heard.is_none() && self.usual.contains(role);
                let own = (!is_usual).then_some(&matched.robot);
                template.path_expression(own, matched.topic)
            }
        };
        let (expression, message_type) = if key.type_name.is_some() {
            let suits = |of: &MessageType| message_types(role.stream).contains(of);
            let of = key.message_type().filter(suits)?;
            (typed_expression(&path, of), Some(of))
        } else {
            (path, self.announced.get(key.path).copied())
        };
        Some(Route {
            stream: role.stream,
            robot: matched.robot,
            message_type,
            prefix: matched.prefix,
            layout: key.layout,
            expression,
        })
    }

    /// Robot and topic of a path.
    pub fn place<'p>(&self, path: &'p str, layout: KeyLayout) -> Option<Matched<'p>> {
        self.find(path, layout).map(|(matched, _)| matched)
    }

    /// The same, with the template that it was found by; `None` of one that has a prefix.
    fn find<'p>(
        &self,
        path: &'p str,
        layout: KeyLayout,
    ) -> Option<(Matched<'p>, Option<&KeyTemplate>)> {
        if self.is_own(path) {
            return None;
        }
        let templates = match layout {
            KeyLayout::BridgeRos2dds => &self.settings.bridge,
            KeyLayout::RmwZenoh | KeyLayout::RmwZenohWithoutHash => &self.settings.rmw_zenoh,
        };
        let by_template = templates
            .iter()
            .filter_map(|template| Some((template.matched(path)?, Some(template))));
        // One that has a prefix is found by that alone.
        let by_template = by_template.filter(|(matched, _)| self.prefix(&matched.robot).is_none());
        let by_prefix = self.by_prefix(path).map(|matched| (matched, None));
        let mut first = None;
        for found in by_prefix.chain(by_template) {
            if self.role(&found.0).is_some() {
                return Some(found);
            }
            first = first.or(Some(found));
        }
        first
    }

    /// Robots of whose prefixes a path begins with one, the longest first: a short one, such as a
    /// domain, does not hide robots that have theirs below it.
    fn by_prefix<'p>(&self, path: &'p str) -> impl Iterator<Item = Matched<'p>> {
        path.rmatch_indices('/').filter_map(|(at, _)| {
            let (prefix, topic) = (path.get(..at)?, path.get(at + 1..)?);
            let robot = self.prefixes.get(prefix)?.clone();
            Some(Matched {
                robot,
                prefix,
                topic,
            })
        })
    }

    /// What a robot takes from a topic, if anything.
    fn role(&self, matched: &Matched<'_>) -> Option<&TopicRole> {
        let roles = self.roles.get(&matched.robot).unwrap_or(&self.usual);
        roles
            .iter()
            .find(|role| role.topic.as_str() == matched.topic)
    }

    /// Key expressions of what is to be heard.
    pub fn wanted_expressions(&self) -> BTreeSet<String> {
        let Some(heard) = &self.heard else {
            let mut all = self.usual_expressions();
            all.extend(self.robot_expressions());
            return all;
        };
        let of_robot = |robot| {
            let roles = self.roles.get(robot).unwrap_or(&self.usual);
            let is_configured = *roles != self.usual || self.prefix(robot).is_some();
            let is_on_ros2 = is_configured || self.announcing.contains(robot);
            is_on_ros2.then(|| self.expressions_of_robot(robot, roles))
        };
        heard.iter().filter_map(of_robot).flatten().collect()
    }

    /// Key expressions of the usual topics of all robots.
    pub fn usual_expressions(&self) -> BTreeSet<String> {
        self.expressions_of(None, &self.usual)
    }

    /// Key expressions of the topics of the robots that are configured.
    pub fn robot_expressions(&self) -> BTreeSet<String> {
        let of_robot = |(robot, roles): (&RobotId, &Vec<TopicRole>)| {
            let other = |role: &&TopicRole| !self.usual.contains(role);
            if self.prefix(robot).is_some() {
                return self.expressions_of_robot(robot, roles);
            }
            let others: Vec<TopicRole> = roles.iter().filter(other).cloned().collect();
            self.expressions_of_robot(robot, &others)
        };
        self.roles.iter().flat_map(of_robot).collect()
    }

    fn prefix(&self, robot: &RobotId) -> Option<&str> {
        self.prefix_of.get(robot).map(String::as_str)
    }

    fn expressions_of_robot(&self, robot: &RobotId, roles: &[TopicRole]) -> BTreeSet<String> {
        match self.prefix(robot) {
            Some(prefix) => expressions_under(prefix, roles),
            None => self.expressions_of(Some(robot), roles),
        }
    }

    /// Key expressions that the bridge's topics may have: what is known now, and what the settings
    /// allow for later.
    pub fn bridge_expressions(&self) -> BTreeSet<String> {
        let untyped = |text: &String| TopicKey::parse(text).type_name.is_none();
        let mut all: BTreeSet<String> = self.usual_expressions();
        all.extend(self.robot_expressions());
        all.retain(untyped);
        for template in &self.settings.bridge {
            let topics = self.settings.bridge_topics.iter();
            all.extend(topics.map(|topic| template.path_expression(None, topic.as_str())));
        }
        all
    }

    /// Key expressions of a topic of every robot behind a bridge.
    pub fn bridge_paths(&self, topic: &str) -> Vec<String> {
        let templates = self.settings.bridge.iter();
        let by_template = templates.map(|template| template.path_expression(None, topic));
        let prefixes = self.prefixes.keys();
        let by_prefix = prefixes.map(|prefix| format!("{prefix}/{topic}"));
        by_template.chain(by_prefix).collect()
    }

    /// The settings.
    pub fn settings(&self) -> &Ros2Settings {
        &self.settings
    }

    fn expressions_of(&self, robot: Option<&RobotId>, roles: &[TopicRole]) -> BTreeSet<String> {
        let mut all = BTreeSet::new();
        for role in roles {
            let topic = role.topic.as_str();
            for template in &self.settings.rmw_zenoh {
                let path = template.path_expression(robot, topic);
                let types = message_types(role.stream).iter();
                all.extend(types.map(|&of| typed_expression(&path, of)));
            }
            let bridge = self.settings.bridge.iter();
            all.extend(bridge.map(|template| template.path_expression(robot, topic)));
        }
        all
    }
}

fn expressions_under(prefix: &str, roles: &[TopicRole]) -> BTreeSet<String> {
    let mut all = BTreeSet::new();
    for role in roles {
        let path = format!("{prefix}/{}", role.topic.as_str());
        let types = message_types(role.stream).iter();
        all.extend(types.map(|&of| typed_expression(&path, of)));
        all.insert(path);
    }
    all
}

#[cfg(test)]
mod tests {
    use zenoh::key_expr::KeyExpr;

    use super::*;

    fn table(robots: &[(&str, &str)]) -> RouteTable {
        let robots = robots.iter().map(|(id, streams)| {
            let streams: RobotStreams = toml::from_str(streams).unwrap();
            (RobotId::parse(id).unwrap(), streams)
        });
        RouteTable::new(
            &Ros2Settings::default(),
            &KeyRoot::default(),
            robots.collect(),
        )
    }

    const SCAN: &str = "sensor_msgs::msg::dds_::LaserScan_";

    fn routed(table: &RouteTable, key: &str) -> Option<(String, Stream)> {
        let route = table.route(key)?;
        Some((route.robot.as_str().to_owned(), route.stream))
    }

    #[test]
    fn a_robot_that_nobody_knows_has_the_usual_topics() {
        let table = table(&[]);
        for key in [
            format!("0/tugger_01/scan/{SCAN}/RIHS01_64c1"),
            format!("7/tugger_01/scan/{SCAN}/TypeHashNotSupported"),
            "tugger_01/scan".to_owned(),
        ] {
            let wanted = Some(("tugger_01".to_owned(), Stream::Scan));
            assert_eq!(routed(&table, &key), wanted, "{key}");
        }
        for key in [
            "fleet/tugger_01/scan",
            "tugger_01/camera",
            "0/tugger_01/x/scan",
        ] {
            assert_eq!(routed(&table, key), None, "{key}");
        }
    }

    #[test]
    fn a_configured_robot_has_its_own_topics_and_prefix() {
        let table = table(&[
            ("tugger_01", "scan = { topic = 'front/scan' }"),
            ("tugger_02", "prefix = '7'\nscan = { topic = 'lidar/scan' }"),
        ]);
        let key = format!("0/tugger_01/front/scan/{SCAN}/RIHS01_64c1");
        let route = table.route(&key).unwrap();
        assert_eq!(route.prefix, "0/tugger_01");
        assert_eq!(route.message_type, Some(MessageType::LaserScan));
        assert_eq!(routed(&table, "tugger_01/scan"), None, "not its topic");
        for key in [
            format!("7/lidar/scan/{SCAN}/RIHS01_64c1"),
            "7/lidar/scan".to_owned(),
        ] {
            let wanted = Some(("tugger_02".to_owned(), Stream::Scan));
            assert_eq!(routed(&table, &key), wanted, "{key}");
        }
        let expressions = table.robot_expressions();
        assert!(expressions.contains(&format!("*/tugger_01/front/scan/{SCAN}/*")));
        assert!(expressions.contains("tugger_01/front/scan"));
        assert!(expressions.contains("7/wheel_odometry"));
        assert!(
            !expressions
                .iter()
                .any(|text| text.ends_with("tugger_01/wheel_odometry"))
        );
    }

    #[test]
    fn a_short_prefix_hides_nobody_behind_it() {
        let table = table(&[
            ("lone", "prefix = '0'"),
            ("site_cart", "prefix = '0/site/b'"),
            ("tugger_01", ""),
        ]);
        for (key, robot) in [
            (format!("0/scan/{SCAN}/RIHS01_64c1"), "lone"),
            (format!("0/tugger_01/scan/{SCAN}/RIHS01_64c1"), "tugger_01"),
            (format!("0/stranger/scan/{SCAN}/RIHS01_64c1"), "stranger"),
            (format!("0/site/b/scan/{SCAN}/RIHS01_64c1"), "site_cart"),
        ] {
            let wanted = Some((robot.to_owned(), Stream::Scan));
            assert_eq!(routed(&table, &key), wanted, "{key}");
        }
        let own = format!("0/lone/scan/{SCAN}/RIHS01_64c1");
        assert_eq!(routed(&table, &own), None, "it has a prefix");
    }

    #[test]
    fn each_key_is_taken_by_one_expression_of_the_table() {
        let settings: Ros2Settings = toml::from_str(
            "rmw_zenoh = ['{domain}/{robot}/{topic}', '{robot}/{topic}', '{robot}/{domain}/{topic}']",
        )
        .unwrap();
        let robots = [
            ("left", "scan = { topic = 'front/scan' }"),
            // By its domain: the key is also one that the robot before it may have.
            ("7", "scan = { topic = 'left/front/scan' }"),
            // Its prefix lies below that domain.
            ("cart", "prefix = '7/left'\nscan = { topic = 'rear/scan' }"),
            (
                "9",
                "scan = { topic = 'scan' }
wheel_odometry = { topic = '3/wheel_odometry' }",
            ),
        ];
        let robots = robots.map(|(id, streams)| {
            let streams: RobotStreams = toml::from_str(streams).unwrap();
            (RobotId::parse(id).unwrap(), streams)
        });
        let table = RouteTable::new(&settings, &KeyRoot::default(), robots.into());
        let mut all = table.usual_expressions();
        all.extend(table.robot_expressions());
        let drive = "ackermann_msgs::msg::dds_::AckermannDriveStamped_";
        let mut matched_by_many = 0;
        for (path, of, robot) in [
            ("7/left/front/scan", SCAN, "left"),
            ("8/left/front/scan", SCAN, "left"),
            ("7/left/rear/scan", SCAN, "cart"),
            ("7/left/wheel_odometry", drive, "cart"),
            ("7/9/scan", SCAN, "9"),
            ("9/7/scan", SCAN, "9"),
            ("9/3/wheel_odometry", drive, "3"),
            ("9/scan", SCAN, "9"),
            ("stranger/4/scan", SCAN, "stranger"),
        ] {
            let key = format!("{path}/{of}/RIHS01_64c1");
            let Some(route) = table.route(&key) else {
                panic!("{key} is nobody's");
            };
            assert_eq!(route.robot.as_str(), robot, "{key}");
            assert!(all.contains(&route.expression), "{}", route.expression);
            let key = KeyExpr::try_from(key.as_str()).unwrap();
            let includes =
                |text: &&String| KeyExpr::try_from(text.as_str()).unwrap().includes(&key);
            assert!(includes(&&route.expression), "{}", route.expression);
            matched_by_many += usize::from(all.iter().filter(includes).count() > 1);
        }
        assert!(matched_by_many >= 2, "{matched_by_many}");
        // Of a type that its robot does not take there.
        assert!(
            table
                .route(&format!("7/left/front/scan/{drive}/RIHS01_64c1"))
                .is_none()
        );
    }

    #[test]
    fn of_several_instances_each_hears_the_topics_of_its_robots() {
        let mut table = table(&[
            ("tugger_01", ""),
            ("tugger_02", "prefix = '7'"),
            ("tugger_03", ""),
        ]);
        let heard = ["tugger_01", "tugger_02"].map(|id| RobotId::parse(id).unwrap());
        table.set_heard(Some(heard.clone().into()));
        let of_tugger_01 = |text: &String| text.contains("tugger_01");
        assert!(!table.wanted_expressions().iter().any(of_tugger_01));
        assert!(table.note_announcing(&heard[0]));
        assert!(!table.note_announcing(&heard[0]), "for the second time");
        let wanted = table.wanted_expressions();
        let is_heard = |key: &str| {
            let key = KeyExpr::try_from(key).unwrap();
            let mut wanted = wanted.iter();
            wanted.any(|text| KeyExpr::try_from(text.as_str()).unwrap().includes(&key))
        };
        for (key, wanted) in [
            (format!("0/tugger_01/scan/{SCAN}/RIHS01_64c1"), true),
            ("tugger_01/scan".to_owned(), true),
            (format!("7/scan/{SCAN}/RIHS01_64c1"), true),
            (format!("0/tugger_03/scan/{SCAN}/RIHS01_64c1"), false),
            ("tugger_03/scan".to_owned(), false),
        ] {
            assert_eq!(is_heard(&key), wanted, "{key}");
            let expression = table.route(&key).unwrap().expression;
            assert_eq!(
                table.wanted_expressions().contains(&expression),
                wanted,
                "{key}"
            );
        }
        table.set_heard(Some(BTreeSet::new()));
        assert!(table.wanted_expressions().is_empty());
    }

    #[test]
    fn a_token_says_what_a_key_of_the_bridge_does_not() {
        let mut table = table(&[]);
        let of = |table: &RouteTable| table.route("tugger_01/scan").unwrap().message_type;
        assert_eq!(of(&table), None);
        table.announce("tugger_01/scan", Some(MessageType::PointCloud2));
        assert_eq!(of(&table), Some(MessageType::PointCloud2));
        table.announce("tugger_01/scan", None);
        assert_eq!(of(&table), None);
    }

    #[test]
    fn every_expression_of_the_usual_topics_holds_a_type_or_is_the_bridges() {
        let table = table(&[]);
        let usual = table.usual_expressions();
        assert!(usual.contains(&format!("*/*/scan/{SCAN}/*")), "{usual:?}");
        assert!(usual.contains("*/wheel_odometry"));
        let bridge: Vec<String> = table.bridge_expressions().into_iter().collect();
        assert_eq!(bridge, ["*/lidar_odometry", "*/scan", "*/wheel_odometry"]);
    }
}
