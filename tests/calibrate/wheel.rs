//! The Python wheel: made of the binary, installed into an environment of its own, and run there.

use std::env;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use fleetcal_tests::binary;
use serde_json::Value;
use tempfile::TempDir;

fn run<A: AsRef<OsStr>>(program: &Path, arguments: impl IntoIterator<Item = A>) -> Output {
    Command::new(program).args(arguments).output().unwrap()
}

/// Runs a command that succeeds; returns what it prints.
fn done(command: &mut Command) -> String {
    let output = command.output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {said}");
    String::from_utf8(output.stdout).unwrap()
}

/// Makes the wheel of the tested binary in a folder.
fn wheel(python: &OsStr, folder: &Path) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let [stage, out] = ["stage", "out"].map(|name| folder.join(name));
    fs::create_dir(&stage).unwrap();
    fs::create_dir(&out).unwrap();
    fs::copy(binary::path(), stage.join("fleetcal")).unwrap();
    fs::copy(root.join("LICENSE"), stage.join("LICENSE")).unwrap();
    let mut pack = Command::new(root.join("packaging/wheel.sh"));
    pack.env("PYTHON", python).arg(&stage).arg(&out);
    done(pack.arg(format!("linux_{}", env::consts::ARCH)));
    let mut made = fs::read_dir(&out).unwrap();
    made.next().unwrap().unwrap().path()
}

#[test]
fn an_installed_wheel_checks_a_recording() {
    let Some(python) = env::var_os("FLEETCAL_PYTHON").filter(|path| !path.is_empty()) else {
        eprintln!("skipped: FLEETCAL_PYTHON is not set; `make test` sets it");
        return;
    };
    let folder = TempDir::new().unwrap();
    let wheel = wheel(&python, folder.path());
    let fresh = folder.path().join("fresh");
    done(Command::new(&python).args(["-m", "venv"]).arg(&fresh));
    let pip = fresh.join("bin/pip");
    let install = ["install", "--disable-pip-version-check", "--no-index"];
    done(Command::new(&pip).args(install).arg(&wheel));
    let shown = done(Command::new(&pip).args(["show", "--files", "fleetcal"]));
    assert!(shown.contains("licenses/LICENSE"), "{shown}");

    let fleetcal = fresh.join("bin/fleetcal");
    let version = done(Command::new(&fleetcal).arg("--version"));
    assert_eq!(
        version.trim(),
        concat!("fleetcal ", env!("CARGO_PKG_VERSION"))
    );
    let drive = folder.path().join("drive.mcap");
    let drive = drive.to_str().unwrap();
    let simulate = ["simulate", "--record", drive, "--duration", "30"];
    done(
        Command::new(&fleetcal)
            .args(simulate)
            .args(["--wrong", "degrees"]),
    );
    let output = run(&fleetcal, ["doctor", drive, "--json", "--wheelbase", "1.2"]);
    assert_eq!(output.status.code(), Some(1));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let findings = report["findings"].as_array().unwrap();
    let is_named = |finding: &Value| finding["cause"] == "steering_degrees";
    assert!(findings.iter().any(is_named), "{report}");
}
