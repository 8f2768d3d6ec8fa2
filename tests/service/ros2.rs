//! Robots that speak ROS 2 and run none of our software, in each layout of keys.

use std::path::Path;
use std::time::Duration;

use fleetcal_proto::calibration::{CalibrationDocument, Envelope};
use fleetcal_proto::encoding::MessageType;
use fleetcal_proto::progress::Progress;
use fleetcal_proto::ros::{AckermannDriveStamped, JointState, Odometry, RosMessage, StringMessage};
use fleetcal_proto::ros2_key::{Attachment, NO_HASH};
use fleetcal_robot::recording::Recording;
use fleetcal_robot::replay::Window;
use fleetcal_tests::service::{Service, wait_for};
use serde_json::Value;
use tempfile::TempDir;
use tokio::sync::mpsc;
use zenoh::qos::CongestionControl;

use super::hostile::client;
use super::{assert_same, calibrated, recorded, send, sender};

/// Pause between two looks at how far the service is.
const LOOK_EVERY: Duration = Duration::from_millis(2);

/// The hash of a type as it stands in keys; any text does.
const HASH: &str = "RIHS01_64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828";

/// How a robot's topics are named.
#[derive(Debug, Clone, Copy)]
enum Layout {
    /// `rmw_zenoh` with this hash.
    Rmw(&'static str),
    Bridge,
}

/// What a robot publishes.
#[derive(Debug, Clone, Copy)]
struct Topics {
    /// Before the topic in keys.
    prefix: &'static str,
    drive: &'static str,
    scan: &'static str,
    layout: Layout,
    /// Steering as joints on `drive`, and the speed as odometry on `odom`.
    apart: bool,
    /// Attachments as builds before 2025 wrote them.
    old_attachments: bool,
}

impl Topics {
    fn key(&self, topic: &str, of: MessageType) -> String {
        let path = format!("{}/{topic}", self.prefix);
        match self.layout {
            Layout::Rmw(hash) => format!("{path}/{}/{hash}", of.dds_type()),
            Layout::Bridge => path,
        }
    }

    /// The token that announces a publisher of the robot.
    fn token(&self, topic: &str, of: MessageType) -> String {
        let path = format!("{}/{topic}", self.prefix);
        match self.layout {
            Layout::Rmw(hash) => {
                let (domain, name) = path.split_once('/').unwrap();
                let (name, of) = (name.replace('/', "%"), of.dds_type());
                format!(
                    "@ros2_lv/{domain}/aa/1/{}/MP/%/%/node/%{name}/{of}/{hash}/::,10:,:,:,,",
                    name.len()
                )
            }
            Layout::Bridge => {
                let (path, of) = (path.replace('/', "\u{a7}"), of.ros_type());
                let of = of.replace('/', "\u{a7}");
                format!("@/aa/@ros2_lv/MP/{path}/{of}/:1:2:1,10")
            }
        }
    }

    fn drive_type(&self) -> MessageType {
        if self.apart {
            MessageType::JointState
        } else {
            MessageType::AckermannDriveStamped
        }
    }
}

fn attachment(sequence: i64, old: bool) -> Vec<u8> {
    let today = Attachment {
        sequence,
        source_ns: 1_700_000_000_000_000_000,
        gid: [7; 16],
    };
    if !old {
        return today.to_bytes();
    }
    // Each field behind its name.
    let bytes = today.to_bytes();
    let fields = [
        ("sequence_number", &bytes[..8]),
        ("source_timestamp", &bytes[8..16]),
        ("source_gid", &bytes[16..]),
    ];
    let mut named = Vec::new();
    for (name, field) in fields {
        named.push(name.len() as u8);
        named.extend(name.as_bytes());
        named.extend(field);
    }
    named
}

/// A robot on its own session.
struct RosRobot {
    session: zenoh::Session,
    tokens: Vec<zenoh::liveliness::LivelinessToken>,
    topics: Topics,
    id: &'static str,
    sequence: i64,
    window: Window,
}

impl RosRobot {
    async fn start(service: &Service, id: &'static str, topics: Topics) -> Self {
        let session = client(service).await;
        let mut robot = Self {
            session,
            tokens: Vec::new(),
            topics,
            id,
            sequence: 0,
            window: Window::new(None),
        };
        robot.announce(topics.drive, topics.drive_type()).await;
        if topics.apart {
            robot.announce("odom", MessageType::Odometry).await;
        }
        robot.announce(topics.scan, MessageType::LaserScan).await;
        robot
    }

