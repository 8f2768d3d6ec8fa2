//! Commands beside a service on PostgreSQL: each works with `--database`, or says what does.

use std::fs;
use std::io::Write;
use std::process::{Command, Output, Stdio};

use fleetcal_contract::own_server::named;
use fleetcal_contract::{KeepRobot, TestDatabase, clock, config, event};
use fleetcal_tests::binary;
use fleetcal_tests::service::Service;
use tempfile::TempDir;

/// Runs a command with `--database` and a line on its standard input.
fn run(url: &str, arguments: &[&str], typed: &str) -> Output {
    let mut command = Command::new(binary::path());
    command.args(arguments).args(["--database", url]);
    command.stdin(Stdio::piped());
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let mut stdin = child.stdin.take().unwrap();
    // A command that asks for nothing does not read it.
    drop(stdin.write_all(typed.as_bytes()));
    drop(stdin);
    child.wait_with_output().unwrap()
}

fn said(output: &Output) -> String {
    let both = [output.stdout.as_slice(), output.stderr.as_slice()].concat();
    String::from_utf8(both).unwrap()
}

#[test]
fn tokens_and_users_are_made_beside_a_service_and_backups_elsewhere() {
    let service = Service::start(&["tugger_01"]);
    let note = service.data().with_extension("database");
    let url = fs::read_to_string(note).unwrap();
    let create = ["token", "create", "--role", "viewer", "--name", "wall"];
    let created = run(&url, &create, "");
    assert!(created.status.success(), "{}", said(&created));
    let token = String::from_utf8(created.stdout).unwrap();
    assert_eq!(service.status("/api/v1/robots", Some(token.trim())), 200);
    let add = ["user", "create", "--name", "ann", "--role", "operator"];
    let added = run(&url, &add, "a password of the test\n");
    assert!(added.status.success(), "{}", said(&added));
    let listed = run(&url, &["user", "list"], "");
    assert!(said(&listed).contains("ann"), "{}", said(&listed));

    let folder = TempDir::new().unwrap();
    let file = folder.path().join("backup.db");
    let refused = run(&url, &["backup", "--to", file.to_str().unwrap()], "");
    assert_eq!(refused.status.code(), Some(2), "{}", said(&refused));
    assert!(said(&refused).contains("pg_dump"), "{}", said(&refused));
    assert!(!file.exists());
}

/// Makes a data folder with a robot in it.
fn folder_with_a_robot() -> TempDir {
    let folder = TempDir::new().unwrap();
    let runtime = tokio::runtime::Runtime::new().unwrap();
    runtime.block_on(async {
        let address = folder.path().display().to_string();
        let store = TestDatabase::at(&address).open(clock()).await;
        let keep = KeepRobot(config(1.2), event("kept"));
        store.transact(keep).await.unwrap();
        store.close().await.unwrap();
    });
    folder
}

#[test]
fn records_are_copied_once_and_a_full_database_is_refused() {
    let folder = folder_with_a_robot();
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let created = runtime.block_on(fleetcal_postgres::create_for_test(&named()));
    let url = created.unwrap().to_string();
    let from = format!("sqlite:{}", folder.path().display());
    let copy = || binary::run(["store", "copy", "--from", &from, "--to", &url]);
    let copied = copy();
    assert!(copied.status.success(), "{}", said(&copied));
    assert!(said(&copied).contains("read again and found equal"));
    let again = copy();
    assert_eq!(again.status.code(), Some(74), "{}", said(&again));
    assert!(said(&again).contains("is not empty"), "{}", said(&again));
}
