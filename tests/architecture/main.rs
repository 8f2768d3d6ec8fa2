//! The crate graph is the architecture, and one module knows each outside world: these tests keep
//! it so.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .unwrap()
        .to_path_buf()
}

/// Names of a crate's normal dependencies (not of its tests or benches).
fn dependencies(package: &str) -> BTreeSet<String> {
    let output = Command::new(env!("CARGO"))
        .args([
            "metadata",
            "--no-deps",
            "--format-version",
            "1",
            "--offline",
        ])
        .current_dir(root())
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let packages = metadata["packages"].as_array().unwrap();
    let found = packages.iter().find(|p| p["name"] == package).unwrap();
    found["dependencies"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|dependency| dependency["kind"].is_null())
        .map(|dependency| dependency["name"].as_str().unwrap().to_owned())
        .collect()
}

fn assert_only(package: &str, allowed: &[&str]) {
    let allowed: BTreeSet<String> = allowed.iter().map(|&name| name.to_owned()).collect();
    let found = dependencies(package);
    let strangers: Vec<_> = found.difference(&allowed).collect();
    assert!(
        strangers.is_empty(),
        "{package} must not depend on {strangers:?}"
    );
}

#[test]
fn the_estimator_is_pure() {
    assert_only("fleetcal-estimator", &["nalgebra", "serde", "thiserror"]);
}

#[test]
fn what_travels_knows_no_transport() {
    assert_only(
        "fleetcal-proto",
        &[
            "base64",
            "ed25519-dalek",
            "serde",
            "serde_json",
            "serde_path_to_error",
            "sha2",
            "thiserror",
            "utoipa",
        ],
    );
}

#[test]
fn the_robots_side_knows_neither_service_nor_estimator() {
    let found = dependencies("fleetcal-robot");
    for stranger in ["fleetcal", "fleetcal-estimator", "axum"] {
        assert!(
            !found.contains(stranger),
            "fleetcal-robot must not depend on {stranger}"
        );
    }
}

/// Every Rust file below a folder.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            found.push(path);
        }
    }
    found
}

/// Lines of code that name `word` as a path, comments left out.
fn uses(path: &Path, word: &str) -> Vec<String> {
    let text = fs::read_to_string(path).unwrap();
    text.lines()
        .map(str::trim)
        .filter(|line| !line.starts_with("//"))
        .filter(|line| {
            line.contains(&format!("{word}::")) || line.contains(&format!("use {word};"))
        })
        .map(str::to_owned)
        .collect()
}

fn assert_known_only_in(crate_folder: &str, word: &str, rooms: &[&str]) {
    let source = root().join(crate_folder).join("src");
    for path in sources(&source) {
        let inside = path.strip_prefix(&source).unwrap();
        if rooms.iter().any(|room| inside.starts_with(room)) {
            continue;
        }
        let found = uses(&path, word);
        assert!(
            found.is_empty(),
            "{} knows {word}: {found:?}",
            inside.display()
        );
    }
}

#[test]
fn one_module_of_the_service_knows_each_outside_world() {
    assert_known_only_in("service", "zenoh", &["link"]);
    assert_known_only_in("service", "sqlx", &["store"]);
    // A robot's side keeps no database, but recordings of rosbag2 are some.
    assert_known_only_in("robot", "sqlx", &["recording"]);
    for word in ["axum", "tower", "tower_http", "utoipa_axum"] {
        assert_known_only_in("service", word, &["api"]);
    }
    // HTTP comes in at the API and goes out at the courier.
    for word in ["hyper", "hyper_util"] {
        assert_known_only_in("service", word, &["api", "courier"]);
    }
    for word in ["hyper_rustls", "rustls"] {
        assert_known_only_in("service", word, &["courier"]);
    }
}

#[test]
fn pure_crates_touch_no_outside_world() {
    for folder in ["estimator", "proto"] {
        for word in [
            "std::fs",
            "std::net",
            "std::process",
            "std::thread",
            "std::env",
        ] {
            assert_known_only_in(folder, word, &[]);
        }
    }
}

#[test]
fn files_say_what_they_hold_and_stay_readable() {
    let nameless = [
        "util", "utils", "helper", "helpers", "common", "misc", "manager",
    ];
    for folder in ["proto", "estimator", "robot", "service", "tests/evaluation"] {
        for path in sources(&root().join(folder).join("src")) {
            let stem = path.file_stem().unwrap().to_string_lossy().into_owned();
            assert!(
                !nameless.contains(&stem.as_str()),
                "{} names nothing",
                path.display()
            );
            let lines = fs::read_to_string(&path).unwrap().lines().count();
            assert!(
                lines <= 600,
                "{} has {lines} lines: split it",
                path.display()
            );
        }
    }
}
