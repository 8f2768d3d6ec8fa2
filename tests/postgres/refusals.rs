//! Refusals of `fleetcal serve` without its database: a sentence and an exit status.

use std::fs;
use std::path::Path;
use std::process::Command;

use fleetcal_contract::own_server::{OwnServer, named, psql, url_of};
use fleetcal_store::database_url::PostgresUrl;
use fleetcal_tests::binary;
use tempfile::TempDir;

/// Exit status for wrong flags or files.
const USAGE: i32 = 2;
/// Exit status for failed reading, writing or connecting.
const IO: i32 = 74;

/// Asserts that `fleetcal serve` ends with a status and one sentence, which names all of `named`.
fn assert_refused(url: &str, password: Option<&Path>, status: i32, named: &[&str]) {
    let folder = TempDir::new().unwrap();
    let mut serve = Command::new(binary::path());
    serve.args(["serve", "--http", "127.0.0.1:0", "--database", url]);
    serve.arg("--data").arg(folder.path().join("data"));
    if let Some(file) = password {
        serve.arg("--database-password-file").arg(file);
    }
    let output = serve.env_remove("PGPASSFILE").output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(status), "{url}: {said}");
    assert!(!said.contains("secret"), "{said}");
    let sentence: Vec<_> = said
        .lines()
        .filter(|line| line.starts_with("fleetcal: "))
        .collect();
    assert_eq!(sentence.len(), 1, "{url}: {said}");
    for name in named {
        assert!(sentence[0].contains(name), "{name} is not in {said}");
    }
}

fn empty_database() -> PostgresUrl {
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let created = runtime.block_on(fleetcal_postgres::create_for_test(&named()));
    created.unwrap()
}

#[test]
fn a_url_that_is_wrong_is_refused_without_its_password() {
    let cases = [
        ("mysql://fleetcal@db/site", "postgres://"),
        ("postgres://fleetcal:secret@db/site", "password"),
        ("postgres://fleetcal@db/site?sslmode=maybe", "sslmode"),
        ("postgres://db/site", "USER@HOST"),
    ];
    for (url, name) in cases {
        assert_refused(url, None, USAGE, &["--database", name]);
    }
}

#[test]
fn a_server_that_is_not_there_is_named_with_every_host() {
    let url = url_of(&["127.0.0.1:1", "127.0.0.1:2"], "fleetcal", "site");
    assert_refused(&url.to_string(), None, IO, &["127.0.0.1:1", "127.0.0.1:2"]);
}

#[test]
fn a_password_that_is_wrong_or_absent_is_told() {
    let server = OwnServer::start_new("scram-sha-256");
    let url = server.url("postgres").to_string();
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("password");
    fs::write(&file, "wrong\n").unwrap();
    let named = ["refuses the user", "password authentication failed"];
    assert_refused(&url, Some(&file), IO, &named);
    let absent = folder.path().join("absent");
    assert_refused(&url, Some(&absent), IO, &["needs the password", "absent"]);
}

#[test]
fn a_database_a_right_or_a_schema_that_is_not_there_is_told() {
    let absent = PostgresUrl {
        database: "absent".to_owned(),
        ..named()
    };
    assert_refused(
        &absent.to_string(),
        None,
        IO,
        &["\"absent\" does not exist"],
    );
    let role = format!("fleetcal_powerless_serve_{}", std::process::id());
    psql(&named(), &format!("CREATE ROLE {role} LOGIN"));
    let powerless = PostgresUrl {
        user: role.clone(),
        ..empty_database()
    };
    let named = [role.as_str(), "CREATE on the schema public"];
    assert_refused(&powerless.to_string(), None, IO, &named);
    let newer = empty_database();
    let migrate = ["store", "migrate", "--database", &newer.to_string()];
    assert!(binary::run(migrate).status.success());
    psql(
        &newer,
        "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time)
         VALUES (29991231235959, 'later', true, '', 0)",
    );
    let named = ["29991231235959", "newer fleetcal"];
    assert_refused(&newer.to_string(), None, IO, &named);
}