    async fn announce(&mut self, topic: &str, of: MessageType) {
        let token = self.topics.token(topic, of);
        let declared = self.session.liveliness().declare_token(token).await;
        self.tokens.push(declared.unwrap());
    }

    /// Publishes all of a recording as fast as the service works.
    async fn publish(&mut self, path: &Path) -> u64 {
        let recording = Recording::open(path).unwrap();
        let names = ["/tugger_01/drive", "/tugger_01/scan"];
        for message in recording.messages(&names).unwrap() {
            let message = message.unwrap();
            if *message.topic == *names[1] {
                let (topic, of) = (self.topics.scan, MessageType::LaserScan);
                self.put(topic, of, message.payload).await;
            } else if self.topics.apart {
                let drive = AckermannDriveStamped::from_cdr(&message.payload).unwrap();
                let (joints, odometry) = apart(&drive);
                let drive = self.topics.drive;
                self.put(drive, MessageType::JointState, joints.to_cdr())
                    .await;
                self.put("odom", MessageType::Odometry, odometry.to_cdr())
                    .await;
            } else {
                let (topic, of) = (self.topics.drive, MessageType::AckermannDriveStamped);
                self.put(topic, of, message.payload).await;
            }
        }
        while !self.window.is_done() {
            self.look().await;
        }
        self.window.sent()
    }

    async fn put(&mut self, topic: &str, of: MessageType, payload: Vec<u8>) {
        let is_drive = of != MessageType::LaserScan;
        while !self.window.has_room(is_drive) {
            self.look().await;
        }
        let put = self
            .session
            .put(self.topics.key(topic, of), payload)
            .congestion_control(CongestionControl::Block);
        match self.topics.layout {
            Layout::Rmw(_) => {
                let old = self.topics.old_attachments;
                put.attachment(attachment(self.sequence, old)).await
            }
            Layout::Bridge => put.await,
        }
        .unwrap();
        self.sequence += 1;
        self.window.count_sent(is_drive);
    }

    async fn look(&mut self) {
        tokio::time::sleep(LOOK_EVERY).await;
        let key = format!("fleet/{}/progress", self.id);
        let replies = self.session.get(key).await.unwrap();
        if let Ok(reply) = replies.recv_async().await
            && let Ok(sample) = reply.result()
        {
            let said: Progress = serde_json::from_slice(&sample.payload().to_bytes()).unwrap();
            self.window.report(said);
        }
    }

