//! Robots that describe themselves, over Zenoh and from the simulator.

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use fleetcal_proto::encoding::Encoding;
use fleetcal_proto::message_type::MessageType;
use fleetcal_proto::ros::{Quaternion, RosMessage, StringMessage, TfMessage, TransformStamped};
use fleetcal_robot::recording::Recording;
use fleetcal_tests::binary;
use fleetcal_tests::service::{Service, wait_for};
use serde_json::{Value, json};
use tempfile::TempDir;
use tokio::time::Instant;
use zenoh::Session;
use zenoh::qos::CongestionControl;

use super::hostile::client;
use super::ros2::robot::{HASH, Layout, RosRobot, Topics, attachment};

const BICYCLE: &str = include_str!("../../proto/description/tests/urdf/bicycle_steering.urdf");
const TRICYCLE: &str = include_str!("../../proto/description/tests/urdf/tricycle.urdf");
const ACKERMANN: &str = include_str!("../../proto/description/tests/urdf/ackermann.urdf");
/// Keys of a ROS 2 robot's `robot_description` and of its earlier messages.
const TYPED: &str = "0/jazzy_01/robot_description/std_msgs::msg::dds_::String_/RIHS01_df66";
const TOKEN: &str = "@ros2_lv/0/aa/1/23/MP/%/%/node/%jazzy_01%robot_description/\
                     std_msgs::msg::dds_::String_/RIHS01_df66/::,10:,:,:,,";

/// Registered robots, by ids and wheelbases.
fn config(robots: &[(&str, f64)]) -> String {
    let entry = |(id, wheelbase_m): &(&str, f64)| {
        format!("[[robot]]\nid = \"{id}\"\nmodel = \"bicycle\"\nwheelbase_m = {wheelbase_m:?}\n")
    };
    robots.iter().map(entry).collect()
}

fn urdf(text: &str) -> Vec<u8> {
    let data = text.to_owned();
    StringMessage { data }.to_cdr()
}

async fn put(session: &Session, key: &str, payload: Vec<u8>) {
    let put = session.put(key, payload);
    let put = put.congestion_control(CongestionControl::Block);
    put.await.unwrap();
}

/// Returns what the service has read of a robot's description, once `is_it`.
fn described(service: &Service, robot: &str, is_it: impl Fn(&Value) -> bool) -> Value {
    wait_for(&format!("the description of {robot}"), || {
        let read = service.try_get(&format!("/api/v1/robots/{robot}/description"))?;
        Some(read).filter(|read| is_it(read))
    })
}

/// Returns the preview of an unregistered robot, once both of its streams have come and no check names
/// a cause.
fn previewed(service: &Service, token: &str, robot: &str, config: &Value) -> Value {
    let request = format!("POST /api/v1/robots/{robot}/preview");
    let json = "Content-Type: application/json\r\n";
    let asked = config.to_string();
    wait_for(&format!("the preview of {robot}"), || {
        let shown = service.send(&request, token, json, &asked);
        let checks = &shown["checks"];
        let came = |of: &Value| of["messages"].as_u64() > Some(10) && of["refused"] == 0;
        let streams = checks["streams"].as_array()?.iter().filter(|of| came(of));
        let named = checks["findings"].as_array()?.iter();
        let is_right = streams.count() == 2 && named.into_iter().all(|of| of["cause"].is_null());
        is_right.then_some(shown)
    })
}

fn has_origin(read: &Value) -> bool {
    read["description"]["origins"] != json!([])
}

