//! Two senders under one robot's id.

use std::ops::Range;
use std::time::Duration;

use fleetcal_tests::recording;
use fleetcal_tests::service::{Service, now, wait_for};
use tempfile::TempDir;
use zenoh::pubsub::Publisher;

use super::floods::Crowd;
use super::robot;

/// Messages of each of two senders: a second of wheel odometry.
const OF_EACH: u64 = 100;
/// Pause between two messages: each arrives before the next is sent, over any connection.
const STEP: Duration = Duration::from_millis(5);

fn is_warned_of(service: &Service) -> bool {
    let robot = service.robot("robot_01");
    let mut warnings = robot["warnings"].as_array().unwrap().iter();
    warnings.any(|warning| warning["kind"] == "two_senders")
}

fn processed(service: &Service) -> u64 {
    let counters = service.robot("robot_01")["counters"].clone();
    counters["processed"].as_u64().unwrap()
}

#[test]
fn two_senders_of_one_id_are_told_and_nothing_of_theirs_is_used() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("robot.mcap");
    recording::simulated(&path, 20.0);
    let path = path.to_str().unwrap();
    let service = Service::start(&["robot_01"]);
    let endpoint = service.endpoint();
    let drive = |seconds| Crowd::start(&["robots", &endpoint, seconds, "1", path, "anonymous"]);
    let _first = drive("20");
    wait_for("the first sender's messages", || {
        (processed(&service) > 200).then_some(())
    });
    assert!(!is_warned_of(&service));
    let began = now();
    let mut second = drive("5");
    wait_for("the warning", || is_warned_of(&service).then_some(()));
    let warned = began.elapsed();
    wait_for("the alert", || {
        let alerts = service.get("/api/v1/alerts");
        let mut alerts = alerts["items"].as_array()?.iter();
        alerts
            .find(|alert| alert["kind"] == "two_senders")
            .map(drop)
    });
    println!(
        "warned {warned:?} after the second connected, alert after {:?}",
        began.elapsed()
    );
    // One or two may have been on their way when it was told.
    let before = processed(&service);
    second.hear();
    assert!(processed(&service) <= before + 2, "{before}");
    wait_for("one sender again", || {
        (!is_warned_of(&service)).then_some(())
    });
    wait_for("its messages", || {
        (processed(&service) > before + 2).then_some(())
    });
    let dropped = "fleetcal_messages_dropped_total{reason=\"two_senders\"}";
    assert!(service.metric(dropped) > 0);
}

/// Sends wheel odometry in turns, each message over the next of some connections.
async fn send_in_turns(publishers: &[&Publisher<'_>], numbers: Range<u64>) {
    let turns = publishers.iter().cycle();
    for (publisher, number) in turns.zip(numbers) {
        publisher.put(robot::sample(number)).await.unwrap();
        tokio::time::sleep(STEP).await;
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn two_senders_that_take_exact_turns_are_told_by_their_connections() {
    let service = Service::start(&["robot_01"]);
    let open = async || {
        let config = robot::client(&service.endpoint(), &serde_json::json!({}));
        robot::open(config).await.unwrap()
    };
    let settled = |count: u64| {
        tokio::task::block_in_place(|| {
            wait_for("the messages", || {
                (processed(&service) == count).then_some(())
            });
            assert!(!is_warned_of(&service));
        });
    };
    // A robot that connects again is one, and so is one that does so while it sends.
    let before = open().await;
    let stream = robot::stream(&before, "robot_01").await;
    send_in_turns(&[&stream], 0..OF_EACH).await;
    settled(OF_EACH);
    let [first, second] = [open().await, open().await];
    let one = robot::stream(&first, "robot_01").await;
    send_in_turns(&[&one], OF_EACH..2 * OF_EACH).await;
    before.close().await.unwrap();
    settled(2 * OF_EACH);
    // Every stamp a period after the one before: nothing but the connections tells them apart.
    let other = robot::stream(&second, "robot_01").await;
    let began = now();
    send_in_turns(&[&one, &other], 2 * OF_EACH..4 * OF_EACH).await;
    tokio::task::block_in_place(|| {
        wait_for("the warning", || is_warned_of(&service).then_some(()));
        println!(
            "warned {:?} after the second began to send",
            began.elapsed()
        );
        let used = processed(&service) - 2 * OF_EACH;
        assert!(used < OF_EACH / 2, "{used} messages of two senders used");
    });
}
