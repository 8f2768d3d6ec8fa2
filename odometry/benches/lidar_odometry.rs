//! Time of a scan of the LiDAR odometry, and its error, in one run: `cargo bench -p fleetcal-odometry`.
//!
//! Each row is a situation with its own way through the pipeline. Warm: one robot's scans follow each other.
//! Cold: many robots take turns, so that a robot's map has left the caches when its next scan arrives.
#![expect(clippy::print_stdout, reason = "the table is what it is for")]

#[path = "../tests/scene/mod.rs"]
mod scene;

use std::time::Instant;

use fleetcal_odometry::{LidarOdometry, OdometryPose, Pose2, Scan};
use nalgebra::Vector3;
use scene::{Scanner, Scene, figure_eight, seeded, straight};

/// Scans of a drive.
const SCANS: u32 = 300;
/// Scans that are timed where the robot drives.
const DRIVEN: usize = 100;
/// Robots that take turns: their maps are several times as large as a processor's caches.
const ROBOTS: usize = 64;
/// Rounds of the same scans in a row.
const ROUNDS: usize = 21;

/// Scans of a drive, each with the LiDAR's true pose.
struct Drive {
    scans: Vec<Scan>,
    truth: Vec<Pose2>,
}

impl Drive {
    fn new(scene: &Scene, scanner: &Scanner, route: &dyn Fn(f64) -> Pose2) -> Self {
        let mut rng = seeded(1);
        let (scans, truth) = (0..SCANS)
            .map(|index| scanner.scan(scene, route, f64::from(index) * 0.1, &mut rng))
            .unzip();
        Self { scans, truth }
    }

    /// The drive, of whose last scans one in `every` is left.
    fn thinned(&self, every: usize) -> Self {
        let from = self.scans.len() - DRIVEN;
        let left = || (0..self.scans.len()).filter(|index| *index < from || index % every == 0);
        Self {
            scans: left().map(|index| self.scans[index].clone()).collect(),
            truth: left().map(|index| self.truth[index]).collect(),
        }
    }

    /// Prints the times of the last scans.
    fn row(&self, name: &str, timed: usize) {
        let (before, timed) = self.scans.split_at(self.scans.len() - timed);
        let (before, lead) = before.split_at(before.len().saturating_sub(1));
        let mut robot = LidarOdometry::default();
        process_all(&mut robot, before);
        let mut warm = vec![Vec::new(); timed.len()];
        for _ in 0..ROUNDS {
            let mut robot = robot.clone();
            process_all(&mut robot, lead);
            for (times_us, scan) in warm.iter_mut().zip(timed) {
                times_us.push(time_us(&mut robot, scan));
            }
        }
        let mut robots = vec![robot; ROBOTS];
        for robot in &mut robots {
            process_all(robot, lead);
        }
        let cold = timed.iter().map(|scan| {
            robots
                .iter_mut()
                .map(|robot| time_us(robot, scan))
                .collect()
        });
        let (warm_us, cold_us) = (typical_us(warm), typical_us(cold.collect()));
        print!("{name:32} {warm_us:7.1} {cold_us:7.1}");
        match self.error_over_a_second(timed.len()) {
            Some((mm, deg)) => println!(" {mm:12.2} {deg:13.4}"),
            None => println!(),
        }
    }

    /// Root mean square error of the motion over a second up to each of the last scans, mm and degrees.
    fn error_over_a_second(&self, last: usize) -> Option<(f64, f64)> {
        let mut robot = LidarOdometry::default();
        let poses = self.scans.iter().map(|scan| robot.process(scan));
        let pairs: Vec<_> = poses.zip(&self.truth).collect();
        let errors: Vec<_> = (pairs.len() - last..pairs.len())
            .filter_map(|index| {
                let (to, true_to) = &pairs[index];
                let to = to.as_ref()?;
                let is_earlier = |from: &OdometryPose| to.stamp.seconds_since(from.stamp) > 0.95;
                let (from, true_from) = pairs[..index]
                    .iter()
                    .rev()
                    .find(|(from, _)| from.as_ref().is_some_and(is_earlier))?;
                let moved = from.as_ref()?.lidar_in_odom.between(&to.lidar_in_odom);
                Some(true_from.between(true_to).between(&moved).log())
            })
            .collect();
        let mean = |square: &dyn Fn(&Vector3<f64>) -> f64| {
            errors.iter().map(square).sum::<f64>() / errors.len() as f64
        };
        let position_m = mean(&|error| error.xy().norm_squared()).sqrt();
        let yaw_rad = mean(&|error| error.z * error.z).sqrt();
        (last > 1).then_some((1e3 * position_m, yaw_rad.to_degrees()))
    }
}

fn process_all(robot: &mut LidarOdometry, scans: &[Scan]) {
    for scan in scans {
        robot.process(scan);
    }
}

fn time_us(robot: &mut LidarOdometry, scan: &Scan) -> f64 {
    #[expect(clippy::disallowed_methods, reason = "measures its own time")]
    let start = Instant::now();
    std::hint::black_box(robot.process(scan));
    start.elapsed().as_secs_f64() * 1e6
}

/// The mean over the scans of each one's median time, µs: what else runs on the machine is left out.
fn typical_us(times_us: Vec<Vec<f64>>) -> f64 {
    let scans = times_us.len() as f64;
    let medians = times_us.into_iter().map(|mut times_us| {
        times_us.sort_by(f64::total_cmp);
        times_us[times_us.len() / 2]
    });
    medians.sum::<f64>() / scans
}

fn main() {
    let hall = Scene::warehouse().with_people(3, [9.0, 4.0], 3);
    let with_beams = |beams| Scanner {
        beams,
        ..Scanner::default()
    };
    println!("µs a scan                           warm    cold  mm over 1 s  deg over 1 s");
    for beams in [180, 360, 4096] {
        let drive = Drive::new(&hall, &with_beams(beams), &figure_eight);
        drive.row(&format!("driving, {beams} beams"), DRIVEN);
    }
    let driving = Drive::new(&hall, &with_beams(1024), &figure_eight);
    driving.row("driving, 1024 beams", DRIVEN);
    for every in [2, 3, 5, 10] {
        let name = format!("one scan in {every}");
        driving.thinned(every).row(&name, DRIVEN / every);
    }
    let scanner = Scanner::default();
    Drive::new(&hall, &scanner, &|_| figure_eight(10.0)).row("at rest: points and alignment", 10);
    Drive::new(&Scene::corridor(), &scanner, &straight(0.0))
        .row("corridor: an open direction", DRIVEN);
    let kidnapped = Drive::new(&hall, &scanner, &|t| {
        let moved = if t < 29.85 { 0.0 } else { 1.0 };
        figure_eight(t).compose(&Pose2::new(moved, 0.0, 0.7 * moved))
    });
    kidnapped.row("kidnapped: search, and lost", 1);
    let mut first = Drive::new(&hall, &scanner, &figure_eight);
    first.scans.truncate(1);
    first.row("first: points and map", 1);
}
