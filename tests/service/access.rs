//! Users and tokens over the command line, beside a running service.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use fleetcal_tests::binary;
use fleetcal_tests::database;
use fleetcal_tests::service::Service;
use tempfile::TempDir;

/// Runs `fleetcal user` with a password on standard input.
fn user(data: &Path, arguments: &[&str], password: &str) -> Output {
    let mut child = Command::new(binary::path())
        .arg("user")
        .args(arguments)
        .arg("--data")
        .arg(data)
        .envs(database::variable(data))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdin = child.stdin.take().unwrap();
    stdin.write_all(format!("{password}\n").as_bytes()).unwrap();
    drop(stdin);
    child.wait_with_output().unwrap()
}

fn run(data: &Path, arguments: &[&str]) -> Output {
    let output = Command::new(binary::path())
        .args(arguments)
        .arg("--data")
        .arg(data)
        .envs(database::variable(data))
        .stdin(Stdio::null())
        .output();
    output.unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn tokens_are_made_and_revoked_beside_a_running_service() {
    let service = Service::start(&["agv_1"]);
    let robots = "/api/v1/robots";
    assert_eq!(service.status(robots, None), 401);
    let viewer = service.made_token(&["--role", "viewer", "--name", "wall", "--expires", "30d"]);
    assert!(viewer.starts_with("cal_") && !viewer.contains('\n'));
    assert_eq!(service.status(robots, Some(&viewer)), 200);
    assert_eq!(service.status("/api/v1/users", Some(&viewer)), 403);
    let robot = service.made_token(&["--role", "robot", "--name", "agv_1", "--robot", "agv_1"]);
    assert_eq!(service.status(robots, Some(&robot)), 403);
    let listed = run(&service.data(), &["token", "list"]);
    let listed = String::from_utf8(listed.stdout).unwrap();
    let row = listed.lines().find(|line| line.ends_with("wall")).unwrap();
    assert!(!listed.contains(&viewer), "{listed}");
    let number = row.split_whitespace().next().unwrap();
    let revoked = run(&service.data(), &["token", "revoke", number]);
    assert!(revoked.status.success(), "{}", said(&revoked));
    assert_eq!(service.status(robots, Some(&viewer)), 401);
}

#[test]
fn users_are_made_and_kept_out_over_the_command_line() {
    // The service need not run, but has made the database.
    let mut service = Service::start(&[]);
    let data = service.data();
    service.terminate();
    let create = ["create", "--name", "ann", "--role", "admin"];
    let short = user(&data, &create, "secret");
    assert_eq!(short.status.code(), Some(2));
    assert!(
        said(&short).contains("expected 12 to 128"),
        "{}",
        said(&short)
    );
    let made = user(&data, &create, "correct horse battery");
    assert!(made.status.success(), "{}", said(&made));
    let again = user(&data, &create, "correct horse battery");
    assert!(
        said(&again).contains("the name ann is taken"),
        "{}",
        said(&again)
    );
    let last = run(&data, &["user", "disable", "--name", "ann"]);
    assert_eq!(last.status.code(), Some(2));
    assert!(
        said(&last).contains("last administrator"),
        "{}",
        said(&last)
    );
    let unknown = user(
        &data,
        &["password", "--name", "eve"],
        "another horse battery",
    );
    assert!(
        said(&unknown).contains("no user \"eve\""),
        "{}",
        said(&unknown)
    );
    let changed = user(
        &data,
        &["password", "--name", "ANN"],
        "another horse battery",
    );
    assert!(changed.status.success(), "{}", said(&changed));
    let listed = run(&data, &["user", "list"]);
    let listed = String::from_utf8(listed.stdout).unwrap();
    assert!(listed.contains("admin      enabled"), "{listed}");
}

#[test]
fn a_backup_of_a_running_service_can_be_served() {
    let service = Service::start(&["agv_1"]);
    let folder = TempDir::new().unwrap();
    let restored = folder.path().join("data");
    std::fs::create_dir(&restored).unwrap();
    let file = restored.join("fleetcal.db");
    let to = ["backup", "--to", file.to_str().unwrap()];
    for _ in 0..2 {
        let output = run(&service.data(), &to);
        assert!(output.status.success(), "{}", said(&output));
    }
    let mode = std::os::unix::fs::PermissionsExt::mode(&file.metadata().unwrap().permissions());
    assert_eq!(mode & 0o777, 0o600);
    assert!(!restored.join("fleetcal.db.tmp").exists());
    let listed = run(&restored, &["token", "list"]);
    let listed = String::from_utf8(listed.stdout).unwrap();
    assert!(
        listed.lines().any(|line| line.ends_with("tests")),
        "{listed}"
    );
    let nowhere = run(&folder.path().join("none"), &to);
    assert_eq!(nowhere.status.code(), Some(2));
    assert!(
        said(&nowhere).contains("there is no database"),
        "{}",
        said(&nowhere)
    );
}

#[test]
fn no_command_makes_anything_in_a_wrong_folder() {
    let folder = TempDir::new().unwrap();
    let empty = folder.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    for data in [folder.path().join("wrong"), empty.clone()] {
        let backup = folder.path().join("backup.db");
        let commands: [&[&str]; 6] = [
            &["token", "list"],
            &["token", "create", "--role", "viewer", "--name", "wall"],
            &["token", "revoke", "1"],
            &["user", "list"],
            &["user", "disable", "--name", "ann"],
            &["backup", "--to", backup.to_str().unwrap()],
        ];
        for command in commands {
            let refused = run(&data, command);
            assert_eq!(refused.status.code(), Some(2), "{command:?}");
            let said = said(&refused);
            assert!(said.contains("there is no database"), "{command:?}: {said}");
        }
        let create = ["create", "--name", "ann", "--role", "admin"];
        let refused = user(&data, &create, "correct horse battery");
        assert_eq!(refused.status.code(), Some(2), "{}", said(&refused));
        let made = std::fs::read_dir(&data).map_or(0, Iterator::count);
        assert_eq!(made, 0, "{}", data.display());
        assert_eq!(data.exists(), data == empty);
    }
}
