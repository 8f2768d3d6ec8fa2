//! The estimator's figures on simulated robots, against their truth.
//!
//! `cargo run --release -p fleetcal-estimator --example estimator_figures` prints all of them,
//! `-- convergence`, `delays`, `drift`, `disturbances` or `steps` one. A number after it is the
//! number of seeds.

#![expect(clippy::unwrap_used, reason = "a measurement that cannot go on ends")]
#![expect(clippy::print_stdout, reason = "the tables are what it is for")]

#[path = "../tests/calibration/changed.rs"]
mod changed;
#[path = "../tests/calibration/disturbed.rs"]
mod disturbed;
#[path = "../tests/calibration/drive.rs"]
#[expect(dead_code, reason = "the tests use more of it")]
mod drive;

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use changed::{changed, found};
use disturbed::{Disturbance, disturbed};
use drive::{Driven, FOUR, drive, error_of, event_of, nees, poses, vehicle_of};
use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::drive_history::DriveHistory;
use fleetcal_estimator::estimate::Cause;
use fleetcal_estimator::filter::OdometryReading;
use fleetcal_estimator::filter::follow::Follower;
use fleetcal_estimator::geometry::wrap_angle_rad;
use fleetcal_estimator::{Calibrator, Event, LidarOdometry, LidarPose, Parameter, Pose2, Status};
use fleetcal_robot::simulator::{
    Change, LidarOutput, Pose2 as TruePose, ScheduledChange, Simulation, SimulationConfig,
};

