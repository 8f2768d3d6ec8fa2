//! Maintenance tool over REST, as the example script does it.

use std::path::Path;
use std::process::{Command, Output};

use fleetcal_tests::service::Service;
use tempfile::TempDir;

use super::{recorded, sender};

/// What a person types: quotes and all.
const NOTE: &str = "LiDAR bracket 4\" replaced";

fn maintain(service: &Service, token: &str) -> Output {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    Command::new("sh")
        .arg(root.join("examples/rest/maintenance.sh"))
        .arg("tugger_01")
        .arg(NOTE)
        .env("FLEETCAL_URL", service.url())
        .env("FLEETCAL_TOKEN", token)
        .output()
        .unwrap()
}

/// What the script printed under a heading that begins so.
fn part<'a>(printed: &'a str, heading: &str) -> &'a str {
    let (_, behind) = printed.split_once(&format!("== {heading}")).unwrap();
    let (_, part) = behind.split_once('\n').unwrap();
    part.split("\n== ").next().unwrap()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_maintenance_tool_does_its_rounds_with_curl_alone() {
    let folder = TempDir::new().unwrap();
    let path = recorded(&folder, 90.0);
    let service = Service::start(&["tugger_01"]);
    let summary = super::send(sender(&service, &path, "tugger_01")).await;
    service.estimate_of("tugger_01", summary.drive_samples);

    let viewer = service.made_token(&["--role", "viewer", "--name", "wall"]);
    let refused = maintain(&service, &viewer);
    let said = String::from_utf8_lossy(&refused.stdout).into_owned();
    assert!(!refused.status.success(), "a viewer attaches no note");
    assert!(part(&said, "note").contains("not_permitted"), "{said}");

    let operator = service.made_token(&["--role", "operator", "--name", "maintenance"]);
    let done = maintain(&service, &operator);
    let said = String::from_utf8(done.stdout).unwrap();
    let errors = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(done.status.success(), "{said}\n{errors}");
    assert!(part(&said, "robots whose vehicle").contains("\"items\""));
    let mut history = part(&said, "history").lines();
    assert!(history.next().unwrap().starts_with("time,"), "{said}");
    assert!(history.count() >= 2, "{said}");
    let noted = part(&said, "note").to_owned();
    assert!(noted.contains(r#"LiDAR bracket 4\" replaced"#), "{noted}");
    assert!(
        part(&said, "proposal").contains("\"state\":\"proposed\""),
        "{said}"
    );
    let audit = part(&said, "audit");
    assert!(audit.contains("proposal.create"), "{said}");
    assert!(audit.contains("maintenance"), "by whom: {said}");

    // A second run of the same day notes nothing twice.
    let again = maintain(&service, &operator);
    let said = String::from_utf8(again.stdout).unwrap();
    assert_eq!(part(&said, "note"), noted);
}
