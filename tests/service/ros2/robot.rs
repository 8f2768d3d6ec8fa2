//! A robot that speaks ROS 2, as the service sees it: its keys, tokens, attachments and bytes.

use std::path::Path;
use std::time::Duration;

use fleetcal_proto::message_type::MessageType;
use fleetcal_proto::progress::Progress;
use fleetcal_proto::ros::{AckermannDriveStamped, JointState, Odometry, RosMessage};
use fleetcal_proto::ros2_key::Attachment;
use fleetcal_robot::recording::Recording;
use fleetcal_robot::replay::Window;
use fleetcal_tests::service::Service;
use zenoh::qos::CongestionControl;

use crate::service::hostile::client;

/// Pause between two checks of the service's progress.
const LOOK_EVERY: Duration = Duration::from_millis(2);

/// Hash of a type in keys; any text works.
pub const HASH: &str = "RIHS01_64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828";

/// Layout of a robot's keys.
#[derive(Debug, Clone, Copy)]
pub enum Layout {
    /// `rmw_zenoh` with this hash.
    Rmw(&'static str),
    Bridge,
}

/// Topics of a robot.
#[derive(Debug, Clone, Copy)]
pub struct Topics {
    /// Prefix of the topic in keys.
    pub prefix: &'static str,
    pub wheel_odometry: &'static str,
    pub scan: &'static str,
    pub layout: Layout,
    /// True if steering comes as joints on `drive`, and the speed as odometry on `odom`.
    pub apart: bool,
    /// True for attachments in the layout of builds before 2025.
    pub old_attachments: bool,
}

impl Topics {
    pub fn key(&self, topic: &str, of: MessageType) -> String {
        let path = format!("{}/{topic}", self.prefix);
        match self.layout {
            Layout::Rmw(hash) => format!("{path}/{}/{hash}", of.dds_type()),
            Layout::Bridge => path,
        }
    }

    /// Returns the token that announces a publisher of the robot.
    pub fn token(&self, topic: &str, of: MessageType) -> String {
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

    pub fn wheel_odometry_type(&self) -> MessageType {
        if self.apart {
            MessageType::JointState
        } else {
            MessageType::AckermannDriveStamped
        }
    }
}

pub fn attachment(sequence: i64, old: bool) -> Vec<u8> {
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
pub struct RosRobot {
    pub session: zenoh::Session,
    tokens: Vec<zenoh::liveliness::LivelinessToken>,
    topics: Topics,
    id: &'static str,
    sequence: i64,
    window: Window,
}

impl RosRobot {
    pub async fn start(service: &Service, id: &'static str, topics: Topics) -> Self {
        let session = client(service).await;
        let mut robot = Self {
            session,
            tokens: Vec::new(),
            topics,
            id,
            sequence: 0,
            window: Window::new(None),
        };
        robot
            .announce(topics.wheel_odometry, topics.wheel_odometry_type())
            .await;
        if topics.apart {
            robot.announce("odom", MessageType::Odometry).await;
        }
        robot.announce(topics.scan, MessageType::LaserScan).await;
        robot
    }

    pub async fn announce(&mut self, topic: &str, of: MessageType) {
        let token = self.topics.token(topic, of);
        let declared = self.session.liveliness().declare_token(token).await;
        self.tokens.push(declared.unwrap());
    }

    /// Publishes all of a recording as fast as the service processes it.
    pub async fn publish(&mut self, path: &Path) -> u64 {
        let recording = Recording::open(path).unwrap();
        let names = ["/tugger_01/wheel_odometry", "/tugger_01/scan"];
        for message in recording.messages(&names).unwrap() {
            let message = message.unwrap();
            if *message.topic == *names[1] {
                let (topic, of) = (self.topics.scan, MessageType::LaserScan);
                self.put(topic, of, message.payload).await;
            } else if self.topics.apart {
                let drive = AckermannDriveStamped::from_cdr(&message.payload).unwrap();
                let (joints, odometry) = apart(&drive);
                let drive = self.topics.wheel_odometry;
                self.put(drive, MessageType::JointState, joints.to_cdr())
                    .await;
                self.put("odom", MessageType::Odometry, odometry.to_cdr())
                    .await;
            } else {
                let (topic, of) = (
                    self.topics.wheel_odometry,
                    MessageType::AckermannDriveStamped,
                );
                self.put(topic, of, message.payload).await;
            }
        }
        while !self.window.is_done() {
            self.look().await;
        }
        self.window.sent()
    }

    pub async fn put(&mut self, topic: &str, of: MessageType, payload: Vec<u8>) {
        let is_wheel_odometry = of != MessageType::LaserScan;
        while !self.window.has_room(is_wheel_odometry) {
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
        self.window.count_sent(is_wheel_odometry);
    }

    pub async fn look(&mut self) {
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

    pub async fn stop(self) {
        for token in self.tokens {
            token.undeclare().await.unwrap();
        }
        self.session.close().await.unwrap();
    }
}

/// Splits a drive sample into steering as the position of a joint that is geared down, and the
/// speed as odometry.
pub fn apart(drive: &AckermannDriveStamped) -> (JointState, Odometry) {
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
