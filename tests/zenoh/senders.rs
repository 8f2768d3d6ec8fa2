//! Two senders under one robot's id.

use fleetcal_tests::recording;
use fleetcal_tests::service::{Service, now, wait_for};
use tempfile::TempDir;

use super::floods::Crowd;

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
