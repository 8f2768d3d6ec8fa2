//! Forward and backward drives of a robot whose tyres give way. Its motion is made here, of the
//! force on its tyres, and of nothing that the estimator or the simulator shares.

use std::f64::consts::TAU;

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::vehicle::VehicleModel;
use fleetcal_estimator::{
    Calibrator, DriveSample, Effect, Event, LidarPose, Parameter, Pose2, RobotTime, Vehicle,
};
use nalgebra::Matrix3;
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use rand_distr::StandardNormal;

const WHEELBASE_M: f64 = 1.2;
/// Half of the slip of small cars with soft tyres, and all of it, rad for each m/s^2: 15 and 30 mm of `x` at
/// 1 m/s, to one side forward and to the other backward.
const SLIPS_RAD_PER_MPS2: [f64; 2] = [0.015, 0.03];
const OFFSET_RAD: f64 = 0.02;
/// Place of the LiDAR: x, y, m; yaw, rad.
const MOUNT: [f64; 3] = [0.4, 0.1, 0.05];
const POSE_SIGMA_M: f64 = 0.003;
const POSE_SIGMA_RAD: f64 = 5e-4;
const TURNS_BACK_S: f64 = 90.0;
const WATCHED_S: f64 = 180.0;
const STEP_S: f64 = 0.01;

/// Bends to both sides at 1 m/s, with 100 samples and 10 poses a second.
struct Robot {
    random: StdRng,
    slip_rad_per_mps2: f64,
    /// 1 forward, -1 backward, until it turns back.
    begins: f64,
    tick: i64,
    /// The rear axle: x, y, m; yaw, rad.
    pose: [f64; 3],
}

impl Robot {
    fn new(seed: u64, slip_rad_per_mps2: f64, begins: f64) -> Self {
        Self {
            random: StdRng::seed_from_u64(seed),
            slip_rad_per_mps2,
            begins,
            tick: 0,
            pose: [0.0; 3],
        }
    }

    fn noise(&mut self, sigma: f64) -> f64 {
        sigma * self.random.sample::<f64, _>(StandardNormal)
    }

    fn time_s(&self) -> f64 {
        self.tick as f64 * STEP_S
    }

    fn stamp(&self) -> RobotTime {
        RobotTime(1_700_000_000_000_000_000 + self.tick * 10_000_000)
    }

    /// Drives for a hundredth of a second.
    fn drive(&mut self) -> DriveSample {
        let middle_s = self.time_s() + 0.5 * STEP_S;
        // From 1 m/s to -1 m/s within 4 s.
        let speed_mps = self.begins * (1.0 - (middle_s - TURNS_BACK_S) / 2.0).clamp(-1.0, 1.0);
        let steering_rad = 0.4 * (TAU * middle_s / 15.0).sin();
        // Rolling without slip, the axle's middle goes round the point that the steering points at.
        let yaw_rate_radps = speed_mps * steering_rad.tan() / WHEELBASE_M;
        // What keeps the robot on its bend is a force of the road on its tyres, towards the bend's middle; the
        // tyres give way to the other side by an angle to the way that they roll.
        let to_the_left_mps2 = speed_mps * yaw_rate_radps;
        let gives_way_rad = -self.slip_rad_per_mps2 * to_the_left_mps2;
        let side_mps = speed_mps.abs() * gives_way_rad;
        let [x_m, y_m, yaw_rad] = &mut self.pose;
        let (sin, cos) = (*yaw_rad + 0.5 * STEP_S * yaw_rate_radps).sin_cos();
        *x_m += STEP_S * (speed_mps * cos - side_mps * sin);
        *y_m += STEP_S * (speed_mps * sin + side_mps * cos);
        *yaw_rad += STEP_S * yaw_rate_radps;
        self.tick += 1;
        let measured_mps = speed_mps + self.noise(0.005);
        let measured_rad = steering_rad + OFFSET_RAD + self.noise(0.002);
        DriveSample::new(self.stamp(), measured_mps, measured_rad).unwrap()
    }

    fn lidar(&mut self) -> LidarPose {
        let [x_m, y_m, yaw_rad] = self.pose;
        let (sin, cos) = yaw_rad.sin_cos();
        let pose = Pose2::new(
            x_m + MOUNT[0] * cos - MOUNT[1] * sin + self.noise(POSE_SIGMA_M),
            y_m + MOUNT[0] * sin + MOUNT[1] * cos + self.noise(POSE_SIGMA_M),
            yaw_rad + MOUNT[2] + self.noise(POSE_SIGMA_RAD),
        );
        let sigmas = [POSE_SIGMA_M, POSE_SIGMA_M, POSE_SIGMA_RAD];
        let covariance = Matrix3::from_diagonal(&sigmas.map(|sigma| sigma * sigma).into());
        LidarPose::new(self.stamp(), pose, Some(covariance)).unwrap()
    }
}

#[test]
fn a_lidar_stays_where_it_is_when_a_robot_turns_back() {
    let begins = |slip| [1.0, -1.0].map(|begins| (slip, begins));
    for (seed, (slip, begins)) in (1..=6).flat_map(|seed| {
        let robots = SLIPS_RAD_PER_MPS2.into_iter().flat_map(begins);
        robots.map(move |robot| (seed, robot))
    }) {
        let said = format!("slip {slip}, begins at {begins} m/s, seed {seed}");
        let mut robot = Robot::new(seed, slip, begins);
        let vehicle = Vehicle::new(VehicleModel::Bicycle, WHEELBASE_M);
        let mut calibrator = Calibrator::new(CalibratorConfig::of(vehicle));
        while robot.time_s() < WATCHED_S {
            let mut effects = calibrator.step(Event::WheelOdometry(robot.drive()));
            if robot.tick % 10 == 0 {
                effects.extend(calibrator.step(Event::LidarPose(robot.lidar())));
            }
            for effect in effects {
                if let Effect::Change(change) = effect {
                    let after_s = robot.time_s() - TURNS_BACK_S;
                    panic!("{said}, {after_s:.1} s after it turned back: {change:?}");
                }
            }
        }
        let estimate = calibrator.estimate();
        let x = estimate.parameter(Parameter::LidarX);
        let (off_mm, sigma_mm) = (1e3 * (x.value - MOUNT[0]), 1e3 * x.sigma);
        println!("{said}: x off by {off_mm:.2} mm, sigma {sigma_mm:.2} mm");
        assert!(off_mm.abs() < 3.0 * sigma_mm, "{said}: {x:?}");
    }
}
