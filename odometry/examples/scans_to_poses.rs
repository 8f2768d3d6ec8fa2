//! Scans in, poses with their covariance out: a scanner is carried in a bend through a room of 8 m by 6 m.
#![expect(clippy::print_stdout, reason = "the poses are what it is for")]

use std::f64::consts::{PI, TAU};

use fleetcal_odometry::field::FieldRefused;
use fleetcal_odometry::{LidarOdometry, RobotTime, Scan, ScanShape};

const BEAMS: i32 = 720;
const SHAPE: ScanShape = ScanShape {
    angle_min_rad: -PI,
    angle_increment_rad: TAU / BEAMS as f64,
    time_increment_s: 0.0,
    range_min_m: 0.1,
    range_max_m: 30.0,
};

/// Range in a direction from a place in the room, m: to the nearer of the walls ahead and beside.
fn range_m([x_m, y_m]: [f64; 2], direction_rad: f64) -> f32 {
    let (sin, cos) = direction_rad.sin_cos();
    let to_wall = |at_m: f64, along: f64, half_m: f64| (half_m.copysign(along) - at_m) / along;
    to_wall(x_m, cos, 4.0).min(to_wall(y_m, sin, 3.0)) as f32
}

fn main() -> Result<(), FieldRefused> {
    let mut odometry = LidarOdometry::default();
    for index in 0..40 {
        let yaw_rad = 0.02 * f64::from(index);
        let place_m = [2.5 * yaw_rad.sin(), 2.5 * (1.0 - yaw_rad.cos())];
        let angle_rad = |beam| SHAPE.angle_min_rad + f64::from(beam) * SHAPE.angle_increment_rad;
        let ranges_m = (0..BEAMS).map(|beam| range_m(place_m, yaw_rad + angle_rad(beam)));
        let stamp = RobotTime(1_760_000_000_000_000_000 + i64::from(index) * 100_000_000);
        let scan = Scan::new(stamp, SHAPE, ranges_m.collect())?;
        if let Some(pose) = odometry.process(&scan) {
            let sigma = pose.covariance.diagonal().map(f64::sqrt);
            println!("{:?} sigma {sigma:?}", pose.lidar_in_odom);
        }
    }
    Ok(())
}
