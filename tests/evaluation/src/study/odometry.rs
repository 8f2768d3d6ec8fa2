//! Study 5: odometry with and without the steering offset (the paper's last figure).

use std::f64::consts::TAU;
use std::ops::ControlFlow;

use fleetcal_estimator::geometry::Pose2;
use fleetcal_estimator::vehicle::{DriveParameters, DriveReading, SteeringCurve, SteeringResponse};
use fleetcal_estimator::{Estimate, Parameter};
use fleetcal_robot::simulator::{LocalisationNoise, Point, Route, SimulatedMessage};
use rayon::prelude::*;

use super::cases::last;
use crate::drive::{Robot, Seen, drive, drive_watched, estimators_pose};
use crate::error::EvaluationError;
use crate::extent::Extent;
use crate::paper::{ODOMETRY_AUTONOMOUS_M, ODOMETRY_MANUAL_M};
use crate::path::{DeadReckoning, Path};
use crate::plot::{BLUE_LINE, GREEN_LINE, GREY_LINE, ORANGE_LINE, Panel, Points, Series, figure};
use crate::report::{Section, Table};
use crate::robots::{mount, tugger};
use crate::statistics::{mean, rms};

const STUDY: &str = "odometry";
/// Time in which any route is long enough, s.
const LONG_ENOUGH_S: f64 = 600.0;

/// A kind of drive, and the paper's RMSE without and with the offset, m.
struct Kind {
    name: &'static str,
    paper_m: (f64, f64),
    robot: fn(u64) -> Robot,
}

/// Distances between trajectories of one drive, RMSE in m.
struct Apart {
    uncompensated_filter: f64,
    compensated_filter: f64,
    uncompensated_truth: f64,
    compensated_truth: f64,
    all_truth: f64,
    filter_truth: f64,
    drawn: [Points; 4],
}

/// Runs the study.
///
/// # Errors
/// The error of a run or a figure.
pub fn study(extent: &Extent) -> Result<Section, EvaluationError> {
    let mut section = Section::new("5. Odometry over 300 m (the paper's last figure)");
    section.words(format!(
        "A tugger whose steering zero is 0.92° off (Table I) drives {:.0} m: by hand about the \
         staging area, its driver never quite on his line, and by itself through the aisles. Dead \
         reckoning by wheels and steering alone starts at the true pose, once with the steering as \
         measured, once less the offset that a calibration of {:.0} s *on another day* found, and \
         once with everything that it found (speed scale and delay too). The paper compares with its \
         filter's trajectory, as it has no truth, and takes the offset of the same drive.",
        extent.odometry_m, extent.calibration_s
    ));
    let kinds = [
        Kind {
            name: "manual",
            paper_m: ODOMETRY_MANUAL_M,
            robot: by_hand,
        },
        Kind {
            name: "autonomous",
            paper_m: ODOMETRY_AUTONOMOUS_M,
            robot: through_the_aisles,
        },
    ];
    let mut table = Table::new(&[
        "drive",
        "uncompensated, m",
        "offset removed, m",
        "ratio",
        "everything found, m",
    ]);
    let (mut panels, mut least) = (Vec::new(), f64::INFINITY);
    for kind in kinds {
        let seeds = extent.seeds();
        let each = |&seed: &u64| one_drive(extent, &kind, seed);
        let all: Result<Vec<_>, EvaluationError> = seeds.par_iter().map(each).collect();
        let all = all?;
        least = least.min(rows(&mut table, &kind, &all));
        panels.extend(all.first().map(|first| panel(&kind, first)));
    }
    section.table(table);
    section.figure(figure(
        "odometry",
        "Seed 1: truth (grey, wide), the filter (green), dead reckoning as measured (orange) and \
         less the offset (blue)",
        2,
        &panels,
    )?);
    section.at_least(
        "odometry, uncompensated over compensated",
        least,
        10.0,
        |ratio| format!("{ratio:.1} times"),
    );
    Ok(section)
}

