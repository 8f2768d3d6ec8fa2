//! The OpenAPI document as others' tools read it: valid, and good for a client.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use fleetcal_tests::service::Service;
use tempfile::TempDir;

use super::{recorded, send, sender};

/// Returns the Python with the packages of `tests/requirements.txt`.
pub(super) fn python() -> Option<OsString> {
    let python = std::env::var_os("FLEETCAL_PYTHON").filter(|path| !path.is_empty());
    if python.is_none() {
        eprintln!("skipped: FLEETCAL_PYTHON is not set; `make test` sets it");
    }
    python
}

/// Runs a module or program of that Python, whose tools are on the path.
pub(super) fn run(python: &OsStr, arguments: &[&OsStr], environment: &[(&str, &OsStr)]) -> Output {
    let tools = Path::new(python).parent().unwrap();
    let mut path = OsString::from(tools);
    path.push(":");
    path.push(std::env::var_os("PATH").unwrap_or_default());
    Command::new(python)
        .args(arguments)
        .env("PATH", path)
        .envs(environment.iter().copied())
        .output()
        .unwrap()
}

/// Returns the output of a tool, after checking that it succeeded without warnings.
pub(super) fn quiet(output: &Output) -> String {
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let warned = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}\n{warned}");
    assert!(warned.is_empty(), "{warned}");
    assert!(!said.to_lowercase().contains("warn"), "{said}");
    said
}

/// Saves the service's document.
fn saved(service: &Service, folder: &TempDir) -> PathBuf {
    let path = folder.path().join("openapi.json");
    let document = service.get("/api/v1/openapi.json");
    std::fs::write(&path, document.to_string()).unwrap();
    path
}

#[test]
fn a_public_validator_accepts_the_document() {
    let Some(python) = python() else { return };
    let folder = TempDir::new().unwrap();
    let service = Service::start(&[]);
    let document = saved(&service, &folder);
    let arguments = [
        "-m".as_ref(),
        "openapi_spec_validator".as_ref(),
        document.as_os_str(),
    ];
    let said = quiet(&run(&python, &arguments, &[]));
    assert!(said.trim_end().ends_with(": OK"), "{said}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_generated_client_works_with_typed_values() {
    let Some(python) = python() else { return };
    let folder = TempDir::new().unwrap();
    let path = recorded(&folder, 60.0);
    let service = Service::start(&["tugger_01"]);
    let summary = send(sender(&service, &path, "tugger_01")).await;
    service.estimate_of("tugger_01", summary.drive_samples);

    // 1. Generate the client. A warning is an operation or schema that it lacks.
    let document = saved(&service, &folder);
    let client = folder.path().join("fleetcal_client");
    let arguments: Vec<&OsStr> = vec![
        "-m".as_ref(),
        "openapi_python_client".as_ref(),
        "generate".as_ref(),
        "--path".as_ref(),
        document.as_os_str(),
        "--meta".as_ref(),
        "none".as_ref(),
        "--output-path".as_ref(),
        client.as_os_str(),
        "--fail-on-warning".as_ref(),
    ];
    quiet(&run(&python, &arguments, &[]));

    // 2. Use it against the service.
    let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("service/generated_client.py");
    let (url, token) = (
        service.url(),
        service.made_token(&["--role", "admin", "--name", "client"]),
    );
    let environment = [
        ("PYTHONPATH", folder.path().as_os_str()),
        ("FLEETCAL_URL", url.as_ref()),
        ("FLEETCAL_TOKEN", token.as_ref()),
    ];
    let said = quiet(&run(&python, &[program.as_os_str()], &environment));
    assert_eq!(said.lines().last(), Some("all typed"), "{said}");
    let registered = service.robot("tugger_02");
    assert_eq!(registered["config"]["wheelbase_m"], 1.55);
}
