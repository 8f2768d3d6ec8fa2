//! Commands that need no running service: what they print, and how they refuse.

use std::fs;

use fleetcal_tests::binary;

#[test]
fn a_configuration_is_checked_before_it_is_used() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("fleetcal.toml");
    fs::write(
        &file,
        "[[robot]]\nid = \"tugger_01\"\nmodel = \"bicycle\"\nwheelbase_m = 1.2\n",
    )
    .unwrap();
    let checked = binary::run(["check-config".as_ref(), file.as_os_str()]);
    let said = String::from_utf8_lossy(&checked.stdout).into_owned();
    assert!(checked.status.success(), "{said}");
    assert!(said.contains("valid, 1 robot configured"), "{said}");

    fs::write(&file, "[approval]\npropose_sigma = 3.0\n").unwrap();
    let refused = binary::run(["check-config".as_ref(), file.as_os_str()]);
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(2), "{said}");
    assert!(
        said.contains("line 2") && said.contains("propose_sigma"),
        "{said}"
    );
}

#[test]
fn the_example_configurations_are_valid() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
    for example in [
        "fleetcal.example.toml",
        "examples/deploy/cluster/fleetcal.toml",
    ] {
        let checked = binary::run(["check-config", &format!("{root}/{example}")]);
        let said = String::from_utf8_lossy(&checked.stderr).into_owned();
        assert!(checked.status.success(), "{example}: {said}");
    }
}

#[test]
fn each_command_has_a_manual_page() {
    let folder = tempfile::tempdir().unwrap();
    let written = binary::run(["man".as_ref(), folder.path().as_os_str()]);
    assert!(written.status.success());
    for page in ["fleetcal.1", "fleetcal-serve.1", "fleetcal-token-create.1"] {
        let text = fs::read_to_string(folder.path().join(page)).unwrap();
        assert!(text.contains(".SH OPTIONS"), "{page}: {text}");
    }
}
