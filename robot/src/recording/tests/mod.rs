//! Reading, refusing, choosing and writing recordings.

mod damaged;
mod order;
mod split;
mod topics;
mod written;

use std::path::PathBuf;

use fleetcal_proto::RobotId;
use fleetcal_proto::ros::{AckermannDriveStamped, Header, LaserScan, PoseStamped, Time};
use tempfile::TempDir;

use super::*;

fn header(stamp_ns: i64) -> Header {
    Header {
        stamp: Time::from_ns(stamp_ns).unwrap(),
        frame_id: "laser".into(),
    }
}

fn drive(stamp_ns: i64) -> AckermannDriveStamped {
    let mut message = AckermannDriveStamped {
        header: header(stamp_ns),
        ..Default::default()
    };
    message.drive.speed = 1.0;
    message
}

fn scan(stamp_ns: i64) -> LaserScan {
    LaserScan {
        header: header(stamp_ns),
        angle_min: -1.0,
        angle_max: 1.0,
        angle_increment: 0.02,
        time_increment: 0.0009,
        scan_time: 0.1,
        range_min: 0.1,
        range_max: 30.0,
        ranges: (0..101)
            .map(|beam| 1.0 + (stamp_ns % 977) as f32 + beam as f32)
            .collect(),
        intensities: [].into(),
    }
}

const START_NS: i64 = 1_700_000_000_000_000_000;
const SECOND_NS: i64 = 1_000_000_000;

/// Makes a recording of `seconds` s: drive at 100 Hz, scans at 10 Hz, the truth at 10 Hz.
fn recorded(folder: &TempDir, name: &str, seconds: i64) -> PathBuf {
    let path = folder.path().join(name);
    let robot = RobotId::parse("tugger_01").unwrap();
    let mut writer = RecordingWriter::create(&path, &robot).unwrap();
    for step in 0..seconds * 100 {
        let stamp_ns = START_NS + step * SECOND_NS / 100;
        writer.wheel_odometry(&drive(stamp_ns)).unwrap();
        if step % 10 == 0 {
            writer.scan(&scan(stamp_ns)).unwrap();
            let pose = PoseStamped {
                header: header(stamp_ns),
                ..Default::default()
            };
            writer.truth(&pose).unwrap();
        }
    }
    writer
        .true_values([("lidar_x_m".to_owned(), "0.434".to_owned())].into())
        .unwrap();
    writer.finish().unwrap();
    path
}
