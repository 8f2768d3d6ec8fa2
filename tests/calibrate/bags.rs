//! Recordings in every form that `rosbag2` writes them: the same messages give the same numbers.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use fleetcal_tests::{binary, recording};
use serde_json::Value;
use tempfile::TempDir;

/// Duration of the drive, s.
const DURATION_S: f64 = 10.0;

/// Returns the report without its machine-dependent part.
fn calibrated(recording: &Path) -> Value {
    let recording = recording.to_str().unwrap();
    let mut report = binary::run_json(["calibrate", recording, "--wheelbase", "1.2", "--json"]);
    report.as_object_mut().unwrap().remove("timing");
    report
}

/// Writes a recording again with an independent implementation of `rosbag2`.
fn converted(python: &Path, from: &Path, to: PathBuf, flags: [&str; 3]) -> PathBuf {
    let [storage, compression, mode] = flags;
    let output = Command::new(python.with_file_name("rosbags-convert"))
        .arg("--src")
        .arg(from)
        .arg("--dst")
        .arg(&to)
        .args(["--dst-storage", storage, "--compress", compression])
        .args(["--compress-mode", mode])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}");
    to
}

#[test]
fn what_rosbag2_writes_gives_the_same_numbers_in_every_form() {
    let Some(python) = env::var_os("FLEETCAL_PYTHON").filter(|path| !path.is_empty()) else {
        eprintln!("skipped: FLEETCAL_PYTHON is not set; `make test` sets it");
        return;
    };
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("robot.mcap");
    recording::simulated(&path, DURATION_S);
    let expected = calibrated(&path);
    for (name, flags) in [
        ("plain", ["sqlite3", "none", "file"]),
        ("messages", ["sqlite3", "zstd", "message"]),
        ("packed", ["sqlite3", "zstd", "file"]),
        ("mcap", ["mcap", "zstd", "file"]),
    ] {
        let to = folder.path().join(name);
        let bag = converted(Path::new(&python), &path, to, flags);
        assert_eq!(calibrated(&bag), expected, "{flags:?}");
    }
    // The file itself will do, and one that is cut off is refused in one sentence.
    let file = folder.path().join("plain/plain.db3");
    assert_eq!(calibrated(&file), expected);
    let whole = fs::read(&file).unwrap();
    let cut = folder.path().join("cut.db3");
    fs::write(&cut, &whole[..whole.len() / 2]).unwrap();
    let output = binary::run(["calibrate", cut.to_str().unwrap(), "--wheelbase", "1.2"]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(65), "{said}");
    assert!(
        said.contains("damaged") && said.trim_end().lines().count() == 1,
        "{said}"
    );
    // A file runs nothing of its own: what looks like a table has to be one.
    for sql in [
        "CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) \
         SELECT i AS id, 1 AS topic_id, i AS timestamp, x'00' AS data FROM n",
        "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, \
         data BLOB AS (zeroblob(900000000)))",
    ] {
        let hostile = folder.path().join("hostile.db3");
        let script = "import sqlite3, sys\nwith sqlite3.connect(sys.argv[1]) as db:\n \
             db.execute('CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT, \
             serialization_format TEXT)')\n db.execute(sys.argv[2])";
        let made = Command::new(&python)
            .args(["-c", script, hostile.to_str().unwrap(), sql])
            .status();
        assert!(made.unwrap().success());
        let output = binary::run(["calibrate", hostile.to_str().unwrap(), "--wheelbase", "1.2"]);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(65), "{said}");
        assert!(said.contains("rosbag2"), "{said}");
        fs::remove_file(&hostile).unwrap();
    }
    a_bag_that_was_split_gives_them_too(
        Path::new(&python),
        &folder.path().join("plain"),
        &expected,
    );
}

/// Checks the only file of a folder after it is split in two, in the order of its metadata; without
/// these the order is unknown.
fn a_bag_that_was_split_gives_them_too(python: &Path, split: &Path, expected: &Value) {
    let script = "import sqlite3, sys\nfor name, sign in ('z.db3', '<='), ('a.db3', '>'):\n \
                  db = sqlite3.connect(sys.argv[1] + '/' + name)\n db.executescript(f'ATTACH \
                  \"{sys.argv[1]}/plain.db3\" AS whole; CREATE TABLE topics AS SELECT * FROM \
                  whole.topics; CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, \
                  timestamp INTEGER, data BLOB); INSERT INTO messages SELECT id, topic_id, \
                  timestamp, data FROM whole.messages WHERE timestamp {sign} (SELECT \
                  avg(timestamp) FROM whole.messages)')\n db.close()";
    let made = Command::new(python)
        .args(["-c", script, split.to_str().unwrap()])
        .status();
    assert!(made.unwrap().success());
    fs::remove_file(split.join("plain.db3")).unwrap();
    let metadata = "rosbag2_bagfile_information: {relative_file_paths: [z.db3, a.db3]}";
    fs::write(split.join("metadata.yaml"), metadata).unwrap();
    assert_eq!(&calibrated(split), expected);
    fs::remove_file(split.join("metadata.yaml")).unwrap();
    let output = binary::run(["calibrate", split.to_str().unwrap(), "--wheelbase", "1.2"]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(65), "{said}");
    assert!(said.contains("holds 2 files"), "{said}");
}
