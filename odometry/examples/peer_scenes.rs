//! Simulated scans of a hall, a corridor and an open yard for other engines, with the poses of this one.
//!
//! `cargo run --release -p fleetcal-odometry --example peer_scenes -- FOLDER` writes of each scene
//! `NAME.scans`, scans with their truth, and `NAME.poses`, a line a scan: milliseconds, x, y, yaw, and 1 where
//! a direction is reported open. `odometry/benches/peers/compare.py` reads both.

#[path = "../tests/scene/mod.rs"]
mod scene;

use std::error::Error;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::time::Instant;

use fleetcal_odometry::{LidarOdometry, Pose2, Scan};
use scene::{Scanner, Scene, figure_eight, seeded, straight};

/// Scans of a drive: a minute.
const SCANS: u32 = 600;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("expected FOLDER")?;
    let folder = Path::new(&folder);
    let hall = Scene::warehouse().with_people(3, [9.0, 4.0], 3);
    write(folder, "hall", &hall, &figure_eight)?;
    write(folder, "corridor", &Scene::corridor(), &straight(-24.0))?;
    write(folder, "open yard", &yard(), &figure_eight)
}

/// An open yard: a building's front on one side, some parked vehicles and lamp posts, and nothing else.
fn yard() -> Scene {
    let mut scene = Scene::default();
    scene.walls.push([-30.0, 22.0, 30.0, 22.0]);
    scene.add_box(14.0, -12.0, 20.0, -9.5);
    scene.add_box(-19.0, -6.0, -16.5, 0.0);
    scene.poles = vec![
        [12.0, 12.0, 0.12],
        [-12.0, 12.0, 0.12],
        [12.0, -16.0, 0.12],
        [-12.0, -16.0, 0.12],
    ];
    scene
}

/// Drives through a scene, and writes its scans and poses.
fn write(
    folder: &Path,
    name: &str,
    scene: &Scene,
    route: &dyn Fn(f64) -> Pose2,
) -> Result<(), Box<dyn Error>> {
    let mut scans = BufWriter::new(File::create(folder.join(name).with_extension("scans"))?);
    let mut poses = BufWriter::new(File::create(folder.join(name).with_extension("poses"))?);
    let mut robot = LidarOdometry::default();
    let mut rng = seeded(7);
    for index in 0..SCANS {
        let t = f64::from(index) * 0.1;
        let (scan, truth) = Scanner::default().scan(scene, route, t, &mut rng);
        write_scan(&mut scans, &scan, truth)?;
        #[expect(clippy::disallowed_methods, reason = "measures its own time")]
        let start = Instant::now();
        let pose = robot.process(&scan).ok_or("a scan without a pose")?;
        let ms = start.elapsed().as_secs_f64() * 1e3;
        let Pose2 { x_m, y_m, yaw_rad } = pose.lidar_in_odom;
        let is_open = u8::from(pose.unconstrained_rad.is_some());
        writeln!(poses, "{ms} {x_m} {y_m} {yaw_rad} {is_open}")?;
    }
    Ok(())
}

/// Writes a scan in little endian: its middle's stamp in ns, first angle, step of angle, step of time, the
/// LiDAR's true x, y and yaw at its middle, the number of its beams, and their ranges.
fn write_scan(file: &mut impl Write, scan: &Scan, truth: Pose2) -> Result<(), Box<dyn Error>> {
    let shape = scan.shape();
    file.write_all(&scan.reference_stamp().0.to_le_bytes())?;
    for number in [
        shape.angle_min_rad,
        shape.angle_increment_rad,
        shape.time_increment_s,
        truth.x_m,
        truth.y_m,
        truth.yaw_rad,
    ] {
        file.write_all(&number.to_le_bytes())?;
    }
    file.write_all(&u32::try_from(scan.ranges_m().len())?.to_le_bytes())?;
    for range in scan.ranges_m() {
        file.write_all(&range.to_le_bytes())?;
    }
    Ok(())
}
