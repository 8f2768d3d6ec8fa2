//! `--map` and `--start`: the simulated warehouse as `map_server` would have saved it.

use std::f64::consts::TAU;
use std::fs;
use std::path::{Path, PathBuf};

use fleetcal_proto::ros::{PoseStamped, RosMessage};
use fleetcal_robot::fleet::{RecordedTruth, simulated_robots};
use fleetcal_robot::recording::Recording;
use fleetcal_robot::simulator::{Point, Pose2, World};
use fleetcal_tests::{binary, recording};
use tempfile::TempDir;

use super::{assert_near, assert_refused, calibrate};

/// Edge of a cell, m.
const RESOLUTION_M: f64 = 0.05;
/// Lower left corner of the map in the world, m.
const CORNER: Point = Point {
    x_m: -30.525,
    y_m: -30.525,
};
/// Cells of a row, and of a column.
const CELLS: usize = 1240;
const OCCUPIED: u8 = 0;
const UNKNOWN: u8 = 205;
const FREE: u8 = 254;

fn cell_of(point: Point) -> usize {
    let along = |from_m: f64, to_m: f64| ((to_m - from_m) / RESOLUTION_M) as usize;
    let (column, row) = (along(CORNER.x_m, point.x_m), along(CORNER.y_m, point.y_m));
    assert!(column < CELLS && row < CELLS, "{point:?}");
    (CELLS - 1 - row) * CELLS + column
}

/// Writes the world as a map: cells that can be reached from `start` are free. Returns the path of
/// the description.
fn saved(world: &World, start: Point, folder: &Path) -> PathBuf {
    let mut image = vec![UNKNOWN; CELLS * CELLS];
    for segment in world.segments() {
        let parts = (segment.from.distance_m(segment.to) / RESOLUTION_M * 20.0).ceil();
        for part in 0..=parts as usize {
            let point = segment.from.toward(segment.to, part as f64 / parts);
            image[cell_of(point)] = OCCUPIED;
        }
    }
    for pillar in world.pillars() {
        for part in 0..400 {
            let (s, c) = (f64::from(part) * TAU / 400.0).sin_cos();
            image[cell_of(Point {
                x_m: pillar.centre.x_m + pillar.radius_m * c,
                y_m: pillar.centre.y_m + pillar.radius_m * s,
            })] = OCCUPIED;
        }
    }
    let mut open = vec![cell_of(start)];
    while let Some(cell) = open.pop() {
        if image[cell] == UNKNOWN {
            image[cell] = FREE;
            open.extend([cell - 1, cell + 1, cell - CELLS, cell + CELLS]);
        }
    }
    let header = format!("P5\n# a simulated warehouse\n{CELLS} {CELLS}\n255\n");
    let image = [header.as_bytes(), &image].concat();
    fs::write(folder.join("hall.pgm"), image).unwrap();
    let description = folder.join("hall.yaml");
    let yaml = format!(
        "image: hall.pgm\nresolution: {RESOLUTION_M}\norigin: [{}, {}, 0.0]\n\
         negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n",
        CORNER.x_m, CORNER.y_m
    );
    fs::write(&description, yaml).unwrap();
    description
}

/// Returns the LiDAR's true poses in the world, with their stamps in seconds.
fn true_poses(path: &Path, truth: &RecordedTruth) -> Vec<(f64, Pose2)> {
    let values = &truth.parameters;
    let mount = Pose2::new(values.lidar_x_m, values.lidar_y_m, values.lidar_yaw_rad);
    let messages = Recording::open(path).unwrap();
    let messages = messages.messages(&["/tugger_01/truth"]).unwrap();
    let poses = messages.map(|message| {
        let message = PoseStamped::from_cdr(&message.unwrap().payload).unwrap();
        let position = message.pose.position;
        let yaw_rad = message.pose.orientation.yaw_rad();
        let base = Pose2::new(position.x, position.y, yaw_rad);
        let stamp_s = message.header.stamp.as_ns() as f64 * 1e-9;
        (stamp_s, base.compose(&mount))
    });
    poses.collect()
}