/// Returns the value of a key.
fn value<'v>(read: &'v Value, key: &str) -> &'v Value {
    let mut values = read["description"]["values"].as_array().unwrap().iter();
    &values.find(|value| value["key"] == key).unwrap()["value"]
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_simulated_robot_is_registered_by_one_request_and_calibrates() {
    let began = Instant::now();
    let service = Service::start(&[]);
    let mut simulate = Command::new(binary::path());
    simulate.args(["simulate", "--connect", &service.endpoint()]);
    let mut simulate = simulate.spawn().unwrap();
    let read = described(&service, "tugger_01", has_origin);
    assert_eq!(read["proposed"]["model"], "bicycle");
    assert_eq!(read["proposed"]["wheelbase_m"], 1.2);
    assert_eq!(read["proposed"]["nominal_extrinsics"]["x_m"], 0.434);
    assert_eq!(read["description"]["missing"], json!([]));
    assert_eq!(service.robot("tugger_01")["state"], "unregistered");
    let operator = service.made_token(&["--role", "operator", "--name", "line"]);
    let shown = previewed(&service, &operator, "tugger_01", &read["proposed"]);
    assert!(shown["top_view"]["returns_m"].as_array().unwrap().len() > 100);
    assert_eq!(shown["dropped"], 0);
    assert_eq!(service.robot("tugger_01")["state"], "unregistered");
    let request = "POST /api/v1/robots/tugger_01/description";
    let made = service.send(request, &operator, "If-None-Match: *\r\n", "");
    assert_eq!(made["config"], read["proposed"]);
    let counts = wait_for("an estimate", || {
        let estimate = service.try_get("/api/v1/robots/tugger_01/estimate")?;
        let counts = estimate["counts"].clone();
        Some(counts).filter(|counts| counts["scans"].as_u64() > Some(10))
    });
    assert_eq!(counts["late"], 0);
    println!("from nothing but the binary in {:.1?}", began.elapsed());
    let read = described(&service, "tugger_01", has_origin);
    assert_eq!(read["description"]["remarks"], json!([]));
    simulate.kill().unwrap();
    simulate.wait().unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn descriptions_arrive_on_own_keys_and_from_ros_2() {
    let known = [("bridge_01", 1.55), ("jazzy_01", 1.2)];
    let service = Service::start_with(&config(&known));
    let session = client(&service).await;
    let json = serde_json::to_vec(&json!({ "data": ACKERMANN })).unwrap();
    let own = "fleet/own_01/robot_description";
    let sent = session.put(own, json).encoding(Encoding::Json.as_str());
    sent.await.unwrap();
    put(&session, "bridge_01/robot_description", urdf(BICYCLE)).await;
    let mut mounted = TransformStamped {
        child_frame_id: "scanner".to_owned(),
        ..TransformStamped::default()
    };
    mounted.header.frame_id = "base_link".to_owned();
    mounted.transform.translation.x = 0.3;
    mounted.transform.rotation = Quaternion::from_yaw(0.0);
    let transforms = vec![mounted];
    let transforms = TfMessage { transforms }.to_cdr();
    put(&session, "bridge_01/tf_static", transforms).await;

    // What a transient-local publisher has published before the service looked.
    let earlier = format!("{TYPED}/@adv/pub/aa/1/_");
    let answering = session.declare_queryable(&earlier).callback(|query| {
        let reply = query.reply(TYPED, urdf(TRICYCLE));
        zenoh::Wait::wait(reply).unwrap();
    });
    let answering = answering.await.unwrap();
    let token = session.liveliness().declare_token(TOKEN).await.unwrap();

    let read = described(&service, "own_01", has_origin);
    assert_eq!(read["proposed"]["model"], "bicycle");
    let both = |read: &Value| read["description"]["origins"].as_array().unwrap().len() == 2;
    let read = described(&service, "bridge_01", both);
    assert_eq!(*value(&read, "wheelbase_m"), 0.62);
    let remarks = read["description"]["remarks"].to_string();
    assert!(
        remarks.contains("wheelbase_m: 1.55 is used, and the description has 0.62"),
        "{remarks}"
    );
    let framed = service.get("/api/v1/robots/bridge_01/description?scan_frame=scanner");
    assert!(value(&framed, "nominal_extrinsics")["x_m"].is_f64());
    let read = described(&service, "jazzy_01", has_origin);
    assert_eq!(*value(&read, "model"), "tricycle");
    // Robots in whose namespace no vehicle is known stay out.
    put(&session, "arm_01/robot_description", urdf(BICYCLE)).await;
    put(&session, own, urdf(TRICYCLE)).await;
    described(&service, "own_01", |read| {
        *value(read, "model") == "tricycle"
    });
    assert_eq!(service.try_get("/api/v1/robots/arm_01"), None);
    token.undeclare().await.unwrap();
    answering.undeclare().await.unwrap();
    session.close().await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn garbage_is_refused_by_name_and_disturbs_nobody() {
    let service = Service::start(&["tugger_01"]);
    let session = client(&service).await;
    let key = "fleet/tugger_01/robot_description";
    put(&session, key, urdf(BICYCLE)).await;
    described(&service, "tugger_01", has_origin);
    let refused = |wanted: &'static str| {
        let named = move |read: &Value| {
            let remarks = read["description"]["remarks"].to_string();
            remarks.contains(wanted)
        };
        described(&service, "tugger_01", named)
    };
    // The former description stands where the message is not kept at all.
    put(&session, key, vec![b'x'; 2 << 20]).await;
    let read = refused("got 2097152 bytes, expected 1048576 at most");
    assert!(has_origin(&read));
    // The router ends the session of a message beyond those of any stream.
    let other = client(&service).await;
    put(&other, key, vec![b'x'; 10_000_000]).await;
    let sent = session.put(key, "<robot/>").encoding("image/png");
    sent.await.unwrap();
    assert!(has_origin(&refused("image/png")));
    let bomb = "<!DOCTYPE a [<!ENTITY b \"bb\"><!ENTITY c \"&b;&b;\">]><robot name=\"&c;\"/>";
    put(&session, key, urdf(bomb)).await;
    assert!(!has_origin(&refused("robot_description: got no XML")));
    put(&session, key, vec![0, 1, 0, 0, 3, 0, 0, 0, 0xc3, 0x28, 0]).await;
    let text = refused("UTF-8");
    assert!(!has_origin(&text), "{text}");
    put(&session, key, urdf("<robot name=\"empty\"/>")).await;
    assert!(!has_origin(&refused("links without a joint above them")));
    let no_wheels = "<robot name=\"no_wheels\"><link name=\"base_link\"/></robot>";
    put(&session, key, urdf(no_wheels)).await;
    let read = described(&service, "tugger_01", has_origin);
    let missing = read["description"]["missing"].as_array().unwrap();
    assert!(!missing.is_empty(), "{read}");
    assert_eq!(service.robot("tugger_01")["config"]["wheelbase_m"], 1.2);
    session.close().await.unwrap();
}

/// Robot on ROS 2 whose topics have names of their own.
const STRANGER: Topics = Topics {
    prefix: "0/stranger_01",
    wheel_odometry: "base/ackermann",
    scan: "front/scan",
    layout: Layout::Rmw(HASH),
    apart: false,
    old_attachments: false,
};

/// Publishes a recording as that robot, as fast as it was recorded.
async fn drive(session: &Session, path: &Path) {
    let recording = Recording::open(path).unwrap();
    let names = ["/tugger_01/wheel_odometry", "/tugger_01/scan"];
    let began = Instant::now();
    let mut first_ns = None;
    for (sequence, message) in (0..).zip(recording.messages(&names).unwrap()) {
        let message = message.unwrap();
        let since_ns = message.log_time_ns - *first_ns.get_or_insert(message.log_time_ns);
        let due = began + Duration::from_nanos(since_ns);
        tokio::time::sleep_until(due).await;
        let (topic, of) = if *message.topic == *names[1] {
            (STRANGER.scan, MessageType::LaserScan)
        } else {
            (STRANGER.wheel_odometry, MessageType::AckermannDriveStamped)
        };
        let put = session.put(STRANGER.key(topic, of), message.payload);
        put.attachment(attachment(sequence, false)).await.unwrap();
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_own_topics_of_an_unregistered_ros_2_robot_are_previewed() {
    let folder = TempDir::new().unwrap();
    let path = super::recorded(&folder, 20.0);
    let service = Service::start(&[]);
    let operator = service.made_token(&["--role", "operator", "--name", "line"]);
    let robot = RosRobot::start(&service, "stranger_01", STRANGER).await;
    wait_for("the announced topics", || {
        let robot = service.try_get("/api/v1/robots/stranger_01")?;
        Some(robot["topics"].as_array()?.len()).filter(|count| *count == 2)
    });
    let config = json!({
        "model": "bicycle",
        "wheelbase_m": 1.2,
        "streams": {
            "wheel_odometry": { "topic": "base/ackermann" },
            "scan": { "topic": "front/scan" },
        },
    });
    let session = robot.session.clone();
    let sending = tokio::spawn(async move { drive(&session, &path).await });
    let shown = previewed(&service, &operator, "stranger_01", &config);
    assert_eq!(shown["checks"]["streams"][1]["topic"], "front/scan");
    sending.abort();
    robot.stop().await;
    assert_eq!(service.robot("stranger_01")["state"], "unregistered");
}
