//! A robot on the wire.

use std::time::Duration;

use fleetcal_proto::ros::{AckermannDrive, AckermannDriveStamped, Header, RosMessage, Time};
use zenoh::Session;
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;

pub use crate::zenoh::session::{PATIENCE, client, open, with_password};

/// Time of the first sample, ns.
const FIRST_NS: i64 = 1_700_000_000_000_000_000;

/// Makes a drive sample, each with a stamp of its own.
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

/// Declares the wheel odometry of a robot's key, and returns it once it has a subscriber: the
/// sender holds nothing back. The publisher waits for room, so that missing messages were refused.
pub async fn stream(session: &Session, robot: &str) -> Publisher<'static> {
    stream_on(session, &format!("fleet/{robot}/wheel_odometry")).await
}

/// Declares a publisher of any key likewise.
pub async fn stream_on(session: &Session, key: &str) -> Publisher<'static> {
    let publisher = session
        .declare_publisher(key.to_owned())
        .congestion_control(CongestionControl::Block)
        .await
        .unwrap();
    let matching = async {
        while !publisher.matching_status().await.unwrap().matching() {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    let matched = tokio::time::timeout(PATIENCE, matching).await;
    assert!(matched.is_ok(), "nobody listens to {key}");
    publisher
}

/// Sends a number of samples.
pub async fn send(publisher: &Publisher<'_>, samples: u64) {
    for number in 0..samples {
        publisher.put(sample(number)).await.unwrap();
    }
}

/// Counts the answers to a query.
pub async fn answers(session: &Session, key: &str) -> usize {
    let asked = session.get(key).timeout(Duration::from_secs(2));
    let replies = asked.await.unwrap();
    let mut answered = 0;
    while let Ok(reply) = replies.recv_async().await {
        answered += usize::from(reply.result().is_ok());
    }
    answered
}