/// Runs `odometry` in the map; returns its summary, and its poses with their stamps.
fn localised(path: &Path, map: &Path, start: &str) -> (serde_json::Value, Vec<(f64, Pose2)>) {
    let tum = path.with_extension("tum");
    let [path, map, out] = [path, map, &tum].map(|path| path.to_str().unwrap());
    let flags = ["--map", map, "--start", start, "--trajectory", out];
    let arguments = ["odometry", path, "--json"];
    let summary = binary::run_json(arguments.iter().chain(&flags));
    let lines = fs::read_to_string(&tum).unwrap();
    let poses = lines.lines().map(|line| {
        let numbers: Vec<f64> = line.split(' ').map(|text| text.parse().unwrap()).collect();
        let yaw_rad = 2.0 * numbers[6].atan2(numbers[7]);
        (numbers[0], Pose2::new(numbers[1], numbers[2], yaw_rad))
    });
    (summary, poses.collect())
}

/// Returns the largest distance from the truth at the nearest stamp, m.
fn farthest_off_m(poses: &[(f64, Pose2)], truth: &[(f64, Pose2)]) -> f64 {
    let off_m = poses.iter().map(|(stamp_s, pose)| {
        let after = truth.partition_point(|(at_s, _)| at_s < stamp_s);
        let (_, at) = truth[after.min(truth.len() - 1)];
        (pose.x_m - at.x_m).hypot(pose.y_m - at.y_m)
    });
    off_m.fold(0.0, f64::max)
}

#[test]
fn a_recording_is_localised_in_a_saved_map() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("robot.mcap");
    let truth = recording::simulated(&path, 60.0);
    let poses = true_poses(&path, &truth);
    let robots = simulated_robots(1, 7).unwrap();
    let (_, first) = poses[0];
    let at = Point {
        x_m: first.x_m,
        y_m: first.y_m,
    };
    let map = saved(&robots[0].config.world, at, folder.path());
    let start = |turned_rad: f64| {
        let yaw_rad = first.yaw_rad + turned_rad;
        format!(
            "{},{},{}",
            first.x_m + 0.2,
            first.y_m - 0.1,
            yaw_rad.to_degrees()
        )
    };

    let (summary, localised_poses) = localised(&path, &map, &start(0.1));
    assert_eq!(summary["tracking"]["lost"], 0, "{summary}");
    // At 1.5 m/s the next true pose lies up to 1.5 cm on, and a cell's half is 2.5 cm.
    let off_m = farthest_off_m(&localised_poses, &poses);
    assert!(off_m < 0.04, "{off_m} m");
    let (summary, _) = localised(&path, &map, &start(2.5));
    assert_ne!(summary["tracking"]["lost"], 0, "{summary}");

    let wheelbase = truth.vehicle.wheelbase_m.to_string();
    let start = start(0.0);
    let (recorded, yaml) = (path.to_str().unwrap(), map.to_str().unwrap());
    let flags = ["--map", yaml, "--start", &start, "--wheelbase", &wheelbase];
    let arguments = ["calibrate", recorded, "--json"];
    let report = binary::run_json(arguments.iter().chain(&flags));
    let truth = truth.parameters;
    let cases = [
        ("steering_offset", truth.steering_offset_rad, 0.003),
        ("lidar_x", truth.lidar_x_m, 0.01),
        ("lidar_y", truth.lidar_y_m, 0.01),
        ("lidar_yaw", truth.lidar_yaw_rad, 0.003),
    ];
    assert_near(&report, &cases, 5.0, [0.0005, 0.001]);
}

#[test]
fn a_map_that_cannot_be_is_refused_in_one_sentence() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("robot.mcap");
    recording::simulated(&path, 3.0);
    let map = folder.path().join("map.yaml");
    let yaml = map.to_str().unwrap();
    let flags = |start: &'static str| ["--wheelbase", "1.2", "--map", yaml, "--start", start];
    assert_refused(&calibrate(&path, &flags("0,0,0")), 74, "map.yaml");
    fs::write(&map, "image: map.pgm\nresolution: fine\n").unwrap();
    assert_refused(&calibrate(&path, &flags("0,0,0")), 65, "expected");
    let output = calibrate(&path, &flags("0,0"));
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("metres, metres, degrees"), "{said}");
}
