//! Support bundle of a robot: complete, a readable archive, and without secrets.

use std::fs;
use std::path::Path;
use std::process::Command;

use fleetcal_robot::fleet::{record_wrong, simulated_robots};
use fleetcal_robot::simulator::WrongInput;
use fleetcal_tests::binary;
use fleetcal_tests::service::{Service, wait_for};
use serde_json::Value;
use tempfile::TempDir;

use super::{send, sender};

/// Returns the files of an archive, by their names, as Python reads them.
fn unpacked(zip: &Path) -> Value {
    let script = "import json, sys, zipfile\nwith zipfile.ZipFile(sys.argv[1]) as archive:\n \
                  assert archive.testzip() is None\n print(json.dumps({name: \
                  archive.read(name).decode('latin-1') for name in archive.namelist()}))";
    let read = Command::new("python3")
        .args(["-c", script])
        .arg(zip)
        .output()
        .unwrap();
    let printed = String::from_utf8_lossy(&read.stderr);
    assert!(read.status.success(), "{printed}");
    serde_json::from_slice(&read.stdout).unwrap()
}

/// Returns the names of the files of a bundle, in their order, among them that of a moment.
fn listed(service: &Service, recording: &str) -> Vec<String> {
    let listed = service.get("/api/v1/robots/tugger_01/support?list=true");
    let files = listed["files"].as_array().unwrap().iter();
    let mut names: Vec<_> = files
        .map(|file| file["name"].as_str().unwrap().to_owned())
        .collect();
    for name in [
        "about.json",
        "robot.json",
        "estimate.json",
        "innovations.json",
        "checks.json",
        "shadow.json",
        "events.json",
        "log.txt",
        recording,
    ] {
        assert!(names.iter().any(|one| one == name), "{name} in {names:?}");
    }
    names.sort_unstable();
    names
}

/// Writes the same bundle by the command, which lists it first and needs a token.
fn written_by_the_command(service: &Service, token: &str, listed: &[String], folder: &Path) {
    let zip = folder.join("by_command.zip");
    let run = |token: &str, more: &[&str]| {
        let mut command = Command::new(binary::path());
        command.args(["support", "tugger_01", "--url", &service.url(), "--to"]);
        command.arg(&zip).args(more).env("FLEETCAL_TOKEN", token);
        command.output().unwrap()
    };
    let refused = run("", &[]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--token-file"));
    let refused = run("cal_nobody", &[]);
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(2), "{said}");
    assert!(said.contains("401"), "{said}");
    let names = |printed: &[u8]| -> Vec<String> {
        let printed = String::from_utf8_lossy(printed);
        let name = |line: &str| line.split_whitespace().nth(1).unwrap().to_owned();
        let mut names: Vec<_> = printed.lines().map(name).collect();
        names.sort_unstable();
        names
    };
    let only_listed = run(token, &["--list"]);
    assert!(only_listed.status.success() && !zip.exists());
    assert_eq!(names(&only_listed.stdout), listed);
    let written = run(token, &[]);
    assert!(written.status.success());
    let files = unpacked(&zip);
    assert!(files.as_object().unwrap().keys().eq(listed));
    assert!(String::from_utf8_lossy(&written.stdout).contains("written to"));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_support_bundle_has_what_it_lists_and_no_secret() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("coarse.mcap");
    let robots = simulated_robots(1, 7).unwrap();
    record_wrong(&robots[0], 10.0, &path, &[WrongInput::WholeSeconds]).unwrap();
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
    let warning = "what the robot sends looks wrong";
    wait_for("the warning", || {
        service.logged().contains(warning).then_some(())
    });
    let moment = service.send("POST /api/v1/robots/tugger_01/moments", &token, "", "");

    let listed = listed(&service, &format!("moments/{}.mcap", moment["id"]));
    let zip = folder.path().join("support.zip");
    let fetched = Command::new("curl")
        .args(["--silent", "--show-error", "--fail", "--output"])
        .arg(&zip)
        .args(["--header", &format!("Authorization: Bearer {token}")])
        .arg(format!("{}/api/v1/robots/tugger_01/support", service.url()))
        .status();
    assert!(fetched.unwrap().success());
    written_by_the_command(&service, &token, &listed, folder.path());
    let files = unpacked(&zip);
    let files = files.as_object().unwrap();
    assert!(files.keys().eq(&listed), "{listed:?}");
    let json =
        |name: &str| -> Value { serde_json::from_str(files[name].as_str().unwrap()).unwrap() };
    assert_eq!(json("robot.json")["config"]["wheelbase_m"], 1.2);
    assert!(json("estimate.json")["detection"].is_object());
    let log = files["log.txt"].as_str().unwrap();
    let mut lines = log.lines();
    assert!(
        lines.any(|line| line.contains("robot.id=tugger_01") && line.contains(warning)),
        "{log}"
    );
    // Nothing in the archive is compressed but recordings, whose packed messages are the robot's.
    let key = fs::read(service.data().join("signing.key")).unwrap();
    let key_in_hex = key
        .iter()
        .fold(String::new(), |text, byte| format!("{text}{byte:02x}"));
    let webhook_secret = secret["secret"].as_str().unwrap();
    let texts = [planted, &admin, &token, &key_in_hex, webhook_secret];
    let bytes = fs::read(&zip).unwrap();
    let has = |wanted: &[u8]| bytes.windows(wanted.len()).any(|part| part == wanted);
    for secret in texts.map(str::as_bytes).iter().chain([&key.as_slice()]) {
        assert!(secret.len() > 8 && !has(secret));
    }
    assert!(has(b"tugger_01"), "what is there is found");
}
