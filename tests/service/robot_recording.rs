//! A robot recorded as it drives: a file that others read, and that calibrates the same.

use std::path::Path;
use std::process::{Child, Command, Stdio};

use fleetcal_proto::ros::{LaserScan, Log, RosMessage};
use fleetcal_robot::recording::Recording;
use fleetcal_tests::rosbags;
use fleetcal_tests::service::{Service, wait_for};
use tempfile::TempDir;

use super::{assert_same, calibrated, recorded, send, sender};

/// Fetches a recording as a person does; it has begun once the answer's head is there.
fn fetch(service: &Service, robot: &str, query: &str, to: &Path) -> Child {
    let name = to.file_stem().unwrap().to_string_lossy();
    let token = service.made_token(&["--role", "operator", "--name", &name]);
    let head = to.with_extension("head");
    let fetching = Command::new("curl")
        .args([
            "--silent",
            "--show-error",
            "--fail",
            "--no-buffer",
            "--output",
        ])
        .arg(to)
        .arg("--dump-header")
        .arg(&head)
        .args(["--header", &format!("Authorization: Bearer {token}")])
        .arg(format!(
            "{}/api/v1/robots/{robot}/recording?{query}",
            service.url()
        ))
        .stderr(Stdio::inherit())
        .spawn()
        .unwrap();
    wait_for("the recording's begin", || {
        let head = std::fs::read_to_string(&head).ok()?;
        (head.contains("200 OK") && head.ends_with("\r\n\r\n")).then_some(())
    });
    fetching
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_recording_of_a_live_robot_calibrates_the_same() {
    let folder = TempDir::new().unwrap();
    let path = recorded(&folder, 30.0);
    let mut service = Service::start(&["tugger_01"]);
    let recorded = folder.path().join("recorded.mcap");
    let mut fetching = fetch(&service, "tugger_01", "duration_s=3600", &recorded);
    let summary = send(sender(&service, &path, "tugger_01")).await;
    let estimate = service.estimate_of("tugger_01", summary.drive_samples);
    let token = service.made_token(&["--role", "operator", "--name", "maintenance"]);
    service.send(
        "POST /api/v1/robots/tugger_01/events",
        &token,
        "",
        r#"{"kind": "maintenance", "note": "greased"}"#,
    );
    // The end of the service is that of the recording, which is whole.
    service.terminate();
    assert!(fetching.wait().unwrap().success());

    let recording = Recording::open(&recorded).unwrap();
    let count = |stream: &str| recording.count(&[&format!("/tugger_01/{stream}")]);
    assert_eq!(count("wheel_odometry"), summary.drive_samples);
    assert_eq!(count("scan"), summary.scans);
    assert!(count("estimate") >= 25, "{}", count("estimate"));
    let events = recording.messages(&["/tugger_01/events"]).unwrap();
    let events = events.map(|event| Log::from_cdr(&event.unwrap().payload).unwrap());
    let noted = events.filter(|event| event.msg.contains("maintenance: greased"));
    assert_eq!(noted.count(), 1);
    assert!(recording.count(&["/tf"]) > count("estimate"));
    for message in recording.messages(&["/tugger_01/scan"]).unwrap() {
        let message = message.unwrap();
        let scan = LaserScan::from_cdr(&message.payload).unwrap();
        assert_eq!(message.log_time_ns.cast_signed(), scan.header.stamp.as_ns());
    }
    assert_same(&estimate, &calibrated(&recorded));

    let Some(read) = rosbags::read(&recorded) else {
        return;
    };
    let topics = read.as_object().unwrap();
    assert!(
        topics
            .values()
            .all(|topic| topic["format"] == "cdr" && topic["qos"] == 1),
        "{read}"
    );
    let scans = &read["/tugger_01/scan"];
    assert_eq!(scans["type"], "sensor_msgs/msg/LaserScan");
    assert_eq!(scans["count"], summary.scans);
    assert_eq!(read["/tugger_01/events"]["last"], "maintenance: greased");
    assert_eq!(read["/tf"]["type"], "tf2_msgs/msg/TFMessage");
    let last = &read["/tugger_01/estimate"]["last"];
    assert_eq!(last["robot"], "tugger_01");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_recording_ends_by_itself_and_its_reader_may_go_in_the_middle() {
    let folder = TempDir::new().unwrap();
    let path = recorded(&folder, 10.0);
    let service = Service::start(&["tugger_01"]);
    let (short, left) = (
        folder.path().join("short.mcap"),
        folder.path().join("left.mcap"),
    );
    let mut short_fetching = fetch(&service, "tugger_01", "duration_s=2", &short);
    // This one goes away in the middle.
    let mut left_fetching = fetch(&service, "tugger_01", "duration_s=3600", &left);
    let leaving = tokio::task::spawn_blocking(move || {
        wait_for("the recording's first bytes", || {
            let left = std::fs::metadata(&left).ok()?;
            (left.len() > 0).then_some(())
        });
        left_fetching.kill().unwrap();
        left_fetching.wait().unwrap();
    });
    let sending = send(sender(&service, &path, "tugger_01"));
    let (summary, left) = tokio::join!(sending, leaving);
    left.unwrap();
    assert_eq!(summary.dropped, 0);
    assert!(short_fetching.wait().unwrap().success());
    Recording::open(&short).unwrap();
    let admin = service.made_token(&["--role", "admin", "--name", "asking"]);
    for (robot, query, wanted) in [
        ("tugger_01", "duration_s=0", 400),
        ("tugger_01", "duration_s=3601", 400),
        ("tugger_01", "seconds=1", 400),
        ("nobody", "", 404),
    ] {
        let path = format!("/api/v1/robots/{robot}/recording?{query}");
        assert_eq!(service.status(&path, Some(&admin)), wanted, "{path}");
    }
}
