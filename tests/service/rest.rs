//! Maintenance tool over REST, as the example script does it.

use std::path::Path;
use std::process::{Command, Output};
use std::sync::Arc;

use fleetcal_tests::recording;
use fleetcal_tests::service::{Service, wait_for};
use tempfile::TempDir;

use super::{recorded, sender};

/// A typed note, with quotes.
const NOTE: &str = "LiDAR bracket 4\" replaced";

fn maintain(service: &Service, token: &str, note: &str) -> Output {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    Command::new("sh")
        .arg(root.join("examples/rest/maintenance.sh"))
        .arg("tugger_01")
        .arg(note)
        .env("FLEETCAL_URL", service.url())
        .env("FLEETCAL_TOKEN", token)
        .env("FLEETCAL_WAIT_S", "120")
        .output()
        .unwrap()
}

/// Returns the script's output under a heading with this beginning.
fn part<'a>(printed: &'a str, heading: &str) -> &'a str {
    let (_, behind) = printed.split_once(&format!("== {heading}")).unwrap();
    let (_, part) = behind.split_once('\n').unwrap();
    part.split("\n== ").next().unwrap()
}

/// Runs a tool that maintains the robot, which is driven again once its reassembly is reported;
/// returns the tool's output.
async fn maintained_and_driven(
    service: &Arc<Service>,
    token: &str,
    note: &'static str,
    drive: &Path,
) -> String {
    let (tool, token) = (Arc::clone(service), token.to_owned());
    let tool = tokio::task::spawn_blocking(move || maintain(&tool, &token, note));
    wait_for("the report reaches the estimator", || {
        let estimate = service.robot("tugger_01")["estimate"].clone();
        (estimate["reassembly_open"] == true).then_some(())
    });
    super::send(sender(service, drive, "tugger_01")).await;
    let done = tool.await.unwrap();
    let said = String::from_utf8(done.stdout).unwrap();
    let errors = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(done.status.success(), "{said}\n{errors}");
    said
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_maintenance_tool_does_its_rounds_with_curl_alone() {
    let folder = TempDir::new().unwrap();
    let path = recorded(&folder, 90.0);
    // Stamps go on, as those of one robot do.
    let [moved, cleaned] = [300, 600].map(|later_s| {
        let path = folder.path().join(format!("{later_s}-s-later.mcap"));
        recording::simulated_with(&path, 90.0, |config| {
            config.start_stamp_ns += later_s * 1_000_000_000;
            config.vehicle.lidar_in_base.yaw_rad += 1.2_f64.to_radians();
        });
        path
    });
    let service = Arc::new(Service::start(&["tugger_01"]));
    let summary = super::send(sender(&service, &path, "tugger_01")).await;
    service.estimate_of("tugger_01", summary.drive_samples);

    let viewer = service.made_token(&["--role", "viewer", "--name", "wall"]);
    let refused = maintain(&service, &viewer, NOTE);
    let said = String::from_utf8_lossy(&refused.stdout).into_owned();
    assert!(!refused.status.success(), "a viewer reports nothing");
    assert!(!said.contains("== verdict"), "{said}");

    let operator = service.made_token(&["--role", "operator", "--name", "maintenance"]);
    let said = maintained_and_driven(&service, &operator, NOTE, &moved).await;
    assert!(part(&said, "robots whose vehicle").contains("\"items\""));
    let mut history = part(&said, "history").lines();
    assert!(history.next().unwrap().starts_with("time,"), "{said}");
    assert!(history.count() >= 2, "{said}");
    let noted = part(&said, "report").to_owned();
    assert!(noted.contains(r#"LiDAR bracket 4\" replaced"#), "{noted}");
    let verdict = part(&said, "verdict");
    assert!(verdict.contains("calibration_changed"), "{said}");
    assert!(verdict.contains("\"state\":\"proposed\""), "{said}");
    let audit = part(&said, "audit");
    assert!(audit.contains("proposal.create"), "{said}");
    assert!(audit.contains("maintenance"), "by whom: {said}");

    // A second run of the same day reports nothing twice, and has the verdict at once.
    let again = maintain(&service, &operator, NOTE);
    let said = String::from_utf8(again.stdout).unwrap();
    assert_eq!(part(&said, "report"), noted);
    assert!(
        part(&said, "verdict").contains("calibration_changed"),
        "{said}"
    );

    // Nothing has moved since.
    let said = maintained_and_driven(&service, &operator, "LiDAR cleaned", &cleaned).await;
    let verdict = part(&said, "verdict");
    assert!(
        verdict.contains("unchanged") && !verdict.contains("proposed"),
        "{said}"
    );
}
