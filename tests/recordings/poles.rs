//! Reflector poles: where their returns lie in the odometry frame, and how they scatter.

use std::collections::BTreeMap;

use fleetcal_estimator::RobotTime;
use fleetcal_estimator::lidar_odometry::OdometryPose;
use fleetcal_proto::ros::LaserScan;
use nalgebra::Vector2;

/// Range beyond which returns are ignored, m.
const RANGE_MAX_M: f32 = 30.0;
/// Largest distance of a pole's returns from its middle, m.
const NEAR_M: f64 = 0.3;
/// Least distance between two poles, m.
const APART_M: f64 = 0.5;
/// Size of the cells for finding the middles, m.
const CELL_M: f64 = 0.15;
/// Length of the beginning and of the end of a drive, s.
const END_S: f64 = 15.0;

/// A return from a reflector: its time, and its position in the odometry frame.
pub type Reflection = (RobotTime, Vector2<f64>);

/// A pole over the whole drive.
#[derive(Debug)]
pub struct Pole {
    /// Mean of its returns, m.
    pub middle_m: [f64; 2],
    /// Number of its returns.
    pub count: f64,
    /// Sum of their squared distances from the mean, m².
    pub sum_m2: f64,
    /// Distance from its mean over the first seconds to that over the last, m.
    pub moved_m: Option<f64>,
}

/// Returns the returns of a scan with an intensity above 0.
pub fn reflections((scan, pose): &(&LaserScan, OdometryPose)) -> Vec<Reflection> {
    let beams = scan.ranges.iter().zip(scan.intensities.iter()).enumerate();
    let bright = beams.filter(|(_, (range, intensity))| **intensity > 0.0 && **range < RANGE_MAX_M);
    bright
        .map(|(beam, (&range, _))| {
            let step_rad = f64::from(scan.angle_increment);
            let angle_rad = f64::from(scan.angle_min) + beam as f64 * step_rad;
            let (s, c) = angle_rad.sin_cos();
            let point = Vector2::new(c, s) * f64::from(range);
            (pose.stamp, pose.lidar_in_odom.transform_point(point))
        })
        .collect()
}

/// Finds the `count` poles with the most returns.
pub fn find(reflections: &[Reflection], count: usize) -> Vec<Pole> {
    let mut rest = reflections.to_vec();
    let mut poles = Vec::new();
    for _ in 0..count {
        let middle = densest(&rest);
        let (near, far) = rest
            .into_iter()
            .partition(|(_, point)| (point - middle).norm() < APART_M);
        rest = far;
        let is_near = |(_, point): &Reflection| (point - middle).norm() < NEAR_M;
        let near: Vec<Reflection> = Vec::into_iter(near).filter(is_near).collect();
        poles.push(pole(&near, reflections));
    }
    poles
}

fn pole(near: &[Reflection], all: &[Reflection]) -> Pole {
    let middle = mean(near.iter().map(|(_, point)| *point)).unwrap_or_default();
    let ends = all.first().zip(all.last());
    let moved_m = ends.and_then(|((first, _), (last, _))| {
        let at_begin = |(stamp, _): &&Reflection| stamp.seconds_since(*first) < END_S;
        let at_end = |(stamp, _): &&Reflection| last.seconds_since(*stamp) < END_S;
        let begin = mean(near.iter().filter(at_begin).map(|(_, point)| *point))?;
        let end = mean(near.iter().filter(at_end).map(|(_, point)| *point))?;
        Some((end - begin).norm())
    });
    Pole {
        middle_m: [middle.x, middle.y],
        count: near.len() as f64,
        sum_m2: near
            .iter()
            .map(|(_, point)| (point - middle).norm_squared())
            .sum(),
        moved_m,
    }
}

/// Returns the middle of the returns around the cell with most of them.
fn densest(reflections: &[Reflection]) -> Vector2<f64> {
    let mut cells: BTreeMap<(i64, i64), usize> = BTreeMap::new();
    for (_, point) in reflections {
        let cell = (point / CELL_M).map(|v| v.floor() as i64);
        *cells.entry((cell.x, cell.y)).or_default() += 1;
    }
    let fullest = cells.iter().max_by_key(|(_, count)| **count);
    let mut middle = fullest.map_or_else(Vector2::zeros, |((x, y), _)| {
        Vector2::new(*x as f64 + 0.5, *y as f64 + 0.5) * CELL_M
    });
    for _ in 0..5 {
        let near = reflections
            .iter()
            .filter(|(_, point)| (point - middle).norm() < NEAR_M);
        middle = mean(near.map(|(_, point)| *point)).unwrap_or(middle);
    }
    middle
}

fn mean(points: impl Iterator<Item = Vector2<f64>>) -> Option<Vector2<f64>> {
    let (mut sum, mut count) = (Vector2::zeros(), 0.0);
    for point in points {
        sum += point;
        count += 1.0;
    }
    (count > 0.0).then(|| sum / count)
}
