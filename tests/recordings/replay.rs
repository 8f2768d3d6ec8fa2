//! Recordings as their robots would send them: the service finds what `calibrate` finds.

use fleetcal_tests::recording;
use fleetcal_tests::replayed::{replay_equals_calibrate, send, sender};
use fleetcal_tests::service::Service;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_figure_eight_replayed_gives_the_numbers_of_calibrate() {
    let Some(path) = recording::named("figure_eight.mcap") else {
        return;
    };
    replay_equals_calibrate(&path, "tugger_01").await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn every_message_of_a_recording_arrives() {
    for (file, drive_samples, poses) in [
        ("figure_eight.mcap", 12_000, 1_198),
        ("sapienza_tricycle.mcap", 2_434, 2_434),
    ] {
        let Some(path) = recording::named(file) else {
            return;
        };
        let service = Service::start(&["tugger_01"]);
        let summary = send(sender(&service, &path, "tugger_01")).await;
        assert_eq!(
            (summary.drive_samples, summary.scans),
            (drive_samples, poses)
        );
        assert_eq!((summary.dropped, summary.unconfirmed), (0, 0));
        let counters = service.accounts_of("tugger_01");
        assert_eq!(counters["received"], drive_samples + poses);
    }
}
