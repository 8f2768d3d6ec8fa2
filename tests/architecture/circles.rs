//! No circles: of files, of a crate's modules, and of the dashboard's files.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use petgraph::algo::tarjan_scc;
use petgraph::graphmap::DiGraphMap;

use super::rust_sources::{Crate, Edges};
use super::{dependencies, root, web_sources};

/// A crate of this workspace.
pub struct Member {
    /// Its name.
    pub package: &'static str,
    /// Its folder.
    pub folder: &'static str,
    /// Crates of this workspace that it uses, without the prefix `fleetcal-`.
    uses: &'static str,
}

impl Member {
    fn uses(&self) -> BTreeSet<String> {
        let names = self.uses.split_whitespace();
        names.map(|name| format!("fleetcal-{name}")).collect()
    }
}

const fn member(package: &'static str, folder: &'static str, uses: &'static str) -> Member {
    Member {
        package,
        folder,
        uses,
    }
}

/// Crates, lowest first.
pub const CRATES: [Member; 37] = [
    member("fleetcal-patience", "tests/patience", ""),
    member("fleetcal-ports", "tests/ports", ""),
    member("fleetcal-model", "proto/model", ""),
    member("fleetcal-description", "proto/description", "model"),
    member("fleetcal-proto", "proto", "model"),
    member("fleetcal-odometry", "odometry", "model"),
    member("fleetcal-estimator", "estimator", "model odometry"),
    member("fleetcal-checks", "estimator/checks", "model odometry"),
    member("fleetcal-robot", "robot", "model proto"),
    member("fleetcal-clock", "service/clock", "model"),
    member("fleetcal-limits", "service/limits", "model"),
    member("fleetcal-support", "service/support", "limits model"),
    member(
        "fleetcal-domain",
        "service/domain",
        "description estimator limits model proto",
    ),
    member(
        "fleetcal-certificate",
        "service/certificate",
        "domain model proto",
    ),
    member("fleetcal-rollout", "service/rollout", "domain model proto"),
    member("fleetcal-cluster", "service/cluster", "domain model proto"),
    member(
        "fleetcal-documents",
        "service/documents",
        "cluster domain model proto rollout",
    ),
    member(
        "fleetcal-store",
        "service/store",
        "clock cluster domain model proto rollout",
    ),
    member(
        "fleetcal-sql",
        "service/sql",
        "cluster domain model proto rollout store",
    ),
    member("fleetcal-folder", "service/folder", "model proto store"),
    member(
        "fleetcal-sqlite",
        "service/sqlite",
        "clock domain folder model proto sql store",
    ),
    member(
        "fleetcal-postgres",
        "service/postgres",
        "clock cluster domain model sql store",
    ),
    member(
        "fleetcal-contract",
        "service/contract",
        "clock cluster domain model ports postgres proto rollout sqlite store",
    ),
    member(
        "fleetcal-fleet",
        "service/fleet",
        "checks clock cluster description domain estimator model proto",
    ),
    member(
        "fleetcal-operations",
        "service/operations",
        "certificate clock cluster domain estimator fleet model proto robot rollout store",
    ),
    member(
        "fleetcal-moments",
        "service/moments",
        "clock domain fleet model operations",
    ),
    member(
        "fleetcal-link",
        "service/link",
        "clock cluster domain fleet model operations proto",
    ),
    member("fleetcal-statistics", "service/statistics", "domain model"),
    member("fleetcal-view", "service/view", "domain model"),
    member("fleetcal-http", "service/http", "clock domain"),
    member(
        "fleetcal-requests",
        "service/requests",
        "domain fleet http model operations proto rollout store",
    ),
    member(
        "fleetcal-metrics",
        "service/metrics",
        "cluster domain model proto",
    ),
    member(
        "fleetcal-api",
        "service/api",
        "certificate clock cluster documents domain estimator fleet http metrics model moments operations proto requests \
         rollout statistics store support view",
    ),
    member(
        "fleetcal-config",
        "service/config",
        "cluster domain estimator http proto store",
    ),
    member(
        "fleetcal-command",
        "service/command",
        "certificate clock config description domain estimator fleet model operations proto robot",
    ),
    member(
        "fleetcal",
        "service",
        "api clock cluster command config domain fleet folder http link model moments operations postgres proto \
         robot sql sqlite store support",
    ),
    member(
        "fleetcal-evaluation",
        "tests/evaluation",
        "checks estimator model robot",
    ),
];

/// Largest number of lines of a crate of the service, tests left out. It is a size at which to look
/// for a border, and no border by itself: 9,500 would have cut routes from the documents that they
/// answer with, decisions about proposals from those about alerts, retirement from the life cycle
/// that it ends, and actions on many robots from the single calls by whose code they decide.
const SERVICE_CRATE_LINES_MAX: usize = 11_000;

/// Returns the texts of the files below a folder with one of `endings`, by their paths below it.
fn texts(folder: &Path, endings: &[&str]) -> BTreeMap<String, String> {
    fn gather(root: &Path, folder: &Path, endings: &[&str], into: &mut BTreeMap<String, String>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(root).unwrap().to_string_lossy();
            if path.is_dir() {
                gather(root, &path, endings, into);
            } else if endings.iter().any(|ending| name.ends_with(ending)) {
                into.insert(name.into_owned(), fs::read_to_string(&path).unwrap());
            }
        }
    }
    let mut found = BTreeMap::new();
    gather(folder, folder, endings, &mut found);
    found
}

