//! The crate graph is the architecture, and one crate knows each outside world: these tests keep
//! it so.

#![expect(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a test that cannot go on fails"
)]

mod circles;
mod dependencies;
mod documents;
mod rust_sources;
mod web_sources;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use circles::CRATES;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .ancestors()
        .nth(2)
        .unwrap()
        .to_path_buf()
}

/// Returns the names of a crate's normal dependencies (not of its tests or benches).
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
fn odometry_and_estimator_are_pure() {
    // `utoipa` describes settings in OpenAPI, and only where the HTTP API asks for it.
    let odometrys = ["fleetcal-model", "nalgebra", "serde", "thiserror", "utoipa"];
    assert_only("fleetcal-odometry", &odometrys);
    let estimators = [&odometrys[..], &["fleetcal-odometry"]].concat();
    assert_only("fleetcal-estimator", &estimators);
}

#[test]
fn the_joining_checks_are_pure() {
    assert_only(
        "fleetcal-checks",
        &["fleetcal-model", "fleetcal-odometry", "nalgebra"],
    );
}

#[test]
fn the_vocabulary_is_pure() {
    assert_only(
        "fleetcal-model",
        &["nalgebra", "serde", "strum", "thiserror", "utoipa"],
    );
}

#[test]
fn descriptions_are_read_purely() {
    assert_only(
        "fleetcal-description",
        &["fleetcal-model", "nalgebra", "roxmltree", "thiserror"],
    );
}