    async fn stop(self) {
        for token in self.tokens {
            token.undeclare().await.unwrap();
        }
        self.session.close().await.unwrap();
    }
}

/// Steering as the position of a joint that is geared down, and the speed as odometry.
fn apart(drive: &AckermannDriveStamped) -> (JointState, Odometry) {
    let joints = JointState {
        header: drive.header.clone(),
        name: vec!["lift".to_owned(), "steer".to_owned()],
        position: vec![0.1, 2.0 * f64::from(drive.drive.steering_angle)],
        velocity: Vec::new(),
        effort: Vec::new(),
    };
    let mut odometry = Odometry {
        header: drive.header.clone(),
        ..Odometry::default()
    };
    odometry.twist.twist.linear.x = f64::from(drive.drive.speed);
    (joints, odometry)
}

const JAZZY: Topics = Topics {
    prefix: "0/jazzy_01",
    drive: "drive",
    scan: "front/scan",
    layout: Layout::Rmw(HASH),
    apart: false,
    old_attachments: false,
};
const HUMBLE: Topics = Topics {
    prefix: "7/humble_01",
    drive: "drive",
    scan: "scan",
    layout: Layout::Rmw(NO_HASH),
    apart: false,
    old_attachments: true,
};
const BRIDGE: Topics = Topics {
    prefix: "bridge_01",
    drive: "ackermann",
    scan: "scan",
    layout: Layout::Bridge,
    apart: false,
    old_attachments: false,
};
const JOINTS: Topics = Topics {
    prefix: "0/joints_01",
    drive: "joint_states",
    scan: "scan",
    layout: Layout::Rmw(HASH),
    apart: true,
    old_attachments: false,
};

const VEHICLE: &str = r#""model": "bicycle", "wheelbase_m": 1.2"#;

fn config() -> String {
    let entry = |id: &str, more: &str| {
        format!("[[robot]]\nid = \"{id}\"\nmodel = \"bicycle\"\nwheelbase_m = 1.2\n{more}\n")
    };
    [
        entry("plain_01", ""),
        entry(
            "jazzy_01",
            "streams = { scan = { topic = \"front/scan\" } }",
        ),
        entry("humble_01", ""),
        entry(
            "bridge_01",
            "streams = { drive = { topic = \"ackermann\" } }",
        ),
    ]
    .concat()
}

/// What the service says about a robot's topics.
fn topics_of(service: &Service, robot: &str) -> Option<Vec<Value>> {
    let robot = service.try_get(&format!("/api/v1/robots/{robot}"))?;
    let topics = robot["topics"].as_array()?.clone();
    Some(topics).filter(|topics| !topics.is_empty())
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_robot_of_every_layout_gets_the_numbers_of_a_plain_one() {
    let folder = TempDir::new().unwrap();
    let path = recorded(&folder, 45.0);
    let service = Service::start_with(&config());

    // One that nobody has registered is seen by what it announces, and then joins.
    let mut joints = RosRobot::start(&service, "joints_01", JOINTS).await;
    let seen = wait_for("the announced topics", || {
        topics_of(&service, "joints_01").filter(|topics| topics.len() == 3)
    });
    assert_eq!(service.robot("joints_01")["state"], "unregistered");
    let [states, odom, scan] = seen.as_slice() else {
        panic!("three topics: {seen:?}");
    };
    assert_eq!(states["topic"], "joint_states");
    assert_eq!(states["type"], "sensor_msgs/msg/JointState");
    assert_eq!(states["layout"], "rmw_zenoh");
    assert_eq!(odom["type"], "nav_msgs/msg/Odometry");
    assert_eq!(
        odom["suited_for"],
        serde_json::json!(["speed", "lidar_odometry"])
    );
    assert_eq!(scan["suited_for"], serde_json::json!(["scan"]));
    let streams = r#""streams": {"steering": {"topic": "joint_states"}, "speed": {"topic": "odom"},
        "joints": {"steering": "steer", "steering_gear": 0.5}}"#;
    service.register("joints_01", &format!("{{{VEHICLE}, {streams}}}"));
    tokio::time::sleep(Duration::from_millis(300)).await;

    let mut jazzy = RosRobot::start(&service, "jazzy_01", JAZZY).await;
    let mut humble = RosRobot::start(&service, "humble_01", HUMBLE).await;
    let mut bridge = RosRobot::start(&service, "bridge_01", BRIDGE).await;
    let plain = tokio::spawn(send(sender(&service, &path, "plain_01")));
    let (sent_joints, sent_jazzy, sent_humble, sent_bridge) = tokio::join!(
        joints.publish(&path),
        jazzy.publish(&path),
        humble.publish(&path),
        bridge.publish(&path),
    );
    let plain = plain.await.unwrap();
    for robot in [joints, jazzy, humble, bridge] {
        robot.stop().await;
    }

    let report = calibrated(&path);
    let whole = plain.drive_samples + plain.scans;
    for (robot, sent) in [
        ("plain_01", whole),
        ("jazzy_01", sent_jazzy),
        ("humble_01", sent_humble),
        ("bridge_01", sent_bridge),
        ("joints_01", sent_joints),
    ] {
        let estimate = service.estimate_of(robot, plain.drive_samples);
        assert_same(&estimate, &report);
        let counters = service.accounts_of(robot);
        assert_eq!(counters["processed"], sent, "{robot}: {counters}");
    }
    let pairing = service.robot("joints_01")["pairing"].clone();
    assert_eq!(pairing["paired"], plain.drive_samples, "{pairing}");
    assert_eq!(pairing["unpaired"], 0, "{pairing}");
    assert_eq!(pairing["error_max_s"], 0.0, "{pairing}");
    assert!(service.robot("jazzy_01")["pairing"].is_null());
}

/// Where a robot of `rmw_zenoh` hears what is approved.
const APPROVED: &str = "0/jazzy_01/calibration/approved/std_msgs::msg::dds_::String_/\
                        RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";

/// What a subscriber of ROS 2 reads in a message.
fn read_approved(sample: &zenoh::sample::Sample) -> CalibrationDocument {
    let attached = sample.attachment().expect("rmw_zenoh drops what has none");
    assert_eq!(attached.len(), 33);
    let text = StringMessage::from_cdr(&sample.payload().to_bytes()).unwrap();
    let envelope: Envelope = serde_json::from_str(&text.data).unwrap();
    serde_json::from_str(&envelope.document).unwrap()
}

/// Proposes and approves a calibration, as two people.
fn approve(service: &Service, robot: &str) {
    let operator = service.made_token(&["--role", "operator", "--name", "olga"]);
    let approver = service.made_token(&["--role", "approver", "--name", "ana"]);
    let values = r#"{"steering_offset_rad": 0.02, "lidar_x_m": 0.4, "lidar_y_m": 0.0, "lidar_yaw_rad": 0.01}"#;
    let body = format!(r#"{{"robot": "{robot}", "values": {values}, "reason": "by hand"}}"#);
    let proposal = service.send(
        "POST /api/v1/proposals",
        &operator,
        "Idempotency-Key: one\r\n",
        &body,
    );
    let (id, version) = (&proposal["id"], &proposal["version"]);
    let body = format!(
        r#"{{"sha256": {}, "reason": "looks right"}}"#,
        proposal["revision"]["sha256"]
    );
    service.send(
        &format!("POST /api/v1/proposals/{id}/approve"),
        &approver,
        &format!("If-Match: \"{version}\"\r\n"),
        &body,
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_is_approved_is_a_transient_local_topic() {
    let service = Service::start(&["jazzy_01"]);
    let robot = RosRobot::start(&service, "jazzy_01", JAZZY).await;
    let subscriber = robot.session.declare_subscriber(APPROVED).await.unwrap();
    wait_for("the announced topics", || topics_of(&service, "jazzy_01"));
    approve(&service, "jazzy_01");
    let heard = tokio::time::timeout(Duration::from_secs(20), subscriber.recv_async()).await;
    let document = read_approved(&heard.unwrap().unwrap());
    assert_eq!(document.robot.as_str(), "jazzy_01");
    assert_eq!(document.generation, 1);

    // Who subscribes later asks as Zenoh's advanced subscriber does.
    let late = client(&service).await;
    let asked = format!("{APPROVED}/@adv/**?_anyke;_max=1");
    let replies = late.get(asked).await.unwrap();
    let reply = replies.recv_async().await.unwrap();
    let again = read_approved(reply.result().unwrap());
    assert_eq!(again, document);

    // One that comes back hears it again.
    robot.stop().await;
    let (other, mut samples) = subscribed(&service).await;
    let robot = RosRobot::start(&service, "jazzy_01", JAZZY).await;
    let heard = tokio::time::timeout(Duration::from_secs(20), samples.recv()).await;
    assert_eq!(read_approved(&heard.unwrap().unwrap()), document);
    robot.stop().await;
    other.close().await.unwrap();
}

/// A session, and what comes on the topic from now on while it is open.
async fn subscribed(service: &Service) -> (zenoh::Session, mpsc::Receiver<zenoh::sample::Sample>) {
    let (sender, receiver) = mpsc::channel(16);
    let session = client(service).await;
    let take = move |sample| {
        sender.try_send(sample).ok();
    };
    let subscriber = session.declare_subscriber(APPROVED).callback(take).await;
    subscriber.unwrap().background();
    tokio::time::sleep(Duration::from_millis(300)).await;
    (session, receiver)
}
