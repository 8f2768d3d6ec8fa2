//! Moments: the data before something happened, as files that survive the process.

use std::path::Path;
use std::process::Command;

use fleetcal_robot::recording::Recording;
use fleetcal_tests::service::{Service, wait_for};
use fleetcal_tests::{http, rosbags};
use serde_json::Value;
use tempfile::TempDir;

use super::{recorded, send, sender};

/// Moments of the robot that the service lists.
fn listed(service: &Service) -> Vec<Value> {
    let listed = service.get("/api/v1/robots/tugger_01/moments");
    listed["moments"].as_array().unwrap().clone()
}

fn download(service: &Service, moment: &Value, token: &str, to: &Path) {
    let status = Command::new("curl")
        .args(["--silent", "--show-error", "--fail", "--output"])
        .arg(to)
        .args(["--header", &format!("Authorization: Bearer {token}")])
        .arg(format!(
            "{}/api/v1/robots/tugger_01/moments/{}",
            service.url(),
            moment["id"]
        ))
        .status();
    assert!(status.unwrap().success());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_moment_survives_a_kill_right_after_it_was_listed() {
    let folder = TempDir::new().unwrap();
    let path = recorded(&folder, 30.0);
    let mut service = Service::start(&["tugger_01"]);
    let token = service.made_token(&["--role", "operator", "--name", "moments"]);
    let summary = send(sender(&service, &path, "tugger_01")).await;
    service.estimate_of("tugger_01", summary.drive_samples);
    let reported = r#"{"kind": "reassembled", "note": "bracket replaced"}"#;
    service.send("POST /api/v1/robots/tugger_01/events", &token, "", reported);
    let reassembled = wait_for("the moment of the reassembly", || {
        listed(&service)
            .into_iter()
            .find(|moment| moment["kind"] == "reassembled")
    });
    assert_eq!(reassembled["note"], "bracket replaced");
    let asked = "POST /api/v1/robots/tugger_01/moments?note=odd";
    let asked = service.send(asked, &token, "", "");
    let before = listed(&service);
    service.kill();
    service.restart();
    assert_eq!(listed(&service), before, "all that was listed is there");
    assert!(before.contains(&asked) && before.contains(&reassembled));

    let file = folder.path().join("moment.mcap");
    download(&service, &reassembled, &token, &file);
    let moment = Recording::open(&file).unwrap();
    let count = |stream: &str| moment.count(&[&format!("/tugger_01/{stream}")]);
    assert_eq!(count("scan"), summary.scans);
    assert_eq!(count("wheel_odometry"), summary.drive_samples);
    assert!(count("estimate") > 20, "{}", count("estimate"));
    if let Some(read) = rosbags::read(&file) {
        assert_eq!(read["/tugger_01/scan"]["count"], summary.scans);
        assert!(
            read["/tugger_01/estimate"]["last"]["parameters"].is_object(),
            "{read}"
        );
    }
    // Nobody sends: the ring of the new process is empty, and a request is refused.
    let path = "/api/v1/robots/tugger_01/moments";
    let asked = http::send(
        service.http(),
        &format!("POST {path}"),
        Some(&token),
        Some(("", "")),
    );
    let refused = asked.unwrap();
    assert_eq!(refused.status, 409, "{}", refused.body);
    assert!(refused.body.contains("robot_silent"), "{}", refused.body);
    assert_eq!(listed(&service), before, "nothing was kept");
    assert_eq!(service.status(&format!("{path}/1"), Some(&token)), 404);
}
