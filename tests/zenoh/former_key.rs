//! A robot that still sends its wheel odometry on the key of earlier versions.

use fleetcal_tests::service::{Service, wait_for};
use serde_json::{Value, json};

use super::lists::wait_until_received;
use super::robot;

/// Samples that are sent on each key.
const SAMPLES: u64 = 200;

fn alert(service: &Service) -> Option<Value> {
    let alerts = service.get("/api/v1/alerts");
    let mut alerts = alerts["items"].as_array()?.iter();
    let found = alerts.find(|alert| alert["kind"] == "former_key");
    found.cloned()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn samples_on_the_former_key_alert_with_the_remedy_and_are_not_used() {
    let service = Service::start(&["robot_01"]);
    let session = robot::open(robot::client(&service.endpoint(), &json!({})));
    let session = session.await.unwrap();

    let former = robot::stream_on(&session, "fleet/robot_01/drive").await;
    robot::send(&former, SAMPLES).await;
    wait_until_received(&service, "robot_01", SAMPLES);
    let alert = wait_for("the alert", || alert(&service));
    let advice = alert["advice"].as_str().unwrap();
    assert!(advice.contains("fleet/{robot}/wheel_odometry"), "{alert}");
    let seen = service.robot("robot_01");
    assert_eq!(seen["warnings"][0]["kind"], "former_key", "{seen}");
    let text = seen["warnings"][0]["text"].as_str().unwrap();
    assert!(text.contains("fleet/robot_01/wheel_odometry"), "{text}");
    let counters = service.accounts_of("robot_01");
    assert_eq!(counters["processed"], 0, "{counters}");
    assert_eq!(counters["refused"], SAMPLES, "{counters}");

    // The same messages on the key of today are used.
    robot::send(&robot::stream(&session, "robot_01").await, SAMPLES).await;
    wait_until_received(&service, "robot_01", 2 * SAMPLES);
    let counters = service.accounts_of("robot_01");
    assert_eq!(counters["processed"], SAMPLES, "{counters}");
    session.close().await.unwrap();
}
