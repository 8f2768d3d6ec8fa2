use std::path::Path;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;

fn refused(path: &Path, wanted: &str, exit_status: u8) {
    let error = Recording::open(path).unwrap_err();
    let sentence = error.to_string();
    assert!(
        sentence.contains(wanted),
        "{sentence:?} does not say {wanted:?}"
    );
    assert!(
        sentence.contains(path.to_str().unwrap()),
        "{sentence:?} does not name the file"
    );
    assert_eq!(error.exit_status(), exit_status, "{sentence}");
}

#[test]
fn files_that_are_no_recording_are_refused() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("x.mcap");
    refused(&path, "No such file", 74);
    refused(folder.path(), "holds 0 files", 65);
    std::fs::write(&path, b"").unwrap();
    refused(&path, "the file is empty", 65);
    std::fs::write(&path, b"stamp,speed\n1,2\n").unwrap();
    refused(&path, "no MCAP file", 65);
    std::fs::write(&path, &mcap::MAGIC[..4]).unwrap();
    refused(&path, "no MCAP file", 65);
    std::fs::write(&path, b"#ROSBAG V2.0\nE\0\0\0").unwrap();
    refused(&path, "rosbags-convert --src ", 65);
    std::fs::write(&path, mcap::MAGIC).unwrap();
    refused(&path, "truncated", 65);
    let robot = RobotId::parse("a").unwrap();
    RecordingWriter::create(&path, &robot)
        .unwrap()
        .finish()
        .unwrap();
    refused(&path, "has no messages", 65);
}

#[test]
fn a_truncated_recording_says_how_far_it_could_be_read() {
    let folder = TempDir::new().unwrap();
    let path = recorded(&folder, "a.mcap", 60);
    let whole = std::fs::read(&path).unwrap();
    for permille in [1, 200, 500, 900, 999] {
        std::fs::write(&path, &whole[..whole.len() * permille / 1000]).unwrap();
        refused(&path, "the recording is truncated: it ends after", 65);
    }
    std::fs::write(&path, &whole[..whole.len() - 1]).unwrap();
    refused(&path, "59.991 s and 7200 messages", 65);
    std::fs::write(&path, &whole).unwrap();
    Recording::open(&path).unwrap();
}

#[test]
fn a_flipped_bit_is_noticed() {
    let folder = TempDir::new().unwrap();
    let path = recorded(&folder, "a.mcap", 5);
    let mut bytes = std::fs::read(&path).unwrap();
    let middle = bytes.len() / 4;
    bytes[middle] ^= 0x10;
    std::fs::write(&path, &bytes).unwrap();
    refused(&path, "the recording is damaged after", 65);
}

#[test]
fn a_hostile_record_length_is_refused() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("a.mcap");
    let mut bytes = mcap::MAGIC.to_vec();
    bytes.push(1);
    bytes.extend(u64::MAX.to_le_bytes());
    std::fs::write(&path, &bytes).unwrap();
    refused(&path, "exceeds limit", 65);
}

#[test]
fn spoilt_files_never_panic() {
    let folder = TempDir::new().unwrap();
    let path = recorded(&folder, "a.mcap", 1);
    let whole = std::fs::read(&path).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut refusals = 0;
    for _ in 0..2000 {
        let mut bytes = whole.clone();
        for _ in 0..rng.random_range(1..6) {
            let at = rng.random_range(0..bytes.len());
            bytes[at] = rng.random();
        }
        if rng.random_bool(0.3) {
            bytes.truncate(rng.random_range(0..bytes.len()));
        }
        std::fs::write(&path, &bytes).unwrap();
        match Recording::open(&path) {
            // What is left unchecked is no message: times in an index, the library's name.
            Ok(recording) => assert!(recording.messages(&["/tugger_01/wheel_odometry"]).is_ok()),
            Err(error) => {
                refusals += 1;
                assert_eq!(error.exit_status(), 65, "{error}");
            }
        }
    }
    assert!(refusals > 1500, "only {refusals} were refused");
}

#[cfg(unix)]
#[test]
fn a_pipe_is_refused_instead_of_waited_for() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("pipe.mcap");
    let made = std::process::Command::new("mkfifo").arg(&path).status();
    assert!(made.unwrap().success());
    let (sender, receiver) = std::sync::mpsc::channel();
    std::thread::spawn(move || sender.send(Recording::open(&path).map(drop)));
    let opened = receiver.recv_timeout(std::time::Duration::from_secs(20));
    let refused = opened.unwrap().unwrap_err();
    assert!(
        matches!(refused, RecordingError::NoRecording { .. }),
        "{refused}"
    );
}
