//! A robot whose steering jumps from one side to the other, as in a simulation that lets it: nobody
//! knows when and how fast the wheel turned, so nothing may be claimed of the clocks or of the
//! steering's lag.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::stream::ScanShape;
use fleetcal_estimator::vehicle::VehicleModel;
use fleetcal_estimator::{
    Calibrator, DriveSample, Effect, Estimate, Event, Parameter, RobotTime, Scan, Status, Vehicle,
};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use rand_distr::StandardNormal;

const WHEELBASE_M: f64 = 1.2;
const TURN_RAD: f64 = 0.5;
const OFFSET_RAD: f64 = 0.03;
/// Place of the LiDAR: x, y, m; yaw, rad.
const MOUNT: [f64; 3] = [0.4, 0.1, 0.05];
/// Largest error of each all the same, m and rad: the steering's curve is open where it stands on
/// two angles.
const ERROR_MAX: [(Parameter, f64); 4] = [
    (Parameter::SteeringOffset, 0.014),
    (Parameter::LidarX, 0.008),
    (Parameter::LidarY, 0.004),
    (Parameter::LidarYaw, 0.001),
];
const BEAMS: u32 = 360;
const WATCHED_S: f64 = 60.0;
/// Errors beyond so many sigmas of a parameter that is called converged are false claims.
const FALSE_SIGMAS: f64 = 4.0;

/// Eights in a hall at 1 m/s, with 100 samples and 10 scans a second.
struct Robot {
    random: StdRng,
    tick: i64,
    /// The rear axle: x, y, m; yaw, rad.
    pose: [f64; 3],
}

impl Robot {
    fn new(seed: u64) -> Self {
        Self {
            random: StdRng::seed_from_u64(seed),
            tick: 0,
            pose: [0.0; 3],
        }
    }

    fn noise(&mut self, sigma: f64) -> f64 {
        sigma * self.random.sample::<f64, _>(StandardNormal)
    }

    fn time_s(&self) -> f64 {
        self.tick as f64 / 100.0
    }

    /// Drives for a hundredth of a second.
    fn drive(&mut self) -> DriveSample {
        let circle_s = TAU * WHEELBASE_M / TURN_RAD.tan();
        let is_left = self.time_s() % (2.0 * circle_s) < circle_s;
        let steering_rad = if is_left { TURN_RAD } else { -TURN_RAD };
        let turn_rad = steering_rad.tan() / WHEELBASE_M * 0.01;
        let [x_m, y_m, yaw_rad] = &mut self.pose;
        *x_m += 0.01 * (*yaw_rad + 0.5 * turn_rad).cos();
        *y_m += 0.01 * (*yaw_rad + 0.5 * turn_rad).sin();
        *yaw_rad += turn_rad;
        self.tick += 1;
        let speed_mps = 1.0 + self.noise(0.005);
        let measured_rad = steering_rad + OFFSET_RAD + self.noise(0.002);
        DriveSample::new(self.stamp(), speed_mps, measured_rad).unwrap()
    }

    fn stamp(&self) -> RobotTime {
        RobotTime(1_700_000_000_000_000_000 + self.tick * 10_000_000)
    }

    /// Scan of four walls by the LiDAR.
    fn scan(&mut self) -> Scan {
        let ([x_m, y_m, yaw_rad], step) = (self.pose, TAU / f64::from(BEAMS));
        let lidar_x_m = x_m + MOUNT[0] * yaw_rad.cos() - MOUNT[1] * yaw_rad.sin();
        let lidar_y_m = y_m + MOUNT[0] * yaw_rad.sin() + MOUNT[1] * yaw_rad.cos();
        let ranges: Arc<[f32]> = (0..BEAMS)
            .map(|beam| {
                let angle_rad = yaw_rad + MOUNT[2] - PI + f64::from(beam) * step;
                let (sin, cos) = angle_rad.sin_cos();
                let wall_x_m = if cos > 0.0 { 7.0 } else { -9.0 };
                let wall_y_m = if sin > 0.0 { 8.0 } else { -6.0 };
                let across_m = (wall_x_m - lidar_x_m) / cos;
                let along_m = (wall_y_m - lidar_y_m) / sin;
                (across_m.min(along_m) + self.noise(0.01)) as f32
            })
            .collect();
        let shape = ScanShape {
            angle_min_rad: -PI,
            angle_increment_rad: step,
            time_increment_s: 0.0,
            range_min_m: 0.05,
            range_max_m: 30.0,
        };
        Scan::new(self.stamp(), shape, ranges).unwrap()
    }
}

fn truth_of(parameter: Parameter) -> Option<f64> {
    match parameter {
        Parameter::SteeringOffset => Some(OFFSET_RAD),
        Parameter::LidarX => Some(MOUNT[0]),
        Parameter::LidarY => Some(MOUNT[1]),
        Parameter::LidarYaw => Some(MOUNT[2]),
        Parameter::TimeOffset => Some(0.0),
        _ => None,
    }
}

fn assert_nothing_false(estimate: &Estimate, which: &str) {
    for parameter in Parameter::ALL {
        let known = estimate.parameter(parameter);
        let Some(truth) = truth_of(parameter) else {
            continue;
        };
        assert!(
            known.status != Status::Converged
                || (known.value - truth).abs() <= FALSE_SIGMAS * known.sigma,
            "{which}: {parameter:?}, true {truth}: {known:?}"
        );
    }
}

#[test]
fn nothing_false_is_claimed_where_the_steering_jumps() {
    for seed in 1..=20 {
        let mut robot = Robot::new(seed);
        let vehicle = Vehicle::new(VehicleModel::Bicycle, WHEELBASE_M);
        let mut calibrator = Calibrator::new(CalibratorConfig::of(vehicle));
        while robot.time_s() < WATCHED_S {
            let mut effects = calibrator.step(Event::WheelOdometry(robot.drive()));
            if robot.tick % 10 == 0 {
                effects.extend(calibrator.step(Event::Scan(robot.scan())));
            }
            let which = format!("seed {seed} after {:.1} s", robot.time_s());
            for effect in effects {
                match effect {
                    Effect::Estimate(estimate) => assert_nothing_false(&estimate, &which),
                    Effect::Change(change) => panic!("{which}: {change:?}"),
                    _ => {}
                }
            }
        }
        let estimate = calibrator.estimate();
        for (parameter, max) in ERROR_MAX {
            let known = estimate.parameter(parameter);
            let error = known.value - truth_of(parameter).unwrap();
            assert!(error.abs() < max, "seed {seed}: {parameter:?} {known:?}");
        }
    }
}
