//! A router's configuration with an access list per robot: each has its own keys and no others.
//!
//! Zenoh authenticates a connection, by certificate or password, and not a message. So who may use
//! a key is bound to the connection's name here: the common name of its certificate, or its user.
//! The list is read when the router starts; one more robot asks for a restart.

use std::collections::BTreeSet;
use std::path::PathBuf;

use fleetcal_domain::limits;
use fleetcal_proto::key::{Keys, StreamKind};
use fleetcal_proto::{RobotId, endpoint};
use serde_json::{Value, json};

use crate::access::{ANSWERED, FROM_ROBOTS, FROM_SERVICE, rule};
use crate::bounds;

/// Way in which a router identifies its peers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Identity {
    /// Common name of the certificate (mTLS).
    Certificate,
    /// User and password, from a file with `user:password` in each line.
    User {
        /// The file.
        passwords: PathBuf,
    },
}

/// A router's own certificate.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RouterCertificate {
    /// Its certificate, PEM.
    pub certificate: PathBuf,
    /// Its key, PEM.
    pub key: PathBuf,
    /// CA of the certificates of its peers, PEM.
    pub ca: Option<PathBuf>,
}

/// Settings of a router with a list per robot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StrictRouter {
    /// The keys under the configured root.
    pub keys: Keys,
    /// The robots; each connects under its id.
    pub robots: BTreeSet<RobotId>,
    /// Name under which the service connects to a router before it; `None` for the service's own
    /// router.
    pub service: Option<String>,
    /// Further key expressions on which a robot may publish, with `{robot}` for its id.
    pub streams: Vec<String>,
    /// Way in which peers are identified.
    pub identity: Identity,
    /// The router's certificate, for endpoints with TLS.
    pub certificate: Option<RouterCertificate>,
    /// Endpoints that it listens on.
    pub listen: Vec<String>,
    /// Names of the fleet's other routers in their certificates.
    pub routers: Vec<String>,
    /// Endpoints of these routers.
    pub connect: Vec<String>,
}

/// Silence after which a router before several instances drops a session, ms.
const LEASE_MS: u32 = 3_000;
/// Streams on which a robot sends seldom.
const SELDOM: [StreamKind; 4] = [
    StreamKind::Event,
    StreamKind::CalibrationApplied,
    StreamKind::RobotDescription,
    StreamKind::TfStatic,
];

/// True if a key expression with `{robot}` for the id has that as one whole chunk, so that a robot
/// cannot use the keys of another whose id begins as its own does.
pub fn is_robots_own(stream: &str) -> bool {
    let (own, others): (Vec<&str>, Vec<&str>) =
        stream.split('/').partition(|chunk| *chunk == "{robot}");
    own.len() == 1
        && !others.iter().any(|chunk| chunk.contains("{robot}"))
        && zenoh::key_expr::KeyExpr::try_from(stream.replace("{robot}", "robot")).is_ok()
}

/// Rewrites endpoints so that QUIC uses one stream.
fn in_order(endpoints: &[String]) -> Vec<String> {
    let endpoints = endpoints.iter();
    endpoints.map(|one| endpoint::in_order(one)).collect()
}

impl StrictRouter {
    /// Makes the whole configuration in Zenoh's form. The list denies whatever it does not name.
    pub fn configuration(&self) -> Value {
        let mut transport = bounds::transport();
        transport["unicast"]["max_sessions"] = json!(self.sessions_max());
        if let Some(tls) = &self.certificate {
            transport["link"]["tls"] = self.tls(tls);
        }
        if self.service.is_some() {
            transport["link"]["tx"] = json!({ "lease": LEASE_MS });
        }
        if let Identity::User { passwords } = &self.identity {
            transport["auth"] = json!({ "usrpwd": { "dictionary_file": passwords } });
        }
        json!({
            "mode": "router",
            "listen": { "endpoints": in_order(&self.listen) },
            // Each router tries until the other is there.
            "connect": {
                "endpoints": in_order(&self.connect), "timeout_ms": -1, "exit_on_failure": false,
            },
            "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false } },
            "transport": transport,
            "access_control": self.list(),
            "downsampling": self.limits_of_robots(),
        })
    }

