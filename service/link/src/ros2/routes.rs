//! Routes of ROS 2 keys: the stream of each, and the keys to subscribe to. Pure.

use std::collections::{BTreeMap, BTreeSet};

use zenoh::key_expr::{KeyExpr, OwnedKeyExpr};

use fleetcal_domain::limits;
use fleetcal_domain::streams::{RobotStreams, Ros2Settings, TopicRole};
use fleetcal_model::Stream;
use fleetcal_proto::RobotId;
use fleetcal_proto::key::KeyRoot;
use fleetcal_proto::message_type::MessageType;
use fleetcal_proto::ros2_key::{
    KeyLayout, KeyTemplate, Matched, TopicKey, typed_expression, typed_expressions,
};

/// Robot, stream and type of a message by its key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Route<'k> {
    /// The robot.
    pub robot: RobotId,
    /// The stream.
    pub stream: Stream,
    /// The type, if the key or a token names it.
    pub message_type: Option<MessageType>,
    /// Prefix of the topic in the key.
    pub prefix: &'k str,
    /// Layout of the key.
    pub layout: KeyLayout,
    /// Key expression of the table by which alone the message is accepted, however many others
    /// match the key.
    pub expression: String,
}

/// A robot's topic, and the template that it was found by.
type Claim<'p, 't> = (Matched<'p>, Option<&'t KeyTemplate>);

/// Table of ROS 2 keys; see the module.
#[derive(Debug, Clone)]
pub struct RouteTable {
    settings: Ros2Settings,
    root: String,
    /// Topics of unregistered robots.
    usual: Vec<TopicRole>,
    /// Topics of registered robots.
    roles: BTreeMap<RobotId, Vec<TopicRole>>,
    /// Robots whose keys follow no template, by the prefix of their topics.
    prefixes: BTreeMap<String, BTreeSet<RobotId>>,
    /// Prefixes by robot.
    prefix_of: BTreeMap<RobotId, String>,
    /// Registered robots that have announced a topic since this process began.
    announcing: BTreeSet<RobotId>,
    /// Types that the bridge's tokens announced, by path.
    announced: BTreeMap<String, MessageType>,
    /// Wanted robots; `None` for all.
    heard: Option<BTreeSet<RobotId>>,
    /// Key expressions of the bridge's topics that the access list admits; `None` for a service
    /// without a list.
    admitted: Option<Vec<OwnedKeyExpr>>,
}

