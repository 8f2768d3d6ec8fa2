//! Joining checks of robots that send: a wrong input is named and spoils the estimate until then; of
//! robots that are right nothing is named.

use std::process::{Child, Command, Stdio};
use std::time::Duration;

use fleetcal_robot::fleet::{record_wrong, simulated_robots};
use fleetcal_robot::replay::Rate;
use fleetcal_robot::simulator::WrongInput;
use fleetcal_tests::service::{Service, now, wait_for};
use fleetcal_tests::{binary, recording};
use serde_json::Value;
use tempfile::TempDir;

use super::{send, sender};

const CONFIG: &str = "[alerts]\npending_s = 0\n\n[[robot]]\nid = \"tugger_01\"\nmodel = \"bicycle\"\n\
                      wheelbase_m = 1.2\n";

/// Way within which a sign is named, m: 20 m from the first turn, with the way to it.
const NAMED_WITHIN_M: f64 = 25.0;

/// Causes that are named, with their checks.
fn named(service: &Service, robot: &str) -> Vec<(Value, Value)> {
    let checks = service.get(&format!("/api/v1/robots/{robot}/checks"));
    let findings = checks["findings"].as_array().unwrap().iter();
    findings
        .filter(|finding| !finding["cause"].is_null())
        .map(|finding| (finding["check"].clone(), finding["cause"].clone()))
        .collect()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_wrong_sign_is_named_while_the_robot_drives_and_nothing_of_it_is_converged() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("wrong.mcap");
    let robots = simulated_robots(1, 7).unwrap();
    record_wrong(&robots[0], 45.0, &path, &[WrongInput::SteeringSign]).unwrap();
    let service = Service::start_with(CONFIG);
    let mut options = sender(&service, &path, "tugger_01");
    // The checks look once a second, so that a robot that drives faster is named later.
    options.rate = Rate::Times(1.0);
    let sending = tokio::spawn(send(options));
    let wrong = vec![("steering".into(), "steering_sign".into())];
    wait_for("the cause", || {
        (named(&service, "tugger_01") == wrong).then_some(())
    });
    let checks = service.get("/api/v1/robots/tugger_01/checks");
    let mut findings = checks["findings"].as_array().unwrap().iter();
    let finding = findings.find(|finding| finding["state"] == "wrong");
    let after_m = finding.unwrap()["after_m"].as_f64().unwrap();
    assert!(after_m < NAMED_WITHIN_M, "{after_m} m");
    // The estimator may have reported a fault before; the alert's words follow within 10 s.
    let what = wait_for("the alert", || {
        let alerts = service.get("/api/v1/alerts");
        let mut faults = alerts["items"].as_array()?.iter();
        let fault = faults.find(|alert| alert["kind"] == "fault")?["what"].as_str()?;
        fault.starts_with("steering: ").then(|| fault.to_owned())
    });
    assert!(what.contains("steering_gear = -1"), "{what}");
    let summary = sending.await.unwrap();
    let robot = service.robot("tugger_01");
    let mut warnings = robot["warnings"].as_array().unwrap().iter();
    assert!(warnings.any(|warning| warning["kind"] == "joining_check"));
    assert_eq!(
        service.metric("fleetcal_joining_checks{state=\"wrong\"}"),
        1
    );
    let estimate = service.estimate_of("tugger_01", summary.drive_samples);
    for (name, parameter) in estimate["parameters"].as_object().unwrap() {
        assert_ne!(parameter["status"], "converged", "{name}");
        if parameter["status"] == "learning" {
            let needs = parameter["needs"].as_str().unwrap();
            assert!(needs.starts_with("joining check of steering: "), "{needs}");
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_robot_that_is_right_is_ok_in_every_check_and_its_streams_are_counted() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("right.mcap");
    recording::simulated(&path, 60.0);
    let service = Service::start_with(CONFIG);
    let mut options = sender(&service, &path, "tugger_01");
    options.rate = Rate::Times(4.0);
    let summary = send(options).await;
    let checks = service.get("/api/v1/robots/tugger_01/checks");
    assert_eq!(named(&service, "tugger_01"), []);
    let findings = checks["findings"].as_array().unwrap();
    let ok = findings.iter().filter(|finding| finding["state"] == "ok");
    assert!(ok.count() >= 7, "{findings:?}");
    let streams = checks["streams"].as_array().unwrap();
    let sent = [
        ("wheel_odometry", summary.drive_samples),
        ("scan", summary.scans),
    ];
    for (stream, (name, messages)) in streams.iter().zip(sent) {
        assert_eq!(stream["stream"], name);
        // The report is up to a second old.
        let counted = stream["messages"].as_u64().unwrap();
        assert!(counted <= messages && counted > messages / 2, "{stream}");
    }
    assert_eq!(service.status("/api/v1/robots/nobody/checks", None), 401);
}

/// A simulator, which ends with the test.
struct Simulator(Child);

impl Drop for Simulator {
    fn drop(&mut self) {
        drop(self.0.kill());
        drop(self.0.wait());
    }
}

#[test]
fn nothing_is_named_of_the_six_robots_of_the_simulator() {
    let robots = ["simulate", "--robots", "6"];
    let configuration = binary::run([&robots[..], &["--configuration"]].concat());
    let configuration = String::from_utf8(configuration.stdout).unwrap();
    let service = Service::start_with(&configuration);
    let simulator = Command::new(binary::path())
        .args(robots)
        .args(["--connect", &service.endpoint()])
        .stdout(Stdio::null())
        .spawn();
    let _simulator = Simulator(simulator.unwrap());
    let began = now();
    let mut way_m = 0.0_f64;
    while began.elapsed() < Duration::from_secs(50) {
        std::thread::sleep(Duration::from_secs(1));
        let list = service.get("/api/v1/robots");
        let ids = list["items"].as_array().unwrap().iter();
        for id in ids.map(|robot| robot["id"].as_str().unwrap()) {
            assert_eq!(named(&service, id), [], "{id}");
            let checks = service.get(&format!("/api/v1/robots/{id}/checks"));
            way_m = way_m.max(checks["way_m"].as_f64().unwrap());
        }
    }
    assert!(way_m > 20.0, "{way_m}");
}