/// Name, function that prints it, and number of seeds.
type Table = (&'static str, fn(u64), u64);

fn main() -> Result<(), String> {
    let mut arguments = std::env::args().skip(1);
    let what = arguments.next().unwrap_or_default();
    let seeds = arguments.next().map(|seeds| seeds.parse::<u64>());
    let seeds = seeds.transpose().map_err(|error| error.to_string())?;
    let tables: [Table; 5] = [
        ("convergence", convergence, 100),
        ("delays", delays, 20),
        ("drift", drift, 4),
        ("disturbances", disturbances, 12),
        ("steps", |_| steps(), 1),
    ];
    if !what.is_empty() && !tables.iter().any(|(name, ..)| *name == what) {
        return Err(format!(
            "unknown table {what}, expected convergence, delays, drift, disturbances or steps"
        ));
    }
    for (name, table, usual) in tables {
        if what.is_empty() || what == name {
            table(seeds.unwrap_or(usual));
            println!();
        }
    }
    Ok(())
}

fn tugger(seed: u64) -> (SimulationConfig, CalibratorConfig) {
    let mut config = SimulationConfig::figure_eight(seed);
    config.vehicle.steering_offset_rad = 0.03;
    config.vehicle.lidar_in_base = TruePose::new(0.434, 0.0046, 0.72f64.to_radians());
    config.applied.lidar_in_base = config.vehicle.lidar_in_base;
    let calibrator = CalibratorConfig::of(vehicle_of(&config.vehicle, config.vehicle.wheelbase_m));
    (config, calibrator)
}

/// Prints the convergence from zero initial values, by raw scans.
fn convergence(seeds: u64) {
    let limits = [0.02f64.to_radians(), 0.002, 0.002, 0.03f64.to_radians()];
    println!(
        "figure-eight from zero, raw scans, {seeds} seeds: share inside 0.02°, 2 mm, 2 mm, 0.03°"
    );
    println!(
        "  time  offset       x       y     yaw  all four | RMSE °, mm, mm, °            NEES"
    );
    for time_s in [40.0, 60.0, 120.0] {
        let (mut inside, mut all, mut squares, mut mean_nees) = ([0; 4], 0, [0.0; 4], 0.0);
        for seed in 1..=seeds {
            let (config, calibrator) = tugger(seed);
            let run = drive(config, calibrator, time_s);
            let (estimate, truth) = run.last();
            let errors = FOUR.map(|parameter| error_of(parameter, estimate, truth));
            for i in 0..4 {
                inside[i] += u64::from(errors[i].abs() <= limits[i]);
                squares[i] += errors[i] * errors[i] / seeds as f64;
            }
            all += u64::from(errors.iter().zip(limits).all(|(e, limit)| e.abs() <= limit));
            mean_nees += nees(&run.calibrator, truth, true) / seeds as f64;
        }
        let share = |count: u64| format!("{:.0} %", 100.0 * count as f64 / seeds as f64);
        let [offset, x, y, yaw] = squares.map(f64::sqrt);
        println!(
            "{time_s:>4} s {:>7} {:>7} {:>7} {:>7} {:>9} | {:.4} {:.2} {:.2} {:.4} {mean_nees:>12.2}",
            share(inside[0]),
            share(inside[1]),
            share(inside[2]),
            share(inside[3]),
            share(all),
            offset.to_degrees(),
            1e3 * x,
            1e3 * y,
            yaw.to_degrees(),
        );
    }
}

fn delays(seeds: u64) {
    println!("changes 60 s into a figure-eight; flagged within 90 s, and how late");
    println!("change             data     seen  right cause   once   median         worst");
    let mount = |x_m, yaw_deg: f64| Change::Mount(TruePose::new(x_m, 0.0, yaw_deg.to_radians()));
    let steering = |deg: f64| Change::SteeringOffset(deg.to_radians());
    let changes = [
        ("steering 0.25°", steering(0.25), Cause::Steering),
        ("steering 0.5°", steering(0.5), Cause::Steering),
        ("steering 1°", steering(1.0), Cause::Steering),
        ("steering 1.5°", steering(1.5), Cause::Steering),
        ("steering 2°", steering(2.0), Cause::Steering),
        ("mount 0.25°", mount(0.0, 0.25), Cause::LidarMount),
        ("mount 1°", mount(0.0, 1.0), Cause::LidarMount),
        ("mount 10 mm", mount(0.01, 0.0), Cause::LidarMount),
        ("mount 30 mm", mount(0.03, 0.0), Cause::LidarMount),
        ("mount −1.5°, 30 mm", mount(0.03, -1.5), Cause::LidarMount),
    ];
    for (data, lidar) in [("poses", Some(poses())), ("scans", None)] {
        for (name, change, cause) in changes {
            delay_row((name, change, cause), (data, lidar), seeds);
        }
    }
}

fn delay_row(
    (name, change, cause): (&str, Change, Cause),
    (data, lidar): (&str, Option<LidarOutput>),
    seeds: u64,
) {
    let all: Vec<_> = (1..=seeds)
        .filter_map(|seed| found(&changed(seed, change, lidar, 150.0)))
        .filter(|found| found.delay_s >= 0.0)
        .collect();
    let right = all.iter().filter(|found| found.cause == cause).count();
    let once = all.iter().filter(|found| found.events == 1).count();
    let mut delays: Vec<_> = all
        .iter()
        .map(|found| (found.delay_s, found.delay_m))
        .collect();
    delays.sort_by(|a, b| a.0.total_cmp(&b.0));
    let shown = |place: Option<&(f64, f64)>| {
        place.map_or_else(String::new, |(s, m)| format!("{s:>5.1} s {m:>4.1} m"))
    };
    println!(
        "{name:<18} {data:<7} {:>5} {right:>12} {once:>6}   {:<14} {}",
        format!("{}/{seeds}", all.len()),
        shown(delays.get(delays.len() / 2)),
        shown(delays.last()),
    );
}

/// Prints the drift by a tenth of a degree an hour: followed, or flagged.
fn drift(seeds: u64) {
    println!("two hours with a drift of 0.1° an hour from the tenth minute on");
    println!("drift         seed  largest error      in sigmas  events  first seen after");
    let per_s = 0.1f64.to_radians() / 3600.0;
    for (name, change, parameter) in [
        (
            "steering",
            Change::SteeringDrift(per_s),
            Parameter::SteeringOffset,
        ),
        (
            "mount's yaw",
            Change::MountYawDrift(per_s),
            Parameter::LidarYaw,
        ),
    ] {
        for seed in 1..=seeds {
            let (mut config, calibrator) = tugger(seed);
            config.lidar = poses();
            config.changes = vec![ScheduledChange {
                at_s: 600.0,
                change,
            }];
            let run = drive(config, calibrator, 7200.0);
            let (mut largest, mut sigmas) = (0.0_f64, 0.0_f64);
            for (estimate, truth) in run.estimates.iter().filter(|(e, _)| e.time_s > 600.0) {
                let error = error_of(parameter, estimate, truth).abs();
                largest = largest.max(error);
                sigmas = sigmas.max(error / estimate.parameter(parameter).sigma);
            }
            println!(
                "{name:<12} {seed:>5} {:>13.4}° {sigmas:>14.1} {:>7}  {}",
                largest.to_degrees(),
                run.changes.len(),
                run.changes
                    .first()
                    .map_or("never".to_owned(), |seen| format!(
                        "{:.0} min as {:?}",
                        (seen.time_s - 600.0) / 60.0,
                        seen.cause
                    ))
            );
        }
    }
}

fn disturbances(seeds: u64) {
    println!("disturbances 60 s into a drive; the worst of all that was called converged");
    println!("disturbance      seeds  four parameters  all parameters  flagged as (first after)");
    for disturbance in [
        Disturbance::SlippingCar,
        Disturbance::OneSided,
        Disturbance::LeftLoop,
        Disturbance::StuckSteering,
        Disturbance::Pushed,
        Disturbance::WheelLift,
    ] {
        let (mut worst_four, mut worst_all) = (0.0_f64, 0.0_f64);
        let mut flagged = Vec::new();
        for seed in 1..=seeds {
            let run = disturbed(disturbance, seed);
            worst_four = worst_four.max(worst_converged(&run, &FOUR));
            worst_all = worst_all.max(worst_converged(&run, &Parameter::ALL));
            flagged.extend(run.changes.first().map(|change| {
                format!(
                    "{:?} {:?} {:.1} s",
                    change.kind,
                    change.cause,
                    change.time_s - disturbed::BEGIN_S
                )
            }));
        }
        flagged.sort();
        let flagged = match (flagged.first(), flagged.last()) {
            (Some(first), Some(last)) => format!("{}: {first} … {last}", flagged.len()),
            _ => "nothing".to_owned(),
        };
        println!(
            "{:<16} {seeds:>5} {worst_four:>13.1} σ {worst_all:>13.1} σ  {flagged}",
            format!("{disturbance:?}")
        );
    }
}

/// Largest error, in its sigmas, of a value that was called converged at any time.
fn worst_converged(run: &Driven, parameters: &[Parameter]) -> f64 {
    let mut worst = 0.0_f64;
    for (estimate, truth) in &run.estimates {
        for &parameter in parameters {
            let found = estimate.parameter(parameter);
            if found.status == Status::Converged {
                worst = worst.max(error_of(parameter, estimate, truth).abs() / found.sigma);
            }
        }
    }
    worst
}

/// LiDAR odometry and filter in the same run, each with its own clock.
fn steps() {
    let (config, calibrator) = tugger(1);
    let start_ns = config.start_stamp_ns;
    let mut simulation = Simulation::new(config).unwrap();
    let (mut calibrator, mut odometry) = (Calibrator::new(calibrator), LidarOdometry::default());
    let (mut bare, mut times) = (BareFilter::default(), StepTimes::default());
    loop {
        let emitted = simulation.advance();
        let time_s = (emitted.sent_ns - start_ns) as f64 * 1e-9;
        if time_s > 120.0 {
            break;
        }
        // The first minute fills the map, the windows and the caches.
        let counts = time_s > 60.0;
        let Some(event) = event_of(emitted.message) else {
            continue;
        };
        let event = if let Event::Scan(scan) = &event {
            let begin = now();
            let Some(pose) = odometry.process(scan) else {
                continue;
            };
            if counts {
                times.odometry += begin.elapsed();
                times.scans += 1;
            }
            bare.waiting.push_back(OdometryReading {
                stamp: pose.stamp,
                lidar_in_odom: pose.lidar_in_odom,
                covariance: pose.covariance,
            });
            let lidar_in_odom = Pose2 {
                yaw_rad: wrap_angle_rad(pose.lidar_in_odom.yaw_rad),
                ..pose.lidar_in_odom
            };
            // As sure as the estimator takes the poses of its own odometry for.
            let covariance = Some(pose.covariance);
            Event::LidarPose(LidarPose::new(pose.stamp, lidar_in_odom, covariance).unwrap())
        } else {
            event
        };
        if let Event::WheelOdometry(sample) = &event {
            bare.drive.push(*sample);
        }
        let begin = now();
        calibrator.step(event);
        if counts {
            times.calibrator += begin.elapsed();
            times.filter += bare.follow(&calibrator);
        } else {
            bare.waiting.clear();
        }
    }
    times.print();
    let written = serde_json::to_string(&calibrator.checkpoint()).unwrap();
    println!(
        "state to be stored                                      {:>7.1} KiB",
        written.len() as f64 / 1024.0
    );
}

/// Filter that only predicts and updates, from the state of a calibrator.
struct BareFilter {
    drive: DriveHistory,
    waiting: VecDeque<OdometryReading>,
    follower: Option<Follower>,
}

impl Default for BareFilter {
    fn default() -> Self {
        Self {
            drive: DriveHistory::new(60.0),
            waiting: VecDeque::new(),
            follower: None,
        }
    }
}

impl BareFilter {
    /// Follows the readings whose drive samples are there, and returns the time it took.
    fn follow(&mut self, calibrator: &Calibrator) -> Duration {
        let settings = &calibrator.config().settings;
        let filter = calibrator.filter().unwrap();
        let follower = self
            .follower
            .get_or_insert_with(|| Follower::new(filter.clone()));
        let newest = self.drive.newest().unwrap();
        let mut taken = Duration::ZERO;
        while let Some(reading) = self.waiting.front()
            && follower.drive_time(reading, settings) <= newest
        {
            let begin = now();
            follower.follow(reading, &self.drive, settings);
            taken += begin.elapsed();
            self.waiting.pop_front();
        }
        taken
    }
}

#[derive(Default)]
struct StepTimes {
    scans: u32,
    odometry: Duration,
    filter: Duration,
    calibrator: Duration,
}

impl StepTimes {
    fn print(&self) {
        let per_scan_us = |time: Duration| 1e6 * time.as_secs_f64() / f64::from(self.scans);
        let odometry_us = per_scan_us(self.odometry);
        println!(
            "for each scan of 1024 beams, over {} scans of the same run",
            self.scans
        );
        println!("LiDAR odometry                                          {odometry_us:>7.1} µs");
        for (name, time) in [
            (
                "filter: 10 predictions and an update              ",
                self.filter,
            ),
            (
                "all but the odometry: order, filter, tests, advice",
                self.calibrator,
            ),
        ] {
            let us = per_scan_us(time);
            println!(
                "{name}      {us:>7.1} µs, {:.1} % of the odometry",
                100.0 * us / odometry_us
            );
        }
    }
}

#[expect(
    clippy::disallowed_methods,
    reason = "the time it takes is what is measured"
)]
fn now() -> Instant {
    Instant::now()
}