/// Makes a robot on a route as a person might drive it: never twice the same bend, and an unsteady
/// hand.
fn by_hand(seed: u64) -> Robot {
    let mut robot = offset_tugger(seed);
    let point = |n: u32| {
        let turn = TAU * f64::from(n) / 2000.0;
        Point::new(-11.0 + 6.5 * (2.0 * turn).sin(), 2.5 * (3.0 * turn).sin())
    };
    let points: Vec<_> = (0..2000).map(point).collect();
    robot.simulation.route = Route::from_points(&points, true);
    robot.simulation.localisation = LocalisationNoise {
        position_sigma_m: 0.05,
        yaw_sigma_rad: 2f64.to_radians(),
    };
    robot
}

fn through_the_aisles(seed: u64) -> Robot {
    let mut robot = offset_tugger(seed);
    robot.simulation.route = Route::aisle_loop();
    robot
}

fn offset_tugger(seed: u64) -> Robot {
    tugger(seed, mount(0.43, 0.0046, 0.72), 0.92)
}

fn one_drive(extent: &Extent, kind: &Kind, seed: u64) -> Result<Apart, EvaluationError> {
    let another_day = offset_tugger(10_000 + seed);
    let calibrated = drive(another_day, extent.calibration_s)?;
    let (known, _) = last(STUDY, seed, &calibrated)?;
    let robot = (kind.robot)(seed);
    let vehicle = robot.calibrator.vehicle;
    let nothing = DriveParameters {
        steering_offset_rad: 0.0,
        speed_scale: 1.0,
        wheelbase_m: vehicle.wheelbase_m,
        steering_gain: 1.0,
        side_slip_rad_per_mps2: 0.0,
        curve: SteeringCurve::default(),
        response: SteeringResponse::default(),
        half_play_rad: 0.0,
    };
    let offset = DriveParameters {
        steering_offset_rad: known.parameter(Parameter::SteeringOffset).value,
        ..nothing
    };
    let all = DriveParameters {
        speed_scale: known.parameter(Parameter::SpeedScale).value,
        ..offset
    };
    let late_s = known.parameter(Parameter::TimeOffset).value;
    let mut paths = Paths {
        truth: Path::default(),
        filter: Vec::new(),
        first_lidar: None,
        reckoned: [
            DeadReckoning::new(vehicle, nothing, 0.0),
            DeadReckoning::new(vehicle, offset, 0.0),
            DeadReckoning::new(vehicle, all, late_s),
        ],
        driven_m: 0.0,
    };
    drive_watched(robot, LONG_ENOUGH_S, |_, seen, _| {
        paths.see(seen);
        if paths.driven_m < extent.odometry_m {
            ControlFlow::Continue(())
        } else {
            ControlFlow::Break(())
        }
    })?;
    paths.apart().ok_or(EvaluationError::Missing {
        study: STUDY,
        seed,
        missing: "trajectory of the filter",
    })
}

struct Paths {
    truth: Path,
    /// The filter's poses of `base` in the world, with their stamps.
    filter: Vec<(i64, Pose2)>,
    first_lidar: Option<Pose2>,
    reckoned: [DeadReckoning; 3],
    driven_m: f64,
}

impl Paths {
    fn see(&mut self, seen: Seen) {
        match seen {
            Seen::Message(emitted, _) => match &emitted.message {
                SimulatedMessage::WheelOdometry(message) => {
                    let base = estimators_pose(&emitted.truth.base);
                    self.truth.push(emitted.truth.stamp_ns, base);
                    self.driven_m += 0.01 * emitted.truth.speed_mps.abs();
                    let reading = DriveReading {
                        speed_mps: message.speed_mps,
                        steering_rad: message.steering_rad,
                        ..DriveReading::default()
                    };
                    for reckoned in &mut self.reckoned {
                        reckoned.take(message.stamp_ns, reading, &base);
                    }
                }
                SimulatedMessage::Scan(_) => {
                    let lidar = estimators_pose(&emitted.truth.lidar);
                    self.first_lidar.get_or_insert(lidar);
                }
                SimulatedMessage::LidarPose(_) | SimulatedMessage::CrossTrackError(_) => {}
            },
            Seen::Estimate(Estimate { .. }, calibrator) => {
                let odometry = self.first_lidar.zip(calibrator.base_pose());
                self.filter
                    .extend(odometry.map(|(world_from_odom, (stamp, base))| {
                        (stamp.0, world_from_odom.compose(&base))
                    }));
            }
        }
    }

