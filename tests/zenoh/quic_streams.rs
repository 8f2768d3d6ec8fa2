//! Zenoh gives a QUIC connection a stream for each priority, and nothing orders them: data may overtake
//! the declaration of its key, and the router drops what has no key. Ours has one stream.

use fleetcal_ports::free_address;
use fleetcal_tests::certificates::Authority;
use tempfile::TempDir;
use zenoh::qos::CongestionControl;

use crate::zenoh::lists::{start_with_certificates, wait_until_received};
use crate::zenoh::{robot, session};

/// Sessions that send at once: with a stream for each priority, one in six lost everything.
const SESSIONS: u64 = 40;
/// Samples that each of them sends.
const SAMPLES: u64 = 5;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn over_quic_what_follows_its_declaration_at_once_arrives() {
    let folder = TempDir::new().unwrap();
    let authority = Authority::new(folder.path());
    let zenoh = free_address();
    let service = start_with_certificates(&authority, folder.path(), zenoh, "quic");
    // Any client: it does not say how many streams it has.
    let client = robot::client(
        &format!("quic/{zenoh}"),
        &session::tls(authority.folder(), Some("robot_a")),
    );
    let mut sessions = Vec::new();
    for number in 0..SESSIONS {
        let session = robot::open(client.clone()).await.unwrap();
        let stream = session
            .declare_publisher("fleet/robot_a/wheel_odometry")
            .congestion_control(CongestionControl::Block)
            .await
            .unwrap();
        for sample in number * SAMPLES..(number + 1) * SAMPLES {
            stream.put(robot::sample(sample)).await.unwrap();
        }
        sessions.push((session.clone(), stream));
    }
    wait_until_received(&service, "robot_a", SESSIONS * SAMPLES);
}
