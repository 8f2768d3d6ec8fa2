//! Support bundle of a robot: complete, a readable archive, and without secrets.

use std::fs;
use std::process::Command;

use fleetcal_tests::service::Service;
use serde_json::Value;
use tempfile::TempDir;

use super::{recorded, send, sender};

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_support_bundle_has_what_it_lists_and_no_secret() {
    let folder = TempDir::new().unwrap();
    let path = recorded(&folder, 10.0);
    let service = Service::start(&["tugger_01"]);
    let admin = service.made_token(&["--role", "admin", "--name", "planter"]);
    let token = service.made_token(&["--role", "operator", "--name", "support"]);
    let planted = "planted-secret-4711";
    let webhook =
        format!(r#"{{"url": "https://hooks.example/{planted}", "events": ["proposal.waiting"]}}"#);
    let secret = service.send("POST /api/v1/webhooks", &admin, "", &webhook);
    let user = format!(r#"{{"name": "ada", "role": "viewer", "password": "{planted}-of-ada"}}"#);
    service.send("POST /api/v1/users", &admin, "", &user);
    let summary = send(sender(&service, &path, "tugger_01")).await;
    service.estimate_of("tugger_01", summary.drive_samples);
    let moment = service.send("POST /api/v1/robots/tugger_01/moments", &token, "", "");

    let listed = service.get("/api/v1/robots/tugger_01/support?list=true");
    let listed: Vec<&str> = listed["files"]
        .as_array()
        .unwrap()
        .iter()
        .map(|file| file["name"].as_str().unwrap())
        .collect();
    let recording = format!("moments/{}.mcap", moment["id"]);
    for name in [
        "about.json",
        "robot.json",
        "estimate.json",
        "checks.json",
        "shadow.json",
        "events.json",
        "log.txt",
        &recording,
    ] {
        assert!(listed.contains(&name), "{name} in {listed:?}");
    }
    let zip = folder.path().join("support.zip");
    let fetched = Command::new("curl")
        .args(["--silent", "--show-error", "--fail", "--output"])
        .arg(&zip)
        .args(["--header", &format!("Authorization: Bearer {token}")])
        .arg(format!("{}/api/v1/robots/tugger_01/support", service.url()))
        .status();
    assert!(fetched.unwrap().success());
    let script = "import json, sys, zipfile\nwith zipfile.ZipFile(sys.argv[1]) as archive:\n \
                  assert archive.testzip() is None\n print(json.dumps({name: \
                  archive.read(name).decode('latin-1') for name in archive.namelist()}))";
    let read = Command::new("python3")
        .args(["-c", script])
        .arg(&zip)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&read.stderr);
    assert!(read.status.success(), "{said}");
    let files: Value = serde_json::from_slice(&read.stdout).unwrap();
    let files = files.as_object().unwrap();
    assert_eq!(files.keys().collect::<Vec<_>>(), {
        let mut sorted = listed.clone();
        sorted.sort_unstable();
        sorted
    });
    let json =
        |name: &str| -> Value { serde_json::from_str(files[name].as_str().unwrap()).unwrap() };
    assert_eq!(json("robot.json")["config"]["wheelbase_m"], 1.2);
    assert!(json("estimate.json")["detection"].is_object());
    // Nothing in the archive is compressed but recordings, whose packed messages are the robot's.
    let key = fs::read(service.data().join("signing.key")).unwrap();
    let key_in_hex: String = key.iter().map(|byte| format!("{byte:02x}")).collect();
    let webhook_secret = secret["secret"].as_str().unwrap();
    let texts = [planted, &admin, &token, &key_in_hex, webhook_secret];
    let bytes = fs::read(&zip).unwrap();
    let has = |wanted: &[u8]| bytes.windows(wanted.len()).any(|part| part == wanted);
    for secret in texts.map(str::as_bytes).iter().chain([&key.as_slice()]) {
        assert!(secret.len() > 8 && !has(secret));
    }
    assert!(has(b"tugger_01"), "what is there is found");
}
