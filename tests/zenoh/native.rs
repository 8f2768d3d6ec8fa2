//! Native Zenoh configurations, by flag and by `ZENOH_CONFIG`, on both sides of the wire.

use std::fs;
use std::process::Command;

use fleetcal_ports::free_address;
use fleetcal_tests::service::Service;
use fleetcal_tests::{binary, recording};
use tempfile::TempDir;

use super::lists::wait_until_received;

#[test]
fn a_native_file_is_accepted_by_flag_and_by_environment() {
    let folder = TempDir::new().unwrap();
    let recorded = folder.path().join("robot.mcap");
    recording::simulated(&recorded, 5.0);
    let zenoh = free_address();
    let router = folder.path().join("router.json5");
    let text = format!(
        "// As zenohd has it: comments, names without quotes, a comma at the end.\n\
         {{ mode: 'router', listen: {{ endpoints: {{ router: ['tcp/{zenoh}'] }} }},\n\
         scouting: {{ multicast: {{ enabled: false }} }}, }}\n"
    );
    fs::write(&router, text).unwrap();
    let client = folder.path().join("client.json5");
    let text = format!("{{ mode: 'client', connect: {{ endpoints: ['tcp/{zenoh}'] }} }}");
    fs::write(&client, text).unwrap();
    let known = ["by_flag", "by_environment"]
        .map(|id| format!("[[robot]]\nid = \"{id}\"\nmodel = \"bicycle\"\nwheelbase_m = 1.2\n"));
    let service = Service::start_on(zenoh, &known.concat(), &["-c", router.to_str().unwrap()]);

    let replay = |robot: &str| {
        let mut command = Command::new(binary::path());
        command
            .arg("replay")
            .arg(&recorded)
            .args(["--rate", "max", "--robot", robot]);
        command
    };
    let by_flag = replay("by_flag").arg("-c").arg(&client).output().unwrap();
    let by_environment = replay("by_environment")
        .env("ZENOH_CONFIG", &client)
        .output();
    for output in [by_flag, by_environment.unwrap()] {
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{said}");
    }
    for robot in ["by_flag", "by_environment"] {
        wait_until_received(&service, robot, 500);
    }
    let output = replay("nobody")
        .env_remove("ZENOH_CONFIG")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("--connect"), "{said}");
}
