//! The service as a process: equal to `calibrate`, killed, flooded, and lied to.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod access;
mod audit;
mod bulk;
mod checks;
mod commands;
mod described;
mod folder;
mod hostile;
mod json_schema;
mod keys;
mod moments;
mod openapi;
mod rest;
mod robot_recording;
mod ros2;
mod support;

use std::net::TcpListener;
use std::path::PathBuf;
use std::time::Duration;

use fleetcal_ports::free_address;
use fleetcal_robot::recording::AskedTopic;
use fleetcal_robot::replay::{Pacing, Rate, replay};
use fleetcal_tests::replayed::{assert_same, calibrated, replay_equals_calibrate, send, sender};
use fleetcal_tests::rewritten::DriveAs;
use fleetcal_tests::service::{Service, wait_for};
use fleetcal_tests::{binary, clouds, recording, rewritten};
use serde_json::Value;
use tempfile::TempDir;

fn recorded(folder: &TempDir, duration_s: f64) -> PathBuf {
    let path = folder.path().join("robot.mcap");
    recording::simulated(&path, duration_s);
    path
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_replayed_recording_gives_the_numbers_of_calibrate() {
    let folder = TempDir::new().unwrap();
    replay_equals_calibrate(&recorded(&folder, 60.0), "tugger_01").await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_clouds_of_a_3d_scanner_replayed_give_the_numbers_of_calibrate() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("clouds.mcap");
    clouds::of_scans(&recorded(&folder, 30.0), &path);
    replay_equals_calibrate(&path, "tugger_01").await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn steering_and_speed_of_two_topics_replayed_give_the_numbers_of_calibrate() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("halves.mcap");
    rewritten::driven(&recorded(&folder, 30.0), &path, DriveAs::JointsAndOdometry);
    let known = format!(
        "[[robot]]\nid = \"tugger_01\"\nmodel = \"bicycle\"\nwheelbase_m = 1.2\n\
         [robot.streams]\nsteering = {{ topic = \"joint_states\", type = \
         \"sensor_msgs/msg/JointState\" }}\nspeed = {{ topic = \"odom\" }}\njoints = {}\n",
        rewritten::JOINTS
    );
    let config = folder.path().join("fleetcal.toml");
    std::fs::write(&config, &known).unwrap();
    let service = Service::start_with(&known);
    let mut options = sender(&service, &path, "tugger_01");
    let asked = |topic: &str, by| {
        let topic = topic.to_owned();
        Some(AskedTopic { topic, by })
    };
    options.topics.steering = asked("/tugger_01/joint_states", "steering");
    options.topics.speed = asked("/tugger_01/odom", "speed");
    let summary = send(options).await;
    assert_eq!((summary.dropped, summary.unconfirmed), (0, 0));
    let estimate = service.estimate_of("tugger_01", summary.drive_samples / 2);
    let (path, config) = (path.to_str().unwrap(), config.to_str().unwrap());
    let report = binary::run_json(["calibrate", path, "--config", config, "--json"]);
    assert_same(&estimate, &report);
    assert_eq!(service.robot("tugger_01")["pairing"]["unpaired"], 0);
}

/// Returns the seconds of history of a robot, oldest first.
fn history_of(service: &Service, robot: &str) -> Vec<Value> {
    let path = format!("/api/v1/robots/{robot}/history?parameter=lidar_x&max_points=5000");
    let history = service.try_get(&path);
    history
        .and_then(|history| history["time"].as_array().cloned())
        .unwrap_or_default()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_service_that_was_killed_keeps_its_history_and_goes_on() {
    let folder = TempDir::new().unwrap();
    let path = recorded(&folder, 120.0);
    let mut service = Service::start(&["tugger_01"]);
    let mut options = sender(&service, &path, "tugger_01");
    options.rate = Rate::Times(12.0);
    let sending = tokio::spawn(send(options));
    // Killed once a good part was committed, with more on the way.
    let before = wait_for("30 s of history", || {
        Some(history_of(&service, "tugger_01")).filter(|times| times.len() >= 30)
    });
    service.kill();
    service.restart();
    let shown = service.get("/api/v1/robots/tugger_01/estimate");
    assert_ne!(
        shown["parameters"]["lidar_x"]["status"], "unobservable",
        "it knows what it knew"
    );
    let summary = sending.await.unwrap();
    assert!(!summary.duration.is_zero());
    let after = wait_for("more history", || {
        Some(history_of(&service, "tugger_01")).filter(|times| times.len() > before.len() + 10)
    });
    assert!(
        before.iter().all(|time| after.contains(time)),
        "what was committed is there"
    );
    let robot = service.robot("tugger_01");
    assert_eq!(robot["state"], "calibrated", "{robot}");
    service.accounts_of("tugger_01");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_sender_that_does_not_wait_is_shed_and_counted() {
    let folder = TempDir::new().unwrap();
    let path = recorded(&folder, 120.0);
    let service = Service::start(&["paced", "flood"]);
    let paced = tokio::spawn(send(sender(&service, &path, "paced")));
    let mut options = sender(&service, &path, "flood");
    options.pacing = Pacing::Unpaced;
    let flood = send(options).await;
    let paced = paced.await.unwrap();
    assert_eq!(paced.dropped, 0, "the one that waits loses nothing");
    let counters = service.accounts_of("flood");
    let count = |name: &str| counters[name].as_u64().unwrap();
    assert_eq!(
        count("received"),
        flood.drive_samples + flood.scans,
        "{counters}"
    );
    assert!(count("dropped_scans") > 0, "{counters}");
    assert_eq!(count("refused"), 0);
    let estimate = service.estimate_of("paced", paced.drive_samples);
    assert_same(&estimate, &calibrated(&path));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_signal_ends_it_in_order_while_robots_send() {
    let folder = TempDir::new().unwrap();
    // At ten times its pace it is still sent when a busy machine has stored ten seconds of history.
    let path = recorded(&folder, 240.0);
    let mut service = Service::start(&["tugger_01"]);
    let mut options = sender(&service, &path, "tugger_01");
    options.rate = Rate::Times(10.0);
    options.stall_timeout = Duration::from_secs(1);
    let sending = tokio::spawn(replay(options, |_| {}));
    wait_for("10 s of history", || {
        Some(history_of(&service, "tugger_01")).filter(|times| times.len() >= 10)
    });
    let last = service.get("/api/v1/robots/tugger_01/estimate");
    let (status, took) = service.terminate();
    assert_eq!(status.code(), Some(0));
    assert!(took < Duration::from_secs(5), "{took:?}");
    assert!(sending.await.unwrap().is_err(), "the sender notices");
    service.restart();
    let shown = service.get("/api/v1/robots/tugger_01/estimate");
    let counted = |estimate: &Value| estimate["counts"]["drive_samples"].as_u64().unwrap();
    assert!(
        counted(&shown) >= counted(&last),
        "nothing that was shown is lost"
    );
    let robot = service.robot("tugger_01");
    assert!(robot["last_seen"].is_string(), "{robot}");
}

#[test]
fn a_configuration_that_cannot_be_is_refused_in_one_sentence() {
    let folder = TempDir::new().unwrap();
    let config = folder.path().join("fleetcal.toml");
    let cases = [
        ("htttp = \"127.0.0.1:1\"", "htttp"),
        (
            "[[robot]]\nid = \"a/b\"\nmodel = \"bicycle\"\nwheelbase_m = 1.0",
            "a/b",
        ),
        (
            "[[robot]]\nid = \"a\"\nmodel = \"bicycle\"\nwheelbase_m = -1.0",
            "wheelbase_m",
        ),
        ("listen = [\"nonsense\"]", "listen/endpoints"),
    ];
    for (text, wanted) in cases {
        std::fs::write(&config, text).unwrap();
        let data = folder.path().join("data");
        let output = binary::run([
            "serve",
            "--config",
            config.to_str().unwrap(),
            "--data",
            data.to_str().unwrap(),
            "--http",
            "127.0.0.1:0",
        ]);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(
            said.contains(wanted) && said.trim_end().lines().count() == 1,
            "{said}"
        );
    }
}

#[test]
fn what_zenoh_refuses_at_the_start_is_reported_once() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    recording::simulated(&folder.path().join("robot.mcap"), 1.0);
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let listen = format!("tcp/{}", taken.local_addr().unwrap());
    let nobody = format!("tcp/{}", free_address());
    let (data, robot) = (path("data"), path("robot.mcap"));
    let serve = [
        "serve",
        "--http",
        "127.0.0.1:0",
        "--data",
        &data,
        "--listen",
        &listen,
    ];
    let replay = ["replay", &robot, "--robot", "robot_a", "--connect", &nobody];
    for (words, wanted) in [(&serve[..], "in use"), (&replay[..], nobody.as_str())] {
        let output = binary::run(words);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success(), "{said}");
        assert!(
            said.contains(wanted) && said.trim_end().lines().count() == 1,
            "{said}"
        );
    }
}
