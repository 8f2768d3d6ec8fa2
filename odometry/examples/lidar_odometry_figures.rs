//! The figures of the LiDAR odometry on simulated drives, against their truth.
//!
//! `cargo run --release -p fleetcal-odometry --example lidar_odometry_figures` prints the table.
#![expect(clippy::print_stdout, reason = "the table is what it is for")]

use std::error::Error;
use std::time::Instant;

use fleetcal_odometry::ScanShape;
use fleetcal_odometry::geometry::wrap_angle_rad;
use fleetcal_odometry::lidar_odometry::{LidarOdometry, OdometryPose, Tracking};
use fleetcal_odometry::{Pose2, RobotTime, Scan};
use fleetcal_robot::simulator::{
    LidarOutput, LidarSettings, PeopleSettings, PersonShape, Route, SimulatedMessage, Simulation,
    SimulationConfig,
};
use nalgebra::Vector3;

/// Two minutes of driving.
const SCANS: usize = 1198;
/// Drives that the normalised error is averaged over.
const SEEDS: u64 = 10;

/// A scan and the LiDAR's true pose at its reference time.
type Taken = (Scan, Pose2);

fn main() -> Result<(), Box<dyn Error>> {
    let figure_eight = SimulationConfig::figure_eight;
    let lidar = |settings| SimulationConfig {
        lidar: LidarOutput::Scans(settings),
        ..figure_eight(7)
    };
    let with_beams = |beams| {
        lidar(LidarSettings {
            beams,
            ..LidarSettings::default()
        })
    };
    let crowd = PeopleSettings {
        count: 60,
        shape: PersonShape::Legs,
    };
    println!("scene                  ms median    p99   mm over 1 s  deg over 1 s  lost     KiB");
    row("figure-eight", figure_eight(7))?;
    row(
        "loop through aisles",
        SimulationConfig {
            route: Route::aisle_loop(),
            ..figure_eight(7)
        },
    )?;
    row(
        "60 walking people",
        SimulationConfig {
            people: crowd,
            ..figure_eight(7)
        },
    )?;
    row("180 beams", with_beams(180))?;
    row("360 beams", with_beams(360))?;
    row("4096 beams", with_beams(4096))?;
    println!("\nNormalised error of a motion between two scans, {SEEDS} drives; 3 is expected");
    println!("scene                     0.1 s    0.3 s      1 s      3 s     10 s");
    consistency("figure-eight", &figure_eight)?;
    consistency("loop through aisles", &|seed| SimulationConfig {
        route: Route::aisle_loop(),
        ..figure_eight(seed)
    })
}

/// The first scans of a simulated drive.
fn record(config: SimulationConfig, scans: usize) -> Result<Vec<Taken>, Box<dyn Error>> {
    let mut simulation = Simulation::new(config)?;
    let mut taken = Vec::with_capacity(scans);
    while taken.len() < scans {
        let emitted = simulation.advance();
        if let SimulatedMessage::Scan(raw) = emitted.message {
            let shape = ScanShape {
                angle_min_rad: raw.angle_min_rad,
                angle_increment_rad: raw.angle_increment_rad,
                time_increment_s: raw.time_increment_s,
                range_min_m: raw.range_min_m,
                range_max_m: raw.range_max_m,
            };
            let scan = Scan::new(RobotTime(raw.stamp_ns), shape, raw.ranges_m.into())?;
            let pose = emitted.truth.lidar;
            taken.push((scan, Pose2::new(pose.x_m, pose.y_m, pose.yaw_rad)));
        }
    }
    Ok(taken)
}

/// Runs one drive and prints its row.
fn row(name: &str, config: SimulationConfig) -> Result<(), Box<dyn Error>> {
    let taken = record(config, SCANS)?;
    let mut odometry = LidarOdometry::default();
    let mut times_ms = Vec::new();
    let mut pairs = Vec::new();
    for (scan, truth) in &taken {
        #[expect(clippy::disallowed_methods, reason = "measures its own time")]
        let start = Instant::now();
        let pose = odometry.process(scan);
        times_ms.push(start.elapsed().as_secs_f64() * 1e3);
        pairs.extend(pose.map(|pose| (pose, *truth)));
    }
    times_ms.sort_by(f64::total_cmp);
    let part = |percent: usize| times_ms.get(times_ms.len() * percent / 100).copied();
    let errors: Vec<_> = errors_over(&pairs, 10).collect();
    let rms = |f: &dyn Fn(&Vector3<f64>) -> f64| {
        (errors.iter().map(f).sum::<f64>() / errors.len() as f64).sqrt()
    };
    let lost = pairs
        .iter()
        .filter(|(pose, _)| pose.tracking == Tracking::Lost)
        .count();
    println!(
        "{name:22} {:9.3} {:6.3} {:13.2} {:13.4} {lost:5} {:7}",
        part(50).unwrap_or_default(),
        part(99).unwrap_or_default(),
        1e3 * rms(&|e| e.x * e.x + e.y * e.y),
        rms(&|e| e.z * e.z).to_degrees(),
        odometry.memory_bytes() / 1024,
    );
    Ok(())
}

/// Errors of the motion over `lag` scans, in the LiDAR's frame.
fn errors_over(pairs: &[(OdometryPose, Pose2)], lag: usize) -> impl Iterator<Item = Vector3<f64>> {
    pairs.iter().zip(pairs.iter().skip(lag)).map(|(from, to)| {
        let estimated = from.0.lidar_in_odom.between(&to.0.lidar_in_odom);
        let error = from.1.between(&to.1).between(&estimated);
        Vector3::new(error.x_m, error.y_m, wrap_angle_rad(error.yaw_rad))
    })
}

/// Prints the mean normalised error over several lags and drives.
fn consistency(name: &str, config: &dyn Fn(u64) -> SimulationConfig) -> Result<(), Box<dyn Error>> {
    let lags = [1, 3, 10, 30, 100];
    let mut sums = lags.map(|_| (0.0, 0.0));
    for seed in 0..SEEDS {
        let mut odometry = LidarOdometry::default();
        let pairs: Vec<_> = record(config(100 + seed), 600)?
            .iter()
            .filter_map(|(scan, truth)| odometry.process(scan).map(|pose| (pose, *truth)))
            .collect();
        for (lag, (sum, count)) in lags.iter().zip(&mut sums) {
            let ends = pairs.iter().zip(pairs.iter().skip(*lag));
            for (error, (from, to)) in errors_over(&pairs, *lag).zip(ends) {
                let motion = from.0.lidar_in_odom.between(&to.0.lidar_in_odom);
                let back = motion.inverse().adjoint();
                let covariance = to.0.covariance + back * from.0.covariance * back.transpose();
                let whitened = covariance.cholesky().ok_or("a covariance that is none")?;
                *sum += error.dot(&whitened.solve(&error));
                *count += 1.0;
            }
        }
    }
    print!("{name:22}");
    for (sum, count) in sums {
        print!(" {:8.2}", sum / count);
    }
    println!();
    Ok(())
}
