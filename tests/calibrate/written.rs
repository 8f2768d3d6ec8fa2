//! Files that `calibrate` writes besides its result: the page, and the session for Foxglove.

use std::fs;
use std::path::Path;

use fleetcal_proto::ros::{Estimate, LaserScan, RosMessage};
use fleetcal_robot::recording::Recording;
use fleetcal_tests::rewritten::{Rewritten, rewritten};
use fleetcal_tests::{binary, recording, rosbags};
use tempfile::TempDir;

use super::{assert_refused, calibrate};

/// Checks what a report says, and that it loads nothing.
fn assert_needs_nothing_else(html: &str) {
    // Five parameters, NIS, three innovations and the path, each with its numbers.
    assert!(html.matches("<svg").count() >= 10, "figures");
    assert_eq!(
        html.matches("<svg").count(),
        html.matches("<details>").count()
    );
    for told in [
        "The model explains the data",
        "NIS, the normalised innovation squared",
        "Innovation in yaw",
        "<h2>Events</h2>",
        "<h2>Correlations</h2>",
        "light-dark(",
        concat!("by fleetcal ", env!("CARGO_PKG_VERSION")),
        " UTC",
    ] {
        assert!(html.contains(told), "{told}");
    }
    assert!(html.contains("robot &lt;b&gt;.mcap") && !html.contains("robot <b>"));
    for foreign in ["<script", "<link", "<img", "src=", "@import", "url("] {
        assert!(!html.contains(foreign), "{foreign}");
    }
    assert!(html.contains("default-src 'none'"));
    // Letters of the figures are readable where a phone shows the figure as narrow as it may be.
    let number = |text: &str| -> f64 {
        let end = text.find(|c: char| c != '.' && !c.is_ascii_digit());
        text[..end.unwrap()].parse().unwrap()
    };
    let after = |mark: &str| number(html.split_once(mark).unwrap().1);
    let shown = after("svg{min-width:") / after("viewBox=\"0 0 ");
    let letters: Vec<f64> = html.split("font-size=\"").skip(1).map(number).collect();
    assert!(letters.len() > 50);
    let smallest_px = letters.into_iter().fold(f64::MAX, f64::min) * shown;
    assert!(smallest_px > 11.9, "{smallest_px} px");
}

#[test]
fn the_report_needs_nothing_else_and_the_session_holds_what_was_found() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("robot <b>.mcap");
    recording::simulated(&path, 20.0);
    let (page, session) = (
        folder.path().join("out.html"),
        folder.path().join("out.mcap"),
    );
    let [recorded, report, export] = [&path, &page, &session].map(|path| path.to_str().unwrap());
    let flags = [
        "--wheelbase",
        "1.2",
        "--json",
        "--report",
        report,
        "--export",
        export,
    ];
    let found = binary::run_json([["calibrate", recorded].as_slice(), &flags].concat());

    assert_needs_nothing_else(&fs::read_to_string(&page).unwrap());
    let session = Recording::open(&session).unwrap();
    let original = Recording::open(&path).unwrap();
    let count = |recording: &Recording, topic: &str| recording.count(&[topic]);
    for topic in ["/tugger_01/scan", "/tugger_01/wheel_odometry"] {
        assert_eq!(count(&session, topic), count(&original, topic), "{topic}");
    }
    assert!(count(&session, "/tugger_01/estimate") >= 15);
    assert!(count(&session, "/tf") > count(&session, "/tugger_01/estimate"));
    // The last estimate in it is the one that was printed, but for what came in its last second.
    let estimates = session.messages(&["/tugger_01/estimate"]).unwrap();
    let last = estimates.last().unwrap().unwrap();
    let last = Estimate::from_cdr(&last.payload).unwrap();
    let last: serde_json::Value = serde_json::from_str(&last.document).unwrap();
    let of = |document: &serde_json::Value, what: &str| {
        let value = &document["parameters"]["lidar_x"][what];
        value.as_f64().unwrap()
    };
    let apart = (of(&last, "value") - of(&found, "value")).abs();
    assert!(apart < of(&last, "sigma"), "{apart} m apart");
    // All of it is logged by the robot's clock, whatever the recorder's was.
    for message in session.messages(&["/tugger_01/scan"]).unwrap() {
        let message = message.unwrap();
        let scan = LaserScan::from_cdr(&message.payload).unwrap();
        assert_eq!(message.log_time_ns.cast_signed(), scan.header.stamp.as_ns());
    }
    if let Some(read) = rosbags::read(Path::new(export)) {
        assert_eq!(read["/tugger_01/estimate"]["last"], last);
        let scans = original.count(&["/tugger_01/scan"]);
        assert_eq!(read["/tugger_01/scan"]["count"], scans);
        let is_cdr = |topic: &serde_json::Value| topic["format"] == "cdr" && topic["qos"] == 1;
        assert!(read.as_object().unwrap().values().all(is_cdr), "{read}");
    }
    // What was written can be calibrated again.
    let again = binary::run_json(["calibrate", export, "--wheelbase", "1.2", "--json"]);
    assert_eq!(again["parameters"], found["parameters"]);
}

#[test]
fn what_was_refused_is_not_in_the_session() {
    let folder = TempDir::new().unwrap();
    let (whole, path, session) = (
        folder.path().join("whole.mcap"),
        folder.path().join("robot.mcap"),
        folder.path().join("out.mcap"),
    );
    recording::simulated(&whole, 5.0);
    let (mut drives, mut cut) = (0, 0);
    rewritten(&whole, &path, |message_type, message| {
        let mut message = Rewritten::unchanged(message_type, message);
        if message.topic == "/tugger_01/wheel_odometry" {
            drives += 1;
            if drives % 10 == 0 {
                cut += 1;
                message.payload.truncate(6);
            }
        }
        vec![message]
    });
    let export = ["--wheelbase", "1.2", "--export", session.to_str().unwrap()];
    let output = calibrate(&path, &export);
    let said = String::from_utf8_lossy(&output.stderr);
    let refused = format!("{cut} of {drives} messages of /tugger_01/wheel_odometry were refused");
    assert!(output.status.success() && said.contains(&refused), "{said}");
    let session = Recording::open(&session).unwrap();
    assert!(cut > 0);
    assert_eq!(session.count(&["/tugger_01/wheel_odometry"]), drives - cut);
}

#[test]
fn no_file_of_the_recording_is_written_over() {
    let folder = TempDir::new().unwrap();
    let [messages, metadata] = ["bag_0.mcap", "metadata.yaml"].map(|name| folder.path().join(name));
    recording::simulated(&messages, 1.0);
    let known = "rosbag2_bagfile_information: {relative_file_paths: [bag_0.mcap]}";
    fs::write(&metadata, known).unwrap();
    let before = fs::read(&messages).unwrap();
    for path in [folder.path(), &messages] {
        for flag in ["--export", "--report", "--trajectory"] {
            for over in [&messages, &metadata] {
                let more = ["--wheelbase", "1.2", flag, over.to_str().unwrap()];
                let output = calibrate(path, &more);
                assert_refused(&output, 2, "is of the recording itself");
            }
        }
    }
    assert_eq!(fs::read(&messages).unwrap(), before);
    assert_eq!(fs::read_to_string(&metadata).unwrap(), known);
}
