//! Recordings that `rosbag2` has split into several files.

use std::fs;
use std::path::Path;

use super::*;

/// Makes a folder with each of `parts` in a file of its own, and its metadata's list.
fn folder(parts: &[(&str, std::ops::Range<i64>)], listed: &[&str]) -> TempDir {
    let folder = TempDir::new().unwrap();
    let robot = RobotId::parse("tugger_01").unwrap();
    for (name, seconds) in parts {
        let mut writer = RecordingWriter::create(&folder.path().join(name), &robot).unwrap();
        for step in seconds.start * 10..seconds.end * 10 {
            let stamp_ns = START_NS + step * SECOND_NS / 10;
            writer.wheel_odometry(&drive(stamp_ns)).unwrap();
            writer.scan(&scan(stamp_ns)).unwrap();
        }
        writer.finish().unwrap();
    }
    describe(folder.path(), listed);
    folder
}

fn describe(folder: &Path, listed: &[&str]) {
    let mut text = "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  \
                    relative_file_paths:\n"
        .to_owned();
    for name in listed {
        text.extend(["    - ", name, "\n"]);
    }
    text.push_str("  duration: {nanoseconds: 1}\n  message_count: 0\n");
    fs::write(folder.join("metadata.yaml"), text).unwrap();
}

fn refused(folder: &TempDir, wanted: &str) {
    let error = Recording::open(folder.path()).unwrap_err();
    let sentence = error.to_string();
    assert!(sentence.contains(wanted), "{sentence}");
    assert_eq!(error.exit_status(), 65, "{sentence}");
}

#[test]
fn files_are_read_in_the_order_of_the_metadata() {
    // Ten sorts before two by name; the last two overlap, as their scans are logged later.
    let parts = [
        ("bag_10.mcap", 3..5),
        ("bag_2.mcap", 0..3),
        ("bag_11.mcap", 4..6),
    ];
    let listed = ["bag_2.mcap", "old_folder/bag_10.mcap", "bag_11.mcap"];
    let folder = folder(&parts, &listed);
    let recording = Recording::open(folder.path()).unwrap();
    assert_eq!(recording.count(&["/tugger_01/wheel_odometry"]), 70);
    assert_eq!(recording.channels().len(), 2);
    assert_eq!(recording.files().count(), 3);
    assert_eq!(recording.start_ns(), START_NS.unsigned_abs());
    let times: Vec<u64> = recording
        .messages(&["/tugger_01/wheel_odometry", "/tugger_01/scan"])
        .unwrap()
        .map(|message| message.unwrap().log_time_ns)
        .collect();
    assert_eq!(times.len(), 140);
    assert!(times.is_sorted());
    assert_eq!(times.last(), Some(&recording.end_ns()));
}

#[test]
fn a_folder_whose_order_is_not_known_is_refused() {
    let parts = [("a.mcap", 0..1), ("b.mcap", 1..2)];
    refused(&folder(&parts, &["a.mcap"]), "lacks");
    refused(&folder(&parts, &["a.mcap", "c.mcap"]), "c.mcap");
    refused(
        &folder(&parts, &["a.mcap", "a.mcap", "b.mcap"]),
        "each once",
    );
    let without = folder(&parts, &[]);
    fs::write(without.path().join("metadata.yaml"), "nothing: [").unwrap();
    refused(&without, "metadata.yaml");
    fs::remove_file(without.path().join("metadata.yaml")).unwrap();
    refused(&without, "holds 2 files");
    // One of them is damaged.
    let damaged = folder(&parts, &["a.mcap", "b.mcap"]);
    let bytes = fs::read(damaged.path().join("b.mcap")).unwrap();
    fs::write(damaged.path().join("b.mcap"), &bytes[..bytes.len() / 2]).unwrap();
    refused(&damaged, "b.mcap: the recording is truncated");
}

#[test]
fn a_folder_that_lost_a_file_is_refused() {
    let listed = ["bag_0.mcap", "bag_1.mcap"];
    let lost = folder(&[("bag_1.mcap", 1..2)], &listed);
    refused(&lost, "relative_file_paths: got bag_0.mcap");
    // One file that was renamed, and one of which nothing is said, are whole.
    let renamed = folder(&[("renamed.mcap", 0..1)], &["bag_0.mcap"]);
    assert_eq!(Recording::open(renamed.path()).unwrap().files().count(), 1);
    fs::remove_file(renamed.path().join("metadata.yaml")).unwrap();
    Recording::open(renamed.path()).unwrap();
}

#[test]
fn a_recording_holds_its_files_as_they_were_recorded() {
    let parts = [("a.mcap", 0..1), ("b.mcap", 1..2)];
    let bag = folder(&parts, &["a.mcap", "b.mcap.zstd"]);
    let packed = bag.path().join("b.mcap.zstd");
    let bytes = fs::read(bag.path().join("b.mcap")).unwrap();
    fs::write(&packed, zstd::encode_all(bytes.as_slice(), 1).unwrap()).unwrap();
    fs::remove_file(bag.path().join("b.mcap")).unwrap();
    fs::write(bag.path().join("notes.txt"), "greased").unwrap();
    let alone = bag.path().join("a.mcap");
    for path in [bag.path(), &alone, &packed] {
        let recording = Recording::open(path).unwrap();
        for (name, expected) in [
            ("a.mcap", true),
            ("./b.mcap.zstd", true),
            ("metadata.yaml", true),
            ("notes.txt", false),
            ("new.mcap", false),
        ] {
            let file = bag.path().join(name);
            assert_eq!(recording.holds(&file), expected, "{name} of {path:?}");
        }
    }
    // Without metadata a file's neighbours are recordings of their own.
    fs::remove_file(bag.path().join("metadata.yaml")).unwrap();
    let recording = Recording::open(&alone).unwrap();
    assert!(recording.holds(&alone) && !recording.holds(&packed));
}

#[test]
fn topics_of_all_files_are_limited_together() {
    let found = |topics: std::ops::Range<usize>| Found {
        channels: topics
            .map(|number| Channel {
                topic: format!("/{number:05}"),
                message_type: String::new(),
                encoding: None,
                count: 1,
            })
            .collect(),
        start_ns: 5,
        end_ns: 7,
        disorder_ns: 0,
    };
    let mut together = Together::default();
    assert!(together.add(found(0..CHANNELS_MAX)));
    assert!(together.add(found(0..CHANNELS_MAX)), "the same again");
    assert!(!together.add(found(1..CHANNELS_MAX + 1)), "one too many");
    let all = together.finish();
    assert_eq!((all.start_ns, all.end_ns, all.disorder_ns), (5, 7, 2));
    let counts: Vec<u64> = all.channels.iter().map(|channel| channel.count).collect();
    assert_eq!((counts[0], counts[1], counts[CHANNELS_MAX]), (2, 3, 1));
}
