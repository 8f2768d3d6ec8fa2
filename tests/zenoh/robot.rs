//! A robot on the wire, with the configuration of any Zenoh client.

use std::time::Duration;

use fleetcal_proto::ros::{AckermannDrive, AckermannDriveStamped, Header, RosMessage, Time};
use serde_json::{Value, json};
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;
use zenoh::{Config, Session, Wait};

/// Longest wait for a connection, or for somebody who listens.
pub const PATIENCE: Duration = Duration::from_secs(30);
/// Stamp of the first sample, ns.
const FIRST_NS: i64 = 1_700_000_000_000_000_000;

/// A client's configuration, with `transport` as Zenoh has it.
pub fn client(endpoint: &str, transport: &Value) -> Value {
    json!({
        "mode": "client",
        "connect": { "endpoints": [endpoint], "timeout_ms": 10_000 },
        "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false } },
        "transport": transport,
    })
}

/// A client that shows a password.
pub fn with_password(endpoint: &str, user: &str, password: &str) -> Value {
    let auth = json!({ "auth": { "usrpwd": { "user": user, "password": password } } });
    client(endpoint, &auth)
}

/// Opens a session, or says why not.
pub async fn open(config: Value) -> Result<Session, String> {
    let config = Config::from_json5(&config.to_string()).unwrap();
    let opened = tokio::task::spawn_blocking(move || zenoh::open(config).wait()).await;
    opened.unwrap().map_err(|error| error.to_string())
}

/// A drive sample, each with a stamp of its own.
pub fn sample(number: u64) -> Vec<u8> {
    let stamp = Time::from_ns(FIRST_NS + 10_000_000 * number as i64).unwrap();
    let drive = AckermannDrive {
        speed: 1.0,
        ..AckermannDrive::default()
    };
    let header = Header {
        stamp,
        frame_id: String::new(),
    };
    AckermannDriveStamped { header, drive }.to_cdr()
}

/// The drive stream of a robot's key, once somebody listens to it: nothing is kept back at the
/// sender. A publisher waits for room, so that what does not arrive was refused.
pub async fn stream(session: &Session, robot: &str) -> Publisher<'static> {
    let publisher = session
        .declare_publisher(format!("fleet/{robot}/drive"))
        .congestion_control(CongestionControl::Block)
        .await
        .unwrap();
    let matching = async {
        while !publisher.matching_status().await.unwrap().matching() {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    let matched = tokio::time::timeout(PATIENCE, matching).await;
    assert!(matched.is_ok(), "nobody listens to {robot}'s drive");
    publisher
}

/// Sends so many samples.
pub async fn send(publisher: &Publisher<'_>, samples: u64) {
    for number in 0..samples {
        publisher.put(sample(number)).await.unwrap();
    }
}

/// How many answer a question.
pub async fn answers(session: &Session, key: &str) -> usize {
    let asked = session.get(key).timeout(Duration::from_secs(2));
    let replies = asked.await.unwrap();
    let mut answered = 0;
    while let Ok(reply) = replies.recv_async().await {
        answered += usize::from(reply.result().is_ok());
    }
    answered
}