#[test]
fn what_travels_knows_no_transport() {
    assert_only(
        "fleetcal-proto",
        &[
            "base64",
            "ed25519-dalek",
            "fleetcal-model",
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
    for stranger in [
        "fleetcal",
        "fleetcal-odometry",
        "fleetcal-estimator",
        "axum",
    ] {
        assert!(
            !found.contains(stranger),
            "fleetcal-robot must not depend on {stranger}"
        );
    }
}

/// Returns every Rust file below a folder.
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

/// Returns the lines of code that name `word` as a path, comments left out.
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

/// Outside worlds of the service, and the only crates of it whose Cargo.toml names them.
const WORLDS: [(&[&str], &[&str]); 10] = [
    (&["zenoh"], &["fleetcal-link"]),
    (&["sqlx"], &["fleetcal-postgres", "fleetcal-sqlite"]),
    (
        &["axum", "tower"],
        &["fleetcal-api", "fleetcal-http", "fleetcal-requests"],
    ),
    (
        &[
            "tower-http",
            "utoipa-axum",
            "utoipa-swagger-ui",
            "rust-embed",
        ],
        &["fleetcal-api"],
    ),
    // HTTP comes in at the accept loop and goes out at the webhook dispatcher.
    (
        &["hyper", "hyper-util"],
        &["fleetcal-http", "fleetcal-operations"],
    ),
    (
        &["hyper-rustls", "rustls", "rustls-native-certs", "getrandom"],
        &["fleetcal-operations"],
    ),
    // Durations are measured where they pass, and written out by the API.
    (
        &["prometheus-client"],
        &[
            "fleetcal-api",
            "fleetcal-fleet",
            "fleetcal-metrics",
            "fleetcal-store",
        ],
    ),
    (&["clap"], &["fleetcal", "fleetcal-command"]),
    (&["indicatif"], &["fleetcal", "fleetcal-command"]),
    (&["plotters"], &["fleetcal-command"]),
];

#[test]
fn one_crate_of_the_service_knows_each_outside_world() {
    for member in CRATES.iter().filter(|c| c.folder.starts_with("service")) {
        let found = dependencies(member.package);
        for (names, knowing) in WORLDS {
            for name in names {
                assert!(
                    !found.contains(*name) || knowing.contains(&member.package),
                    "{} must not depend on {name}",
                    member.package
                );
            }
        }
    }
}

#[test]
fn the_domain_decides_and_knows_no_outside_world() {
    assert_only(
        "fleetcal-domain",
        &[
            "argon2",
            "base64",
            "fleetcal-description",
            "fleetcal-estimator",
            "fleetcal-limits",
            "fleetcal-model",
            "fleetcal-proto",
            "hex",
            "hmac",
            "jiff",
            "serde",
            "serde_json",
            "sha2",
            "strum",
            "subtle",
            "thiserror",
            "url",
            "utoipa",
        ],
    );
}

#[test]
fn one_module_knows_each_outside_world_within_a_crate() {
    // A robot's side keeps no database, but recordings of rosbag2 are some.
    assert_known_only_in("robot", "sqlx", &["recording"]);
    for word in [
        "hyper",
        "hyper_util",
        "hyper_rustls",
        "rustls",
        "rustls_native_certs",
    ] {
        let knowing = ["api_client.rs", "peers", "webhook_dispatcher"];
        assert_known_only_in("service/operations", word, &knowing);
    }
    assert_known_only_in("service/operations", "getrandom", &["entropy.rs"]);
}

#[test]
fn pure_crates_touch_no_outside_world() {
    for folder in [
        "odometry",
        "estimator",
        "estimator/checks",
        "proto",
        "proto/description",
        "proto/model",
        "service/certificate",
        "service/cluster",
        "service/domain",
        "service/limits",
        "service/rollout",
        "service/statistics",
        "service/view",
    ] {
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
    for member in &CRATES {
        let folder = member.folder;
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

/// Reads the documents for people, by their paths from the root.
fn documents() -> std::collections::BTreeMap<PathBuf, documents::Document> {
    let mut paths: Vec<PathBuf> = ["odometry/README.md", "estimator/README.md"]
        .map(PathBuf::from)
        .into();
    for folder in ["", "docs"] {
        for entry in fs::read_dir(root().join(folder)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|ending| ending == "md") {
                paths.push(path.strip_prefix(root()).unwrap().to_owned());
            }
        }
    }
    let read = |path: PathBuf| {
        let text = fs::read_to_string(root().join(&path)).unwrap();
        (path, documents::Document::parse(&text))
    };
    paths.into_iter().map(read).collect()
}

#[test]
fn every_link_of_a_document_leads_somewhere() {
    let documents = documents();
    let broken = documents::broken(&documents, |path| root().join(path).exists());
    assert!(broken.is_empty(), "{broken:#?}");
    let contents = &documents[Path::new("docs/SUMMARY.md")].links;
    for path in documents.keys().filter(|path| path.starts_with("docs")) {
        let name = path.file_name().unwrap().to_string_lossy();
        assert!(
            name == "SUMMARY.md" || contents.contains(&name.to_string()),
            "docs/SUMMARY.md does not list {name}"
        );
    }
}

/// Checks that figures of a campaign and its commit are on generated pages only.
#[test]
fn no_document_but_a_generated_one_names_a_commit() {
    for path in documents().keys() {
        if path == Path::new("docs/evaluation.md") {
            continue;
        }
        let text = fs::read_to_string(root().join(path)).unwrap();
        let commits = documents::commits(&text);
        assert!(commits.is_empty(), "{}: {commits:?}", path.display());
    }
    let planted =
        "Of 600 robots (4c6d5ed) none; see https://example.org/a/4c6d5ed0, 1234567, defaced.";
    assert_eq!(documents::commits(planted), ["4c6d5ed"]);
}

#[test]
fn documents_are_short_enough_to_be_read() {
    for &(path, most) in documents::WORDS_MAX {
        let whole = root().join(path);
        let files = if whole.is_dir() {
            texts(&whole)
        } else {
            vec![whole]
        };
        let documents = files
            .iter()
            .filter(|file| file.extension().is_some_and(|ending| ending == "md"));
        let words: usize = documents
            .map(|file| documents::words(&fs::read_to_string(file).unwrap()))
            .sum();
        assert!(
            (most / 2..=most).contains(&words),
            "{path} has {words} words of at most {most}"
        );
    }
    assert_eq!(documents::words("| 1.25 | --- | two words |"), 2);
}

#[test]
fn the_sources_that_architecture_names_are_there() {
    let named = &documents()[Path::new("ARCHITECTURE.md")].sources;
    assert!(named.len() > 20, "{named:?}");
    let folders = [
        "proto",
        "odometry",
        "estimator",
        "robot",
        "service",
        "tests",
    ];
    let sources: Vec<PathBuf> = folders
        .iter()
        .flat_map(|folder| sources(&root().join(folder)))
        .collect();
    let is_there = |name: &str| sources.iter().any(|source| source.ends_with(name));
    let gone: Vec<_> = named.iter().filter(|name| !is_there(name)).collect();
    assert!(gone.is_empty(), "{gone:?}");
}

#[test]
fn nobody_has_to_decode_a_word() {
    let mut files: Vec<PathBuf> = documents().into_keys().collect();
    files.push("fleetcal.example.toml".into());
    files.extend(
        ["web/src", "examples"]
            .iter()
            .flat_map(|folder| texts(&root().join(folder))),
    );
    files.extend(
        [
            "proto",
            "odometry",
            "estimator",
            "robot",
            "service",
            "tests",
            "examples",
        ]
        .iter()
        .flat_map(|folder| texts(&root().join(folder)))
        .filter(|path| path.extension().is_some_and(|ending| ending == "rs")),
    );
    let found: Vec<String> = files
        .iter()
        .flat_map(|path| {
            let text = fs::read_to_string(root().join(path)).unwrap_or_default();
            let name = path
                .strip_prefix(root())
                .unwrap_or(path)
                .display()
                .to_string();
            documents::not_used(&name, &text)
                .into_iter()
                .map(move |what| format!("{name}:{what}"))
        })
        .collect();
    assert!(found.is_empty(), "{found:#?}");
}

/// Returns every text file below a folder, except built and generated ones.
fn texts(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() && name != "target" {
            found.extend(texts(&path));
        } else if path.is_file() && name != "schema.d.ts" {
            found.push(path);
        }
    }
    found
}
