//! Robots whose key expressions overlap: each message is one robot's, once.

use fleetcal_proto::message_type::MessageType;
use fleetcal_proto::ros::{AckermannDriveStamped, Header, RosMessage, Time};
use fleetcal_tests::service::{Service, wait_for};
use zenoh::qos::CongestionControl;

use super::robot::HASH;
use crate::service::hostile::client;

/// Samples sent on each key.
const SAMPLES: u64 = 500;

/// Configuration with `*/left/front/wheel_odometry` of the one robot and
/// `7/left/front/wheel_odometry` of the other, which is known by its domain; the third has its
/// prefix below that domain.
const CONFIG: &str = "\
    [ros2]\n\
    rmw_zenoh = [\"{domain}/{robot}/{topic}\", \"{robot}/{topic}\"]\n\
    [[robot]]\nid = \"left\"\nmodel = \"bicycle\"\nwheelbase_m = 1.2\n\
    streams = { wheel_odometry = { topic = \"front/wheel_odometry\" } }\n\
    [[robot]]\nid = \"7\"\nmodel = \"bicycle\"\nwheelbase_m = 1.2\n\
    streams = { wheel_odometry = { topic = \"left/front/wheel_odometry\" } }\n\
    [[robot]]\nid = \"cart\"\nmodel = \"bicycle\"\nwheelbase_m = 1.2\n\
    streams = { prefix = \"7/right\" }\n";

async fn send(session: &zenoh::Session, key: &str) {
    let publisher = session.declare_publisher(key.to_owned());
    let publisher = publisher.congestion_control(CongestionControl::Block).await;
    let publisher = publisher.unwrap();
    for number in 0..SAMPLES {
        let stamp = Time::from_ns(1_700_000_000_000_000_000 + 10_000_000 * number as i64);
        let header = Header {
            stamp: stamp.unwrap(),
            frame_id: String::new(),
        };
        let drive = AckermannDriveStamped {
            header,
            ..AckermannDriveStamped::default()
        };
        publisher.put(drive.to_cdr()).await.unwrap();
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_message_whose_key_many_expressions_match_is_counted_once() {
    let service = Service::start_with(CONFIG);
    let session = client(&service).await;
    let drive = MessageType::AckermannDriveStamped.dds_type();
    let received = |robot: &str| {
        let counters = &service.robot(robot)["counters"];
        counters["received"].as_u64().unwrap()
    };
    send(
        &session,
        &format!("7/left/front/wheel_odometry/{drive}/{HASH}"),
    )
    .await;
    send(&session, &format!("7/right/wheel_odometry/{drive}/{HASH}")).await;
    // Behind the others on the same connection: when it is in, all calls for those are over.
    session
        .put(format!("7/last/wheel_odometry/{drive}/{HASH}"), [0; 4])
        .congestion_control(CongestionControl::Block)
        .await
        .unwrap();
    wait_for("the last message", || {
        service.try_get("/api/v1/robots/last")
    });
    assert_eq!(received("left"), SAMPLES);
    assert_eq!(received("7"), 0);
    assert_eq!(received("cart"), SAMPLES);
    service.accounts_of("left");
}
