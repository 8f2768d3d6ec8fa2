//! The data folder: who can read it, and what is refused when a part of it has gone.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::{Command, Stdio};

use fleetcal_ports::free_address;
use fleetcal_tests::binary;
use fleetcal_tests::service::Service;

/// Starts a service that is refused; returns its message.
fn refused(data: &Path) -> String {
    let output = Command::new(binary::path())
        .args(["serve", "--http", "127.0.0.1:0", "--data"])
        .arg(data)
        .args(["--listen", &format!("tcp/{}", free_address())])
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(74), "{said}");
    said
}

/// Makes a service that was killed, with its data as the kill left them.
fn killed() -> Service {
    let mut service = Service::start(&["tugger_01"]);
    service.kill();
    service
}

#[test]
fn only_its_owner_reads_the_database() {
    let mut service = Service::start(&["tugger_01"]);
    let files = ["fleetcal.db", "fleetcal.db-wal", "fleetcal.db-shm"];
    let modes = |service: &Service| {
        files.map(|file| {
            let metadata = fs::metadata(service.data().join(file)).unwrap();
            metadata.permissions().mode() & 0o777
        })
    };
    assert_eq!(modes(&service).map(|mode| format!("{mode:o}")), ["600"; 3]);
    // Files of an earlier version that others can read.
    service.kill();
    for file in files {
        let readable = fs::Permissions::from_mode(0o644);
        fs::set_permissions(service.data().join(file), readable).unwrap();
    }
    service.restart();
    assert_eq!(modes(&service).map(|mode| format!("{mode:o}")), ["600"; 3]);
    let backup = service.data().join("backup.db");
    let made = binary::run([
        "backup".as_ref(),
        "--data".as_ref(),
        service.data().as_os_str(),
        "--to".as_ref(),
        backup.as_os_str(),
    ]);
    assert!(made.status.success());
    let mode = fs::metadata(&backup).unwrap().permissions().mode() & 0o777;
    assert_eq!(mode, 0o600);
}

#[test]
fn a_signing_key_without_its_database_is_no_new_service() {
    let service = killed();
    for file in ["fleetcal.db", "fleetcal.db-wal", "fleetcal.db-shm"] {
        fs::remove_file(service.data().join(file)).unwrap();
    }
    let said = refused(&service.data());
    assert!(said.contains("fleetcal.db is gone"), "{said}");
    assert!(said.contains("signing.key"), "{said}");
    assert!(!service.data().join("fleetcal.db").exists());
}

#[test]
fn a_database_whose_log_is_gone_after_a_kill_is_refused() {
    let mut service = killed();
    let log = service.data().join("fleetcal.db-wal");
    let elsewhere = service.data().join("elsewhere");
    fs::rename(&log, &elsewhere).unwrap();
    let said = refused(&service.data());
    assert!(said.contains("fleetcal.db-wal is gone"), "{said}");
    // Once it is back, everything is.
    fs::rename(&elsewhere, &log).unwrap();
    service.restart();
    assert_eq!(service.robot("tugger_01")["id"], "tugger_01");
}