    /// Returns the number of sessions that the names of the list need, each with its full share.
    fn sessions_max(&self) -> usize {
        let names = self.robots.len() + self.routers.len() + usize::from(self.service.is_some());
        let sessions = names.saturating_mul(limits::ZENOH_SESSIONS_PER_NAME_DEFAULT);
        sessions.min(limits::ZENOH_SESSIONS_MAX) + limits::ZENOH_SESSIONS_OPENING_MAX
    }

    /// Limits the rates of each robot's queries and of its rare streams: a session that sends these
    /// without end would keep the router from all others. The limits apply to each robot's keys,
    /// since the link between two routers is one session of many robots. A large fleet has no
    /// limits: Zenoh keeps all of them for each connection.
    fn limits_of_robots(&self) -> Vec<Value> {
        if self.robots.len() > limits::ROBOTS_LIMITED_MAX {
            return Vec::new();
        }
        [
            self.limit("query", &ANSWERED, limits::QUERIES_PER_S_MAX),
            self.limit("put", &SELDOM, limits::EVENTS_PER_S_MAX),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    /// Makes one rate limit; `None` without robots, because Zenoh refuses an empty list of rules.
    fn limit(&self, message: &str, kinds: &[StreamKind], per_s: f64) -> Option<Value> {
        let keys = self
            .robots
            .iter()
            .flat_map(|robot| kinds.iter().map(|&kind| self.keys.stream(robot, kind)));
        let rules: Vec<_> = keys
            .map(|key| json!({ "key_expr": key, "freq": per_s }))
            .collect();
        (!rules.is_empty()).then(|| {
            json!({
                "id": format!("{message} of robots"),
                "messages": [message],
                "flows": ["ingress"],
                "rules": rules,
            })
        })
    }

    fn tls(&self, tls: &RouterCertificate) -> Value {
        let mut settings = json!({
            "listen_certificate": tls.certificate,
            "listen_private_key": tls.key,
            "enable_mtls": self.identity == Identity::Certificate,
        });
        if let (Some(ca), Some(settings)) = (&tls.ca, settings.as_object_mut()) {
            settings.insert("root_ca_certificate".to_owned(), json!(ca));
        }
        if let (false, Some(settings)) = (self.connect.is_empty(), settings.as_object_mut()) {
            settings.insert("connect_certificate".to_owned(), json!(tls.certificate));
            settings.insert("connect_private_key".to_owned(), json!(tls.key));
        }
        settings
    }

    /// Makes the access list.
    fn list(&self) -> Value {
        let mut list = List::default();
        for robot in &self.robots {
            list.add(self.subject(robot.as_str()), &self.rules_of(robot));
        }
        if let Some(service) = &self.service {
            list.add(self.subject(service), &self.rules_of_service());
        }
        for router in &self.routers {
            list.add(self.subject(router), &self.rules_of_router(router));
        }
        json!({
            "enabled": true,
            "default_permission": "deny",
            "rules": list.rules,
            "subjects": list.subjects,
            "policies": list.policies,
        })
    }

    fn subject(&self, name: &str) -> Value {
        let property = match self.identity {
            Identity::Certificate => "cert_common_names",
            Identity::User { .. } => "usernames",
        };
        json!({ "id": name, property: [name] })
    }

    /// Makes the rules of one robot: publish its own streams, query and receive what is for it.
    fn rules_of(&self, robot: &RobotId) -> Vec<Value> {
        let of = |kinds: &[StreamKind]| -> Vec<String> {
            let own = |&kind| self.keys.stream(robot, kind);
            kinds.iter().map(own).collect()
        };
        let named = |what: &str| format!("{robot}: {what}");
        let mut streams = of(&FROM_ROBOTS);
        // Nothing on it is used; that a robot still puts to it raises an alert.
        streams.push(self.keys.former_wheel_odometry(robot));
        let further = self.streams.iter();
        streams.extend(further.map(|stream| stream.replace("{robot}", robot.as_str())));
        let alive = [self.keys.alive(robot)];
        let service = [self.keys.service_of_all()];
        let mut rules = vec![
            rule(&named("streams"), "ingress", &["put"], &streams),
            rule(&named("presence"), "ingress", &["liveliness_token"], &alive),
            rule(
                &named("answers wanted"),
                "ingress",
                &["query"],
                &of(&ANSWERED),
            ),
            rule(
                &named("results wanted"),
                "ingress",
                &["declare_subscriber"],
                &of(&FROM_SERVICE),
            ),
            rule(
                &named("service wanted"),
                "ingress",
                &["declare_liveliness_subscriber", "liveliness_query"],
                &service,
            ),
            rule(&named("results"), "egress", &["put"], &of(&FROM_SERVICE)),
            rule(&named("answers"), "egress", &["reply"], &of(&ANSWERED)),
            rule(
                &named("service"),
                "egress",
                &["liveliness_token", "reply"],
                &service,
            ),
        ];
        rules.extend(self.wanted(&named(""), "egress"));
        rules
    }

    /// Makes the rules for the service's declarations: they cover the whole fleet, since it
    /// declares once for all.
    fn wanted(&self, named: &str, flow: &str) -> [Value; 3] {
        let (streams, answered) = (self.streams_of_all(), self.of_all(&ANSWERED));
        let alive = [self.keys.alive_of_all()];
        [
            rule(
                &format!("{named}streams wanted"),
                flow,
                &["declare_subscriber"],
                &streams,
            ),
            rule(
                &format!("{named}answers offered"),
                flow,
                &["declare_queryable"],
                &answered,
            ),
            rule(
                &format!("{named}presence wanted"),
                flow,
                &["declare_liveliness_subscriber", "liveliness_query"],
                &alive,
            ),
        ]
    }

    /// Makes the rules of a service that connects to the router: receive from all robots and answer
    /// them.
    fn rules_of_service(&self) -> Vec<Value> {
        let (results, answered) = (self.of_all(&FROM_SERVICE), self.of_all(&ANSWERED));
        let service = [self.keys.service_of_all()];
        let named = |what: &str| format!("the service: {what}");
        let mut rules = vec![
            rule(&named("results"), "ingress", &["put"], &results),
            rule(&named("answers"), "ingress", &["reply"], &answered),
            rule(
                &named("presence"),
                "ingress",
                &["liveliness_token"],
                &service,
            ),
            rule(
                &named("streams"),
                "egress",
                &["put"],
                &self.streams_of_all(),
            ),
            rule(&named("questions"), "egress", &["query"], &answered),
            rule(
                &named("results wanted"),
                "egress",
                &["declare_subscriber"],
                &results,
            ),
            rule(
                &named("robots' presence"),
                "egress",
                &["liveliness_token", "reply"],
                &[self.keys.alive_of_all()],
            ),
            rule(
                &named("presence asked for"),
                "egress",
                &["declare_liveliness_subscriber", "liveliness_query"],
                &service,
            ),
        ];
        rules.extend(self.wanted(&named(""), "ingress"));
        rules.extend(self.rules_among_services());
        rules
    }

    /// Makes the rules for messages among several instances of a service.
    fn rules_among_services(&self) -> [Value; 4] {
        let (digests, tokens) = ([self.keys.digest_of_all()], [self.keys.service_of_all()]);
        let named = |what: &str| format!("the service: {what}");
        let told = ["put", "declare_subscriber"];
        [
            rule(&named("digests"), "ingress", &told, &digests),
            rule(&named("others' digests"), "egress", &told, &digests),
            rule(
                &named("others' presence asked for"),
                "ingress",
                &["declare_liveliness_subscriber", "liveliness_query"],
                &tokens,
            ),
            rule(
                &named("others' presence"),
                "egress",
                &["liveliness_token", "reply"],
                &tokens,
            ),
        ]
    }

    fn of_all(&self, kinds: &[StreamKind]) -> Vec<String> {
        let of_all = |&kind| self.keys.stream_of_all(kind);
        kinds.iter().map(of_all).collect()
    }

    fn streams_of_all(&self) -> Vec<String> {
        let mut streams = self.of_all(&FROM_ROBOTS);
        streams.push(self.keys.former_wheel_odometry_of_all());
        streams.push(self.keys.stream_of_all_kinds());
        let further = self.streams.iter();
        streams.extend(further.map(|stream| stream.replace("{robot}", "*")));
        streams
    }

    /// Makes the rules for another router of the fleet: everything under the root passes. The
    /// senders were checked at the router of entry.
    fn rules_of_router(&self, router: &str) -> [Value; 2] {
        const PASSED_ON: [&str; 9] = [
            "put",
            "delete",
            "query",
            "reply",
            "declare_subscriber",
            "declare_queryable",
            "liveliness_token",
            "liveliness_query",
            "declare_liveliness_subscriber",
        ];
        let mut keys = self.streams_of_all();
        keys.push(self.keys.everything());
        // `**` holds no chunk that begins with `@`.
        keys.push(self.keys.alive_of_all());
        keys.push(self.keys.service_of_all());
        keys.push(format!("{}/@digest/*", self.keys.root().as_str()));
        ["ingress", "egress"].map(|flow| {
            let named = format!("router {router}: {flow}");
            rule(&named, flow, &PASSED_ON, &keys)
        })
    }
}

/// An access list in the making.
#[derive(Debug, Default)]
struct List {
    rules: Vec<Value>,
    subjects: Vec<Value>,
    policies: Vec<Value>,
}

impl List {
    fn add(&mut self, subject: Value, rules: &[Value]) {
        let names: Vec<Value> = rules.iter().map(|rule| rule["id"].clone()).collect();
        let policy = json!({ "rules": names, "subjects": [subject["id"].clone()] });
        self.policies.push(policy);
        self.subjects.push(subject);
        self.rules.extend_from_slice(rules);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn router(robots: &[&str]) -> StrictRouter {
        let robots = robots.iter().map(|id| RobotId::parse(id).unwrap());
        StrictRouter {
            keys: Keys::default(),
            robots: robots.collect(),
            service: Some("fleetcal".to_owned()),
            streams: vec!["*/{robot}/scan/**".to_owned()],
            identity: Identity::Certificate,
            certificate: None,
            listen: vec!["tls/0.0.0.0:7447".to_owned()],
            routers: vec!["other.example.com".to_owned()],
            connect: vec!["tls/other.example.com:7447".to_owned()],
        }
    }

    /// Returns the key expressions on which a subject's policy lets it publish.
    fn may_put(list: &Value, subject: &str) -> Vec<String> {
        let policies = list["policies"].as_array().unwrap();
        let own = policies.iter().find(|p| p["subjects"] == json!([subject]));
        let names = own.unwrap()["rules"].as_array().unwrap();
        let rules = list["rules"].as_array().unwrap().iter();
        let puts = rules.filter(|rule| {
            names.contains(&rule["id"])
                && rule["flows"] == json!(["ingress"])
                && rule["messages"].as_array().unwrap().contains(&json!("put"))
        });
        let keys = puts.flat_map(|rule| rule["key_exprs"].as_array().unwrap());
        keys.map(|key| key.as_str().unwrap().to_owned()).collect()
    }

    #[test]
    fn a_robot_may_put_to_its_own_keys_and_the_service_to_no_stream() {
        let list = router(&["tugger_01", "tugger_02"]).list();
        let keys = may_put(&list, "tugger_01");
        assert!(keys.contains(&"fleet/tugger_01/wheel_odometry".to_owned()));
        assert!(keys.contains(&"fleet/tugger_01/drive".to_owned()));
        assert!(keys.contains(&"*/tugger_01/scan/**".to_owned()));
        assert!(
            keys.iter().all(|key| key.contains("/tugger_01/")),
            "{keys:?}"
        );
        assert!(!keys.iter().any(|key| key.contains("@digest")), "{keys:?}");
        let keys = may_put(&list, "fleetcal");
        assert!(keys.contains(&"fleet/*/estimate".to_owned()));
        assert!(keys.contains(&"fleet/@digest/*".to_owned()));
        assert!(
            !keys.contains(&"fleet/*/wheel_odometry".to_owned()),
            "{keys:?}"
        );
    }

    #[test]
    fn names_in_the_list_are_unique() {
        let list = router(&["a", "b", "c"]).list();
        for part in ["rules", "subjects"] {
            let entries = list[part].as_array().unwrap();
            let names: BTreeSet<&str> = entries.iter().filter_map(|e| e["id"].as_str()).collect();
            assert_eq!(names.len(), entries.len(), "{part}");
        }
    }

    #[test]
    fn a_router_opens_as_many_sessions_as_its_names_need() {
        let sessions = |robots: usize| {
            let ids: Vec<_> = (0..robots)
                .map(|number| format!("robot_{number}"))
                .collect();
            let ids: Vec<_> = ids.iter().map(String::as_str).collect();
            router(&ids).configuration()["transport"]["unicast"]["max_sessions"].clone()
        };
        // Two robots, the service and the other router.
        assert_eq!(sessions(2), json!(4 * 16 + 256));
        assert_eq!(sessions(1_000), json!(4_352));
    }

    #[test]
    fn zenoh_accepts_the_whole_configuration() {
        let mut router = router(&["a", "b"]);
        router.certificate = Some(RouterCertificate {
            certificate: "router.pem".into(),
            key: "router.key.pem".into(),
            ca: Some("ca.pem".into()),
        });
        let written = router.configuration().to_string();
        zenoh::Config::from_json5(&written).unwrap();
        for part in ["connect_certificate", "tls/other.example.com:7447", "3000"] {
            assert!(written.contains(part), "{part}");
        }
        router.identity = Identity::User {
            passwords: "passwords.txt".into(),
        };
        let written = router.configuration().to_string();
        zenoh::Config::from_json5(&written).unwrap();
        assert!(written.contains("passwords.txt") && written.contains("usernames"));
    }

    #[test]
    fn how_often_robots_ask_and_tell_is_limited_while_they_are_not_too_many() {
        let limits_of = |robots: usize| {
            let ids: Vec<_> = (0..robots)
                .map(|number| format!("robot_{number}"))
                .collect();
            let ids: Vec<_> = ids.iter().map(String::as_str).collect();
            let configuration = router(&ids).configuration();
            configuration["downsampling"].as_array().unwrap().clone()
        };
        let [queries, puts] = limits_of(2).try_into().unwrap();
        let keys = |limit: &Value| {
            let rules = limit["rules"].as_array().unwrap().clone();
            let keys = rules
                .iter()
                .map(|rule| rule["key_expr"].as_str().unwrap().to_owned());
            keys.collect::<Vec<_>>()
        };
        assert_eq!(queries["messages"], json!(["query"]));
        assert_eq!(keys(&queries).len(), 6);
        assert_eq!(puts["messages"], json!(["put"]));
        assert_eq!(
            keys(&puts)[..2],
            ["fleet/robot_0/event", "fleet/robot_0/calibration/applied"]
        );
        assert_eq!(limits_of(limits::ROBOTS_LIMITED_MAX).len(), 2);
        assert!(limits_of(limits::ROBOTS_LIMITED_MAX + 1).is_empty());
        assert!(limits_of(0).is_empty());
    }
}
