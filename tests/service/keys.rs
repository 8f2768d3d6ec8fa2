//! Replacement of the service's signing key under robots that hold a calibration.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use fleetcal_proto::signing::SigningKey;
use fleetcal_tests::binary;
use fleetcal_tests::service::{Service, wait_for};
use serde_json::{Value, json};
use tempfile::TempDir;

/// Simulated robots: one holds a calibration before the change, the other gets one after it.
const SIMULATED: [&str; 2] = ["tugger_01", "tugger_02"];
/// Robot that holds a calibration, whose agent is connected meanwhile.
const PRESENT: &str = "agent_01";
/// Robot without a calibration, whose agent is connected meanwhile.
const WITHOUT: &str = "agent_02";
/// Robot that is away during two changes, and longer than both keys count elsewhere.
const AWAY: &str = "agent_03";
/// Robot that knows the key of another service.
const LOST: &str = "agv_lost";

/// A process of the robots' side, killed when it goes out of scope.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended by itself, which a test has seen then.
        self.0.kill().ok();
        self.0.wait().ok();
    }
}

fn spawn(arguments: &[&str], log: &Path) -> Process {
    let log = std::fs::OpenOptions::new()
        .create(true)
        .append(true)
        .open(log);
    let child = Command::new(binary::path())
        .args(arguments)
        .stdout(Stdio::null())
        .stderr(log.unwrap())
        .spawn();
    Process(child.unwrap())
}

struct Site {
    service: Service,
    folder: TempDir,
    key: String,
    endpoint: String,
}

