//! Robots that speak ROS 2 and run none of our software, in each layout of keys.

mod graph;
mod overlap;
pub mod robot;

use std::time::Duration;

use fleetcal_model::Generation;
use fleetcal_proto::calibration::{CalibrationDocument, Envelope};
use fleetcal_proto::message_type::MessageType;
use fleetcal_proto::ros::{AckermannDriveStamped, RosMessage, StringMessage};
use fleetcal_proto::ros2_key::NO_HASH;
use fleetcal_tests::service::{Service, wait_for};
use serde_json::Value;
use tempfile::TempDir;
use tokio::sync::mpsc;
use zenoh::qos::CongestionControl;

use super::hostile::client;
use super::{assert_same, calibrated, recorded, send, sender};
use robot::{HASH, Layout, RosRobot, Topics};

const JAZZY: Topics = Topics {
    prefix: "0/jazzy_01",
    wheel_odometry: "wheel_odometry",
    scan: "front/scan",
    layout: Layout::Rmw(HASH),
    apart: false,
    old_attachments: false,
};
const HUMBLE: Topics = Topics {
    prefix: "7/humble_01",
    wheel_odometry: "drive",
    scan: "scan",
    layout: Layout::Rmw(NO_HASH),
    apart: false,
    old_attachments: true,
};
const BRIDGE: Topics = Topics {
    prefix: "bridge_01",
    wheel_odometry: "ackermann",
    scan: "scan",
    layout: Layout::Bridge,
    apart: false,
    old_attachments: false,
};
const JOINTS: Topics = Topics {
    prefix: "0/joints_01",
    wheel_odometry: "joint_states",
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
        // Registered while that was the usual topic: the migration writes this.
        entry("humble_01", "streams = { former_topic = true }"),
        entry(
            "bridge_01",
            "streams = { wheel_odometry = { topic = \"ackermann\" } }",
        ),
    ]
    .concat()
}

/// Returns the service's view of a robot's topics.
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
        serde_json::json!(["wheel_odometry", "speed", "lidar_odometry"])
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
    // An encoder's angle is a measured one.
    assert_eq!(service.robot("jazzy_01")["warnings"], serde_json::json!([]));
}

/// Key on which a robot of `rmw_zenoh` receives the approved calibration.
const APPROVED: &str = "0/jazzy_01/calibration/approved/std_msgs::msg::dds_::String_/\
                        RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";

/// Reads a message as a subscriber of ROS 2 does.
fn read_approved(sample: &zenoh::sample::Sample) -> CalibrationDocument {
    // Without one rmw_zenoh drops it.
    let attached = sample.attachment().unwrap();
    assert_eq!(attached.len(), 33);
    let text = StringMessage::from_cdr(&sample.payload().to_bytes()).unwrap();
    let envelope: Envelope = serde_json::from_str(&text.data).unwrap();
    serde_json::from_str(&envelope.document).unwrap()
}

/// Proposes and approves a calibration, as two people.
fn approve(service: &Service, robot: &str) {
    let operator = service.made_token(&["--role", "operator", "--name", "olga"]);
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
    // Nothing says what the robot uses: one approver is not enough.
    for (name, version) in [("ana", version.clone()), ("bo", serde_json::json!(2))] {
        let approver = service.made_token(&["--role", "approver", "--name", name]);
        service.send(
            &format!("POST /api/v1/proposals/{id}/approve"),
            &approver,
            &format!("If-Match: \"{version}\"\r\n"),
            &body,
        );
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_is_approved_is_a_transient_local_topic() {
    let config = "[[robot]]\nid = \"jazzy_01\"\nmodel = \"bicycle\"\nwheelbase_m = 1.2\n\
                  rear_axle_in_base_link = { x_m = -0.5, y_m = 0.0, yaw_rad = 0.0 }\n";
    let service = Service::start_with(config);
    let robot = RosRobot::start(&service, "jazzy_01", JAZZY).await;
    let subscriber = robot.session.declare_subscriber(APPROVED).await.unwrap();
    wait_for("the announced topics", || topics_of(&service, "jazzy_01"));
    approve(&service, "jazzy_01");
    let heard = tokio::time::timeout(Duration::from_secs(20), subscriber.recv_async()).await;
    let document = read_approved(&heard.unwrap().unwrap());
    assert_eq!(document.robot.as_str(), "jazzy_01");
    assert_eq!(document.generation, Generation(1));
    let rear_axle = document.rear_axle_in_base_link.unwrap();
    assert!((rear_axle.x_m + 0.5).abs() < 1e-12, "{rear_axle:?}");
    let lidar = document.lidar_in_base_link.unwrap();
    assert!((lidar.x_m + 0.1).abs() < 1e-9, "{lidar:?}");
    assert_eq!((lidar.y_m, lidar.yaw_rad), (0.0, 0.01));

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

/// Opens a session; returns it with the messages on the topic from now on while it is open.
async fn subscribed(service: &Service) -> (zenoh::Session, mpsc::Receiver<zenoh::sample::Sample>) {
    let (sender, receiver) = mpsc::channel(16);
    let session = client(service).await;
    let take = move |sample| {
        sender.try_send(sample).ok();
    };
    let subscriber = session.declare_subscriber(APPROVED).callback(take);
    subscriber.background().await.unwrap();
    tokio::time::sleep(Duration::from_millis(300)).await;
    (session, receiver)
}

/// Messages whose ingestion is timed.
const TIMED_MESSAGES: u64 = 50_000;
/// Largest cost of a message, microseconds of a core.
const INGEST_MAX_US: f64 = 100.0;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_it_costs_to_take_a_message_in() {
    let service = Service::start(&["other_01"]);
    let robot = client(&service).await;
    // Of a robot that nobody has registered: its key is read, and the message counted and left.
    let key = JAZZY.key("wheel_odometry", MessageType::AckermannDriveStamped);
    let publisher = robot.declare_publisher(key);
    let publisher = publisher.congestion_control(CongestionControl::Block);
    let publisher = publisher.await.unwrap();
    let payload = AckermannDriveStamped::default().to_cdr();
    let before_s = service.cpu_s();
    for _ in 0..TIMED_MESSAGES {
        publisher.put(payload.clone()).await.unwrap();
    }
    wait_for("all of them", || {
        let robot = service.try_get("/api/v1/robots/jazzy_01")?;
        (robot["counters"]["ignored"] == TIMED_MESSAGES).then_some(())
    });
    let each_us = (service.cpu_s() - before_s) * 1e6 / TIMED_MESSAGES as f64;
    let of_200_percent = each_us * 1e-6 * 110.0 * 200.0 * 100.0;
    eprintln!(
        "taking in costs {each_us:.1} us a message; 200 robots of 110 Hz: {of_200_percent:.0} % of \
         a core"
    );
    assert!(each_us < INGEST_MAX_US, "{each_us} us");
}
