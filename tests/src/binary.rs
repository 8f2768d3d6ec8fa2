//! The built binary, run as a process of its own.

use std::env;
use std::ffi::OsStr;
use std::path::PathBuf;
use std::process::{Command, Output};

/// Returns the path of the binary: `FLEETCAL_BIN`, or the one that was built beside this test.
///
/// # Panics
/// When there is no binary.
pub fn path() -> PathBuf {
    let beside = || {
        let test = env::current_exe().expect("a test has a path");
        test.parent()?
            .parent()
            .map(|folder| folder.join("fleetcal"))
    };
    let binary = env::var_os("FLEETCAL_BIN")
        .map(PathBuf::from)
        .or_else(beside);
    match binary {
        Some(binary) if binary.is_file() => binary,
        other => panic!("{other:?} is not there: cargo build --release -p fleetcal"),
    }
}

/// Runs a command to its end.
///
/// # Panics
/// When it cannot be started.
pub fn run<A: AsRef<OsStr>>(arguments: impl IntoIterator<Item = A>) -> Output {
    Command::new(path())
        .args(arguments)
        .output()
        .expect("the binary runs")
}

/// Runs a command that succeeds and prints JSON.
///
/// # Panics
/// When it fails or prints anything else.
pub fn run_json<A: AsRef<OsStr>>(arguments: impl IntoIterator<Item = A>) -> serde_json::Value {
    let output = run(arguments);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{}: {errors}", output.status);
    serde_json::from_slice(&output.stdout).expect("JSON on standard output")
}