impl Site {
    fn start() -> Self {
        let configured = binary::run(["simulate", "--robots", "2", "--configuration"]);
        let mut config = String::from_utf8(configured.stdout).unwrap();
        for robot in [PRESENT, WITHOUT, AWAY, LOST] {
            let added = write!(
                config,
                "[[robot]]\nid = \"{robot}\"\nmodel = \"bicycle\"\nwheelbase_m = 1.2\n\
                 nominal_extrinsics = {{ x_m = 0.4, y_m = 0.0, yaw_rad = 0.0 }}\n\n"
            );
            added.unwrap();
        }
        let service = Service::start_with(&config);
        let key = public_key(&service);
        let endpoint = service.endpoint();
        let folder = TempDir::new().unwrap();
        Self {
            service,
            folder,
            key,
            endpoint,
        }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn agent(&self, robot: &str, key: &str) -> Process {
        let file = self.path(&format!("{robot}.json"));
        let file = file.to_str().unwrap();
        let arguments = ["agent", "--robot", robot, "--connect", &self.endpoint];
        let more = ["--apply", file, "--service-key", key];
        spawn(
            &[&arguments[..], &more[..]].concat(),
            &self.path("robots.log"),
        )
    }

    fn simulated(&self) -> Process {
        let arguments = ["simulate", "--robots", "2", "--connect", &self.endpoint];
        let more = ["--service-key", &self.key];
        spawn(
            &[&arguments[..], &more[..]].concat(),
            &self.path("robots.log"),
        )
    }

    /// Returns the memory of an agent.
    fn memory(&self, robot: &str) -> Value {
        let text = std::fs::read(self.path(&format!("{robot}.json.agent.json")));
        text.ok()
            .and_then(|text| serde_json::from_slice(&text).ok())
            .unwrap_or_default()
    }

    /// Replaces the key of the stopped service, and starts it again.
    fn rotate(&mut self, accepted_for: &str) {
        self.service.kill();
        let data = self.service.data();
        let place = ["key", "rotate", "--data", data.to_str().unwrap()];
        let rotated = binary::run(place.iter().chain(&["--accept-former-for", accepted_for]));
        let said = String::from_utf8_lossy(&rotated.stderr);
        assert!(rotated.status.success(), "{said}");
        self.service.restart();
        assert_ne!(public_key(&self.service), self.key);
    }
}

fn public_key(service: &Service) -> String {
    let key = service.get("/api/v1/signing-key")["public_key"].clone();
    key.as_str().unwrap().to_owned()
}

/// Proposes and approves a calibration, as many people as it needs.
fn approve(service: &Service, robot: &str, steering_offset_rad: f64) {
    let name = |role: &str| format!("{role}-{robot}-{steering_offset_rad}");
    let operator = service.made_token(&["--role", "operator", "--name", &name("operator")]);
    let mount = service.robot(robot)["config"]["nominal_extrinsics"].clone();
    let values = json!({"steering_offset_rad": steering_offset_rad, "lidar_x_m": mount["x_m"],
        "lidar_y_m": mount["y_m"], "lidar_yaw_rad": mount["yaw_rad"]});
    let body = json!({"robot": robot, "values": values, "reason": "by hand"}).to_string();
    let header = format!("Idempotency-Key: {}\r\n", name("once"));
    let mut proposal = service.send("POST /api/v1/proposals", &operator, &header, &body);
    let body = json!({"sha256": proposal["revision"]["sha256"]}).to_string();
    for number in 1..=3 {
        let approver = name(&format!("approver{number}"));
        let approver = service.made_token(&["--role", "approver", "--name", &approver]);
        let request = format!("POST /api/v1/proposals/{}/approve", proposal["id"]);
        let version = format!("If-Match: \"{}\"\r\n", proposal["version"]);
        proposal = service.send(&request, &approver, &version, &body);
        if proposal["state"] == "approved" {
            break;
        }
    }
    assert_eq!(proposal["state"], "approved", "{proposal}");
}

/// Waits until a robot has reported a generation as in use.
fn wait_until_used(site: &Site, robot: &str, generation: u64) {
    wait_for(&format!("generation {generation} of {robot}"), || {
        let shadow = site.service.get(&format!("/api/v1/robots/{robot}/shadow"));
        let is_used = shadow["reported"]["generation"] == generation
            && shadow["reported"]["status"] == "applied";
        is_used.then_some(())
    });
}

fn wait_until_settled(site: &Site, robot: &str) {
    wait_for(&format!("{robot} settled"), || {
        (site.memory(robot)["phase"]["resting"] == "settled").then_some(())
    });
}

#[test]
fn robots_take_a_new_signing_key_over_also_when_they_come_back_later() {
    let mut site = Site::start();
    let former = site.key.clone();
    let _simulated = site.simulated();
    let present = site.agent(PRESENT, &former);
    let _without = site.agent(WITHOUT, &former);
    let away = site.agent(AWAY, &former);
    for robot in [SIMULATED[0], PRESENT] {
        approve(&site.service, robot, 0.01);
        wait_until_used(&site, robot, 1);
    }
    wait_until_settled(&site, PRESENT);
    wait_until_settled(&site, AWAY);
    drop(away);
    let head = site.service.get("/api/v1/audit/head").to_string();
    std::fs::write(site.path("head.json"), head).unwrap();

    // One on the heels of the other.
    site.rotate("1m");
    site.rotate("1m");
    let new = public_key(&site.service);
    for robot in [PRESENT, WITHOUT] {
        wait_for("the new key on the robot's disk", || {
            let keys = site.memory(robot)["keys"].to_string();
            keys.contains(&new).then_some(())
        });
    }
    // A robot without a disk takes it over as well.
    approve(&site.service, SIMULATED[1], 0.01);
    // The other stays as it is; what it drives with is judged a minute of driving later.
    for robot in SIMULATED {
        wait_until_used(&site, robot, 1);
    }

    // The former key's time is over by the robots' clocks.
    for robot in [PRESENT, WITHOUT] {
        wait_for("the end of the former key", || {
            let keys = site.memory(robot)["keys"]["keys"].to_string();
            (!keys.contains(&former)).then_some(())
        });
    }
    drop(present);
    let _present = site.agent(PRESENT, &former);
    approve(&site.service, WITHOUT, 0.01);
    wait_until_used(&site, WITHOUT, 1);
    wait_until_used(&site, PRESENT, 1);
    wait_until_settled(&site, PRESENT);
    assert_eq!(site.memory(PRESENT)["held"]["generation"], 1);

    // Who was away follows the changes when it comes back.
    let away = site.agent(AWAY, &former);
    approve(&site.service, AWAY, 0.01);
    wait_until_used(&site, AWAY, 1);
    drop(away);

    // One to whose key no change is signed refuses, says why, and goes on once it is given the key.
    let stranger = SigningKey::from_bytes(&[9; 32]).public_key().to_string();
    let lost = site.agent(LOST, &stranger);
    approve(&site.service, LOST, 0.01);
    let refused = wait_for("the refusal of the robot that knows another key", || {
        let path = format!("/api/v1/robots/{LOST}/deployments?limit=1");
        let deployment = site.service.get(&path)["items"][0].clone();
        (deployment["state"] == "refused").then_some(deployment)
    });
    assert!(refused.to_string().contains("--service-key"), "{refused}");
    drop(lost);
    let _lost = site.agent(LOST, &new);
    approve(&site.service, LOST, 0.011);
    wait_until_used(&site, LOST, 2);

    heads_stay_verifiable(&site, &former);
}

/// Checks a head that the former key has signed, and one of the new key.
fn heads_stay_verifiable(site: &Site, former: &str) {
    let changes = site.path("signing-key.json");
    let answer = site.service.get("/api/v1/signing-key");
    std::fs::write(&changes, answer.to_string()).unwrap();
    let later = site.service.get("/api/v1/audit/head").to_string();
    std::fs::write(site.path("later.json"), later).unwrap();
    let data = site.service.data();
    let verify = |head: &str, key: &str, with_changes: bool| {
        let head = site.path(head);
        let mut arguments = vec!["audit", "verify", "--data", data.to_str().unwrap()];
        arguments.extend(["--head", head.to_str().unwrap(), "--key", key]);
        if with_changes {
            arguments.extend(["--key-changes", changes.to_str().unwrap()]);
        }
        let output = binary::run(arguments);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        (output.status.code(), said)
    };
    let new = public_key(&site.service);
    for (head, key, with_changes) in [
        ("head.json", former, false),
        ("later.json", former, true),
        ("later.json", &new, false),
    ] {
        let (status, said) = verify(head, key, with_changes);
        assert_eq!(status, Some(0), "{head} {with_changes}: {said}");
    }
    for (head, key, with_changes, needs) in [
        ("later.json", former, false, "--key-changes"),
        ("head.json", &new, true, former),
    ] {
        let (status, said) = verify(head, key, with_changes);
        assert_eq!(status, Some(1), "{head}: {said}");
        assert!(said.contains(needs), "{said}");
    }
}

#[test]
fn a_key_that_was_just_replaced_can_be_replaced_again() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("signing.key");
    std::fs::write(&file, [7; 32]).unwrap();
    let rotate = |span: &str| {
        let place = ["key", "rotate", "--signing-key", file.to_str().unwrap()];
        binary::run(place.iter().chain(&["--accept-former-for", span]))
    };
    let first = rotate("30d");
    let printed = String::from_utf8_lossy(&first.stdout).into_owned();
    assert!(
        first.status.success() && printed.contains("signing.key.changes"),
        "{printed}"
    );
    let key = std::fs::read(&file).unwrap();
    let short = rotate("59s");
    let said = String::from_utf8_lossy(&short.stderr).into_owned();
    assert_eq!(short.status.code(), Some(2), "{said}");
    assert!(said.contains("60 s at least"), "{said}");
    assert_eq!(std::fs::read(&file).unwrap(), key, "the key stays");
    assert!(rotate("1m").status.success());
    assert_ne!(std::fs::read(&file).unwrap(), key);
    let changes = std::fs::read_to_string(folder.path().join("signing.key.changes"));
    assert_eq!(changes.unwrap().lines().count(), 2);
}