impl RouteTable {
    /// Makes the table of a fleet.
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
            admitted: None,
        };
        table.set_robots(robots);
        table
    }

    /// Sets the registered robots.
    pub fn set_robots(&mut self, robots: BTreeMap<RobotId, RobotStreams>) {
        self.roles.clear();
        self.prefixes.clear();
        self.prefix_of.clear();
        for (robot, streams) in robots {
            if let Some(prefix) = &streams.fields().prefix {
                let prefix = prefix.as_str().to_owned();
                let below = self.prefixes.entry(prefix.clone()).or_default();
                below.insert(robot.clone());
                self.prefix_of.insert(robot.clone(), prefix);
            }
            self.roles.insert(robot, streams.roles(&self.settings));
        }
        let roles = &self.roles;
        self.announcing.retain(|robot| roles.contains_key(robot));
    }

    /// Records that a robot has announced a topic; returns whether that makes more keys wanted.
    pub fn note_announcing(&mut self, robot: &RobotId) -> bool {
        self.knows(robot) && self.announcing.insert(robot.clone()) && self.heard.is_some()
    }

    /// Sets the wanted robots; `None` for all. Each of them then gets key expressions of its own,
    /// once it has announced a topic or if its configuration names one: a key expression for each
    /// topic and type of robots that are not on ROS 2 would cost Zenoh more than the robots do.
    pub fn set_heard(&mut self, heard: Option<BTreeSet<RobotId>>) {
        self.heard = heard;
    }

    /// Fixes the access list by the present table: topics that are configured later have to fit it.
    pub fn close_access_list(&mut self) {
        let admitted = self.bridge_expressions().into_iter();
        self.admitted = Some(admitted.filter_map(|text| text.try_into().ok()).collect());
    }

    /// True if the access list blocks a configured topic of a robot on a path.
    pub fn is_blocked(&self, matched: &Matched<'_>, path: &str, layout: KeyLayout) -> bool {
        let Some(admitted) = &self.admitted else {
            return false;
        };
        let is_of_bridge = layout == KeyLayout::BridgeRos2dds;
        let is_admitted = |key: &KeyExpr<'_>| admitted.iter().any(|one| one.includes(key));
        let key = KeyExpr::try_from(path);
        is_of_bridge && self.role(matched).is_some() && !key.is_ok_and(|key| is_admitted(&key))
    }

    /// Records the type that a bridge's token announces for a path; `None` once the token is gone.
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

    /// Sets the types of all paths that tokens of bridges announce.
    pub fn set_announced(&mut self, types: BTreeMap<String, MessageType>) {
        self.announced = types;
    }

    /// True if a robot is registered.
    pub fn knows(&self, robot: &RobotId) -> bool {
        self.roles.contains_key(robot)
    }

    /// True if a key has our own layout, which has its own subscriber.
    pub fn is_own(&self, key: &str) -> bool {
        key.starts_with(&self.root)
    }

    /// Returns the streams of a key: of each robot with a prefix above it, and of the robot that a
    /// template names, which has to be registered if there are others.
    pub fn routes<'k>(&self, key: &'k str) -> Vec<Route<'k>> {
        let key = TopicKey::parse(key);
        let claims = self.claims(key.path, key.layout).into_iter();
        let routes = claims.filter_map(|claim| self.route(&key, claim));
        routes.collect()
    }

    fn route<'k>(&self, key: &TopicKey<'k>, claim: Claim<'k, '_>) -> Option<Route<'k>> {
        let (matched, template) = claim;
        let role = self.role(&matched)?;
        let path = match template {
            None => format!("{}/{}", matched.prefix, matched.topic),
            Some(template) => {
                let is_usual = self.heard.is_none() && self.usual.contains(role);
                let own = (!is_usual).then_some(&matched.robot);
                template.path_expression(own, matched.topic)
            }
        };
        let (expression, message_type) = if let Some(type_name) = key.type_name {
            let suits = |of: &MessageType| MessageType::of_stream(role.stream).contains(of);
            let of = key.message_type().filter(suits)?;
            (typed_expression(&path, type_name), Some(of))
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

    /// Returns the robots and topics of a path: all robots that use it, else the nearest one.
    pub fn places<'p>(&self, path: &'p str, layout: KeyLayout) -> Vec<Matched<'p>> {
        let claims = self.claims(path, layout);
        if claims.is_empty() {
            return self.nearest(path, layout).into_iter().collect();
        }
        claims.into_iter().map(|(matched, _)| matched).collect()
    }

    /// Returns the robot of a path that is not a stream: of the robots at one place, the one with
    /// its name, else the first.
    pub fn nearest<'p>(&self, path: &'p str, layout: KeyLayout) -> Option<Matched<'p>> {
        if self.is_own(path) {
            return None;
        }
        let by_prefix = self.by_prefix(path).next();
        let mut by_template = self.by_template(path, layout).map(|(matched, _)| matched);
        let Some(by_prefix) = by_prefix else {
            return by_template.next();
        };
        let is_named_so = |of: &Matched<'_>| self.knows(&of.robot) && of.prefix == by_prefix.prefix;
        Some(by_template.find(is_named_so).unwrap_or(by_prefix))
    }

    /// Returns the robots that use a path, each with the template that matched; `None` for a robot
    /// with a prefix.
    fn claims<'p>(&self, path: &'p str, layout: KeyLayout) -> Vec<Claim<'p, '_>> {
        if self.is_own(path) {
            return Vec::new();
        }
        let takes = |matched: &Matched<'_>| self.role(matched).is_some();
        let by_prefix = self.by_prefix(path).filter(takes);
        let mut claims: Vec<Claim<'_, '_>> = by_prefix.map(|matched| (matched, None)).collect();
        let is_alone = claims.is_empty();
        let by_template = self
            .by_template(path, layout)
            .find(|(matched, _)| takes(matched) && (is_alone || self.knows(&matched.robot)));
        claims.extend(by_template.map(|(matched, template)| (matched, Some(template))));
        claims
    }

    /// Returns the robots that a template names. A robot with a prefix is found by that alone.
    fn by_template<'p>(
        &self,
        path: &'p str,
        layout: KeyLayout,
    ) -> impl Iterator<Item = (Matched<'p>, &KeyTemplate)> {
        let templates = match layout {
            KeyLayout::BridgeRos2dds => &self.settings.bridge,
            KeyLayout::RmwZenoh | KeyLayout::RmwZenohWithoutHash => &self.settings.rmw_zenoh,
        };
        templates
            .iter()
            .filter_map(|template| Some((template.matched(path)?, template)))
            .filter(|(matched, _)| self.prefix(&matched.robot).is_none())
    }

    /// Returns the robots with a prefix of a path, the longest prefix first: a short one, such as a
    /// domain, does not hide robots with a longer one below it.
    fn by_prefix<'p>(&self, path: &'p str) -> impl Iterator<Item = Matched<'p>> {
        let prefixes = path.rmatch_indices('/').filter_map(|(at, _)| {
            let (prefix, topic) = (path.get(..at)?, path.get(at + 1..)?);
            Some((prefix, topic, self.prefixes.get(prefix)?))
        });
        prefixes.flat_map(|(prefix, topic, robots)| {
            robots.iter().map(move |robot| Matched {
                robot: robot.clone(),
                prefix,
                topic,
            })
        })
    }

    /// Returns a robot's use of a topic, if any.
    fn role(&self, matched: &Matched<'_>) -> Option<&TopicRole> {
        let roles = self.roles.get(&matched.robot).unwrap_or(&self.usual);
        roles
            .iter()
            .find(|role| role.topic.as_str() == matched.topic)
    }

    /// Returns the key expressions of the wanted topics.
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

    /// Returns the key expressions of the usual topics of all robots.
    pub fn usual_expressions(&self) -> BTreeSet<String> {
        self.expressions_of(None, &self.usual)
    }

    /// Returns the key expressions of the registered robots' topics.
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

    /// Returns the key expressions that the bridge's topics may have: those known now, and those
    /// that the settings allow for later.
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

    /// Returns the key expressions of a topic of every robot behind a bridge.
    pub fn bridge_paths(&self, topic: &str) -> Vec<String> {
        let templates = self.settings.bridge.iter();
        let by_template = templates.map(|template| template.path_expression(None, topic));
        let prefixes = self.prefixes.keys();
        let by_prefix = prefixes.map(|prefix| format!("{prefix}/{topic}"));
        by_template.chain(by_prefix).collect()
    }

    /// Returns the settings.
    pub fn settings(&self) -> &Ros2Settings {
        &self.settings
    }

    fn expressions_of(&self, robot: Option<&RobotId>, roles: &[TopicRole]) -> BTreeSet<String> {
        let mut all = BTreeSet::new();
        for role in roles {
            let topic = role.topic.as_str();
            for template in &self.settings.rmw_zenoh {
                let path = template.path_expression(robot, topic);
                let types = MessageType::of_stream(role.stream).iter();
                all.extend(types.flat_map(|&of| typed_expressions(&path, of)));
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
        let types = MessageType::of_stream(role.stream).iter();
        all.extend(types.flat_map(|&of| typed_expressions(&path, of)));
        all.insert(path);
    }
    all
}

#[cfg(test)]
mod tests;
