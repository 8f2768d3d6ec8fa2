//! `fleetcal agent` as a process: killed at any moment, cut off for longer than its lease, and its
//! answers to wrong flags.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod link;
mod robot;
mod service;

use std::time::Duration;

use fleetcal_patience::until;
use fleetcal_proto::calibration::AppliedStatus;
use fleetcal_tests::binary;
use tempfile::TempDir;

use link::Link;
use robot::Robot;
use service::{Service, approved, key};

/// Number of kills of the agent.
const ROUNDS: u64 = 100;
/// Latest moment of the kills, from the start of the process on: they cover everything from before
/// its first action to after the confirmation of its acknowledgement.
const MOMENTS_MS: u64 = 160;
/// Time for which the link carries nothing: longer than the lease of Zenoh's transport, 10 s, so that
/// both ends give the connection up.
const CUT: Duration = Duration::from_secs(13);

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn killed_at_any_moment_it_never_applies_half_nor_falls_back_nor_stays_silent() {
    let service = Service::start().await;
    let mut robot = Robot::new();
    let mut held = 0;
    let (mut moved, mut killed_before_the_answer) = (0, 0);
    for generation in 1..=ROUNDS {
        service.approve(&approved(generation)).await;
        robot.start(&service.endpoint);
        // 61 shares no factor with the span: the moments are spread over all of it.
        let moment = Duration::from_millis(generation * 61 % MOMENTS_MS);
        tokio::time::sleep(moment).await;
        robot.kill();
        let now = robot.generation_in_file();
        assert!(now == held || now == generation, "{now} after {held}");
        moved += u64::from(now != held);
        killed_before_the_answer += u64::from(now != held && !service.has_applied(now));
        held = now;
    }
    println!(
        "killed {ROUNDS} times: {moved} times after the file was replaced, of which \
         {killed_before_the_answer} before the answer"
    );
    assert!(
        moved > 0 && moved < ROUNDS,
        "the moments are not spread: {moved}"
    );

    robot.start(&service.endpoint);
    let last = || service.has_applied(ROUNDS);
    until("the last one is answered", last).await;
    assert_eq!(robot.generation_in_file(), ROUNDS);
    until("the answer is known to be stored", || {
        robot.memory()["phase"]["resting"] == "settled"
    })
    .await;
    assert_eq!(robot.memory()["held"]["generation"], ROUNDS);
    robot.kill();
    service.assert_every_answer_is_true();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn cut_off_for_longer_than_its_lease_it_takes_the_newest_once() {
    let service = Service::start().await;
    let _token = service.token().await;
    let link = Link::to(&service.endpoint).await;
    let mut robot = Robot::new();
    service.approve(&approved(1)).await;
    robot.start(&link.endpoint);
    until("the first one is answered", || service.has_applied(1)).await;
    link.carries(false);
    service.approve(&approved(2)).await;
    service.approve(&approved(3)).await;
    tokio::time::sleep(CUT).await;
    assert_eq!(robot.generation_in_file(), 1);
    link.carries(true);
    until("the newest one is answered", || service.has_applied(3)).await;
    assert!(!service.has_applied(2));
    until("the answer is known to be stored", || {
        robot.memory()["phase"]["resting"] == "settled"
    })
    .await;
    assert_eq!(
        robot.calls(),
        ["check 1", "applied 1", "check 3", "applied 3"]
    );
    assert_eq!(robot.stop(), "tugger_01: holds calibration 3\n");
    let reverted = AppliedStatus::Reverted;
    assert!(
        service
            .answers()
            .iter()
            .all(|answer| answer.status != reverted)
    );
}

#[test]
fn wrong_flags_are_answered_in_one_sentence() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("calibration.json");
    let (file, key) = (file.to_str().unwrap(), key().public_key().to_string());
    let with = |file: &str, key: &str, endpoint: &str, more: &[&str]| {
        let robot = ["agent", "--robot", "tugger_01", "--connect", endpoint];
        let output = binary::run(
            robot
                .iter()
                .chain(&["--apply", file, "--service-key", key])
                .chain(more),
        );
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        (output.status.code(), said)
    };
    let endpoint = "tcp/127.0.0.1:1";
    for ((status, said), code, wanted) in [
        (with(file, "nonsense", endpoint, &[]), 2, "nonsense"),
        (
            with("calibration.ini", &key, endpoint, &[]),
            2,
            "expected a name ending in .yaml",
        ),
        (
            with("/nowhere/a.json", &key, endpoint, &[]),
            74,
            "/nowhere/a.json",
        ),
        (
            with(file, &key, "nonsense", &[]),
            2,
            "--connect <ENDPOINT>': got \"nonsense\", expected PROTOCOL/ADDRESS",
        ),
        (
            with(file, &key, endpoint, &["--limits", "/nowhere/limits.toml"]),
            74,
            "/nowhere/limits.toml",
        ),
        (
            with(file, &key, endpoint, &["--hook-arg", "x"]),
            2,
            "--hook",
        ),
        (
            with(
                file,
                &key,
                endpoint,
                &["--hook", "x", "--hook-timeout", "0"],
            ),
            2,
            "--hook-timeout",
        ),
    ] {
        assert_eq!(status, Some(code), "{said}");
        assert!(said.contains(wanted), "{said}");
    }
}

#[test]
fn the_help_says_what_a_hook_has_to_know() {
    let output = binary::run(["agent", "--help"]);
    let help = String::from_utf8(output.stdout).unwrap();
    for word in [
        "FLEETCAL_CALL",
        "check",
        "applied",
        "reverted",
        "75",
        "--service-key",
        "Exit status",
    ] {
        assert!(help.contains(word), "{word} is missing: {help}");
    }
}