    /// Returns the distances between the trajectories, at the filter's times.
    fn apart(&self) -> Option<Apart> {
        let mut distances: [Vec<f64>; 6] = Default::default();
        for (stamp_ns, filter) in &self.filter {
            let places = self.truth.at(*stamp_ns).and_then(|truth| {
                let [raw, offset, all] = &self.reckoned;
                let raw = raw.path.at(*stamp_ns)?;
                let offset = offset.path.at(*stamp_ns)?;
                Some([
                    distance_m(&raw, filter),
                    distance_m(&offset, filter),
                    distance_m(&raw, &truth),
                    distance_m(&offset, &truth),
                    distance_m(&all.path.at(*stamp_ns)?, &truth),
                    distance_m(filter, &truth),
                ])
            });
            for (list, distance) in distances.iter_mut().zip(places.into_iter().flatten()) {
                list.push(distance);
            }
        }
        if distances[0].is_empty() {
            return None;
        }
        let [raw_filter, offset_filter, raw, offset, all, filter] = distances.map(|d| rms(&d));
        let [reckoned_raw, reckoned_offset, _] = &self.reckoned;
        Some(Apart {
            uncompensated_filter: raw_filter,
            compensated_filter: offset_filter,
            uncompensated_truth: raw,
            compensated_truth: offset,
            all_truth: all,
            filter_truth: filter,
            drawn: [
                thin(self.truth.points()),
                self.filter.iter().map(|(_, p)| (p.x_m, p.y_m)).collect(),
                thin(reckoned_raw.path.points()),
                thin(reckoned_offset.path.points()),
            ],
        })
    }
}

fn distance_m(a: &Pose2, b: &Pose2) -> f64 {
    (a.x_m - b.x_m).hypot(a.y_m - b.y_m)
}

/// Thins points to two a second, which suffices for a drawing.
fn thin(points: Points) -> Points {
    points.into_iter().step_by(50).collect()
}

/// Adds a drive's rows and returns the factor by which the offset improved it, against the truth.
fn rows(table: &mut Table, kind: &Kind, all: &[Apart]) -> f64 {
    let of = |what: fn(&Apart) -> f64| mean(&all.iter().map(what).collect::<Vec<_>>());
    let (name, (raw, offset)) = (kind.name, kind.paper_m);
    table.row([
        format!("*{name}: paper, from its filter*"),
        format!("*{raw}*"),
        format!("*{offset}*"),
        format!("*{:.1}*", raw / offset),
        String::new(),
    ]);
    let (raw, offset) = (of(|a| a.uncompensated_filter), of(|a| a.compensated_filter));
    table.row([
        format!("{name}: from our filter"),
        format!("{raw:.2}"),
        format!("{offset:.3}"),
        format!("{:.0}", raw / offset),
        String::new(),
    ]);
    let (raw, offset) = (of(|a| a.uncompensated_truth), of(|a| a.compensated_truth));
    table.row([
        format!(
            "{name}: from the truth (filter itself: {:.3} m)",
            of(|a| a.filter_truth)
        ),
        format!("{raw:.2}"),
        format!("{offset:.3}"),
        format!("{:.0}", raw / offset),
        format!("{:.3}", of(|a| a.all_truth)),
    ]);
    raw / offset
}

fn panel(kind: &Kind, apart: &Apart) -> Panel {
    let [truth, filter, raw, offset] = apart.drawn.clone();
    let all = || [&truth, &raw, &offset].into_iter().flatten();
    let bounds = |of: fn(&(f64, f64)) -> f64| {
        let (low, high) = all()
            .map(of)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
                (low.min(value), high.max(value))
            });
        low - 1.0..high + 1.0
    };
    Panel {
        title: kind.name.to_owned(),
        x_name: "x, m".to_owned(),
        y_name: "y, m".to_owned(),
        x: bounds(|point| point.0),
        y: bounds(|point| point.1),
        series: vec![
            Series::Line(truth.clone(), GREY_LINE, 4),
            Series::Line(raw.clone(), ORANGE_LINE, 1),
            Series::Line(filter, GREEN_LINE, 1),
            Series::Line(offset.clone(), BLUE_LINE, 1),
        ],
        legend: Vec::new(),
    }
}