fn rust(folder: &str) -> BTreeMap<String, String> {
    texts(&root().join(folder).join("src"), &[".rs"])
}

fn web() -> BTreeMap<String, String> {
    let mut found = texts(&root().join("web/src"), &[".ts", ".svelte"]);
    found.retain(|name, _| !name.contains(".test."));
    found
}

/// Returns the sets whose members use each other, directly or through others of the set.
fn circles(edges: &Edges) -> Vec<BTreeSet<String>> {
    let mut graph = DiGraphMap::<&str, ()>::new();
    for (from, to) in edges {
        graph.add_edge(from, to, ());
    }
    let components = tarjan_scc(&graph).into_iter();
    components
        .filter(|component| component.len() > 1)
        .map(|component| component.into_iter().map(str::to_owned).collect())
        .collect()
}

/// Returns the circles of files and of modules.
fn circles_of(read: &Crate) -> Vec<BTreeSet<String>> {
    let mut found = circles(&read.files());
    found.extend(circles(&read.modules()));
    found
}

fn lines_without_tests(read: &Crate) -> usize {
    read.lines.values().sum()
}

#[test]
fn nothing_stands_in_a_circle() {
    let mut found = Vec::new();
    for member in &CRATES {
        let (package, folder) = (member.package, member.folder);
        let read = Crate::read(&rust(folder));
        let lines = lines_without_tests(&read);
        let uses = match member.uses {
            "" => "no other crate".to_owned(),
            names => names.replace(' ', ", "),
        };
        println!("{package:20} {lines:6} lines, uses {uses}");
        let of_crate = circles_of(&read).into_iter();
        found.extend(of_crate.map(|circle| (folder, circle)));
    }
    let files = web();
    let lines: usize = files.values().map(|text| text.lines().count()).sum();
    println!("{:20} {lines:6} lines, uses the HTTP API", "web");
    let in_web = circles(&web_sources::imports(&files)).into_iter();
    found.extend(in_web.map(|circle| ("web", circle)));

    println!("{} circles", found.len());
    assert!(found.is_empty(), "circles: {found:#?}");
}

#[test]
fn a_crate_uses_what_it_may() {
    for member in &CRATES {
        let mut ours = dependencies(member.package);
        ours.retain(|name| name.starts_with("fleetcal"));
        assert_eq!(ours, member.uses(), "{}", member.package);
    }
}

#[test]
fn a_crate_of_the_service_is_small_enough_to_know() {
    for member in CRATES.iter().filter(|c| c.folder.starts_with("service")) {
        let lines = lines_without_tests(&Crate::read(&rust(member.folder)));
        assert!(
            lines <= SERVICE_CRATE_LINES_MAX,
            "{}: got {lines} lines, expected at most {SERVICE_CRATE_LINES_MAX}",
            member.package
        );
    }
}

/// Returns the circles of a crate after `code` was put in front of one of its files.
fn with_planted(folder: &str, file: &str, code: &str) -> Vec<BTreeSet<String>> {
    let mut files = rust(folder);
    let text = files.get_mut(file).unwrap();
    let at = text.find("\nuse ").unwrap();
    text.insert_str(at + 1, code);
    circles_of(&Crate::read(&files))
}

#[test]
fn a_planted_circle_of_modules_is_found() {
    // Through the module's re-export, as anybody would write it.
    for code in [
        "use crate::approval::RobotLedger;\n",
        "fn planted(_: crate::approval::RobotLedger) {}\n",
        "macro_rules! planted { () => { crate::approval::RobotLedger } }\n",
    ] {
        let found = with_planted("service/domain", "access/name.rs", code);
        let has =
            |circle: &&BTreeSet<String>| circle.contains("access") && circle.contains("approval");
        assert!(found.iter().find(has).is_some(), "{code}{found:?}");
    }
}

#[test]
fn a_planted_circle_of_files_is_found() {
    let code = "use super::read::SqlReader;\n";
    let found = with_planted("service/sql", "row.rs", code);
    let files = ["read.rs", "row.rs"];
    let has = |circle: &BTreeSet<String>| files.iter().all(|file| circle.contains(*file));
    assert!(found.iter().any(has), "{found:?}");
}

#[test]
fn tests_may_use_what_they_like() {
    let code = "#[cfg(test)]\nuse crate::approval::RobotLedger;\n";
    assert_eq!(
        with_planted("service/domain", "access/name.rs", code),
        Vec::<BTreeSet<String>>::new()
    );
}

#[test]
fn a_planted_circle_of_the_dashboard_is_found() {
    let mut files = web();
    let client = files.get_mut("api/client.ts").unwrap();
    client.insert_str(0, "import { fleet } from '../fleet/fleet.svelte';\n");
    let found = circles(&web_sources::imports(&files));
    let has = |circle: &BTreeSet<String>| circle.contains("fleet/fleet.svelte.ts");
    assert!(found.iter().any(has), "{found:?}");
}
