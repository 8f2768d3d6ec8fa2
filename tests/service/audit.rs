//! Audit that somebody changed behind the service's back.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use fleetcal_tests::service::Service;
use fleetcal_tests::{binary, http};

/// Runs a statement on the database, past the triggers that refuse it.
fn forge(data: &Path, statement: &str) {
    let program = "import sqlite3, sys; database = sqlite3.connect(sys.argv[1]); \
        database.executescript('DROP TRIGGER IF EXISTS audit_is_never_changed; \
        DROP TRIGGER IF EXISTS audit_is_never_deleted;' + sys.argv[2])";
    let forged = Command::new("python3")
        .args(["-c", program])
        .arg(data.join("fleetcal.db"))
        .arg(statement)
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&forged.stderr);
    assert!(forged.status.success(), "{errors}");
}

fn said(output: &Output) -> String {
    let parts = [&output.stdout, &output.stderr];
    parts.map(|part| String::from_utf8_lossy(part)).concat()
}

#[test]
fn an_audit_that_was_changed_behind_the_service_is_found_by_its_links() {
    let mut service = Service::start(&["robot_a"]);
    let folder = tempfile::tempdir().unwrap();
    for name in ["first", "second", "third"] {
        service.made_token(&["--role", "viewer", "--name", name]);
    }
    let head = folder.path().join("head.json");
    fs::write(&head, service.get("/api/v1/audit/head").to_string()).unwrap();
    let key = service.get("/api/v1/signing-key")["public_key"].clone();
    let kept = [
        "--head",
        head.to_str().unwrap(),
        "--key",
        key.as_str().unwrap(),
    ];
    let export = folder.path().join("audit.ndjson");
    let token = service.made_token(&["--role", "viewer", "--name", "reader"]);
    let rows = http::get(service.http(), "/api/v1/audit?format=ndjson", Some(&token)).unwrap();
    fs::write(&export, &rows.body).unwrap();

    let file = ["audit", "verify-file", export.to_str().unwrap()];
    let checked = binary::run(file.iter().chain(&kept));
    assert!(checked.status.success(), "{}", said(&checked));
    assert!(
        said(&checked).contains("none with a link was changed"),
        "{}",
        said(&checked)
    );
    fs::write(&export, rows.body.replace("\"second\"", "\"nobody\"")).unwrap();
    let changed = binary::run(file);
    assert_eq!(changed.status.code(), Some(1), "{}", said(&changed));

    service.kill();
    let data = service.data();
    let verify = ["audit", "verify", "--data", data.to_str().unwrap()];
    let whole = binary::run(verify.iter().chain(&kept));
    assert!(whole.status.success(), "{}", said(&whole));
    // Whoever removes the newest rows leaves an audit that is whole: the head outside shows it.
    forge(&data, "DELETE FROM audit WHERE id > 2");
    assert!(binary::run(verify).status.success());
    let cut = binary::run(verify.iter().chain(&kept));
    assert_eq!(cut.status.code(), Some(1), "{}", said(&cut));
    assert!(said(&cut).contains("is missing"), "{}", said(&cut));
    forge(
        &data,
        "UPDATE audit SET actor = 'somebody else' WHERE id = 2",
    );
    let changed = binary::run(verify);
    assert_eq!(changed.status.code(), Some(1), "{}", said(&changed));
    assert!(
        said(&changed).contains("row 2 of the audit"),
        "{}",
        said(&changed)
    );
}
