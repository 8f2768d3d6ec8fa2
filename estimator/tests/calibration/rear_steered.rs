//! A forklift that drives mostly backwards. Its motion is made here, of the condition that neither
//! axle slides sideways, and of nothing that the estimator or the simulator shares.

use std::f64::consts::TAU;

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::vehicle::{SpeedMeasuredAt, VehicleModel};
use fleetcal_estimator::{
    Calibrator, DriveSample, Estimate, Event, LidarPose, Parameter, Pose2, RobotTime, Status,
    Vehicle,
};
use nalgebra::{Matrix3, Matrix4, Vector4};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use rand_distr::StandardNormal;

/// Distance of the steered wheel behind the load axle, m.
const WHEELBASE_M: f64 = 1.4;
const STEP_S: f64 = 0.01;
const DRIVEN_S: f64 = 240.0;
const POSE_SIGMA_M: f64 = 0.003;
const POSE_SIGMA_RAD: f64 = 5e-4;

/// Truth of one forklift.
struct Truth {
    offset_rad: f64,
    /// Place of the LiDAR in the frame of the load axle: x, y, m; yaw, rad.
    mount: [f64; 3],
    speed_scale: f64,
    /// True if the speed is measured at the steered wheel, as of reach trucks.
    at_steered_wheel: bool,
}

impl Truth {
    fn of(seed: u64) -> Self {
        let mut random = StdRng::seed_from_u64(1_000 + seed);
        let mut within = |most: f64| random.random_range(-most..most);
        Self {
            offset_rad: within(0.05),
            mount: [-0.6 + within(0.1), within(0.1), within(0.05)],
            speed_scale: 1.0 + within(0.01),
            at_steered_wheel: seed.is_multiple_of(2),
        }
    }

    fn vehicle(&self, model: VehicleModel) -> Vehicle {
        let mut vehicle = Vehicle::new(model, WHEELBASE_M);
        if self.at_steered_wheel {
            vehicle.speed_measured_at = SpeedMeasuredAt::SteeredWheel;
        }
        vehicle
    }
}

/// Drives a forklift past an estimator for its vehicle, and returns the last estimate.
fn driven(seed: u64, truth: &Truth, vehicle: Vehicle, duration_s: f64) -> Estimate {
    let mut random = StdRng::seed_from_u64(seed);
    let mut calibrator = Calibrator::new(CalibratorConfig::of(vehicle));
    let mut noise = |sigma: f64| sigma * random.sample::<f64, _>(StandardNormal);
    let (mut x_m, mut y_m, mut yaw_rad) = (0.0_f64, 0.0_f64, 0.0_f64);
    for tick in 0..(duration_s / STEP_S) as i64 {
        let middle_s = (tick as f64 + 0.5) * STEP_S;
        // Forwards for a quarter of the time, with stops between.
        let forwards = (TAU * middle_s / 40.0).sin() - 0.7;
        let speed_mps = (2.0 * forwards).clamp(-1.0, 1.0);
        // Of the wheel, counter-clockwise.
        let wheel_rad = 0.45 * (TAU * middle_s / 17.0).sin() + 0.1 * (TAU * middle_s / 71.0).sin();
        // The wheel, at -L, moves by (v, -L w), which is along its own direction.
        let yaw_rate_radps = -speed_mps * wheel_rad.tan() / WHEELBASE_M;
        let wheel_mps = speed_mps.signum() * speed_mps.hypot(WHEELBASE_M * yaw_rate_radps);
        let (sin, cos) = (yaw_rad + 0.5 * STEP_S * yaw_rate_radps).sin_cos();
        x_m += STEP_S * speed_mps * cos;
        y_m += STEP_S * speed_mps * sin;
        yaw_rad += STEP_S * yaw_rate_radps;
        let rolled_mps = if truth.at_steered_wheel {
            wheel_mps
        } else {
            speed_mps
        };
        let stamp = RobotTime(1_700_000_000_000_000_000 + (tick + 1) * 10_000_000);
        let measured_mps = rolled_mps / truth.speed_scale + noise(0.005);
        let measured_rad = wheel_rad + truth.offset_rad + noise(0.002);
        let sample = DriveSample::new(stamp, measured_mps, measured_rad).unwrap();
        calibrator.step(Event::WheelOdometry(sample));
        if tick % 10 == 0 {
            let (sin, cos) = yaw_rad.sin_cos();
            let [at_x, at_y, at_yaw] = truth.mount;
            let pose = Pose2::new(
                x_m + at_x * cos - at_y * sin + noise(POSE_SIGMA_M),
                y_m + at_x * sin + at_y * cos + noise(POSE_SIGMA_M),
                yaw_rad + at_yaw + noise(POSE_SIGMA_RAD),
            );
            let sigmas = [POSE_SIGMA_M, POSE_SIGMA_M, POSE_SIGMA_RAD];
            let covariance = Matrix3::from_diagonal(&sigmas.map(|sigma| sigma * sigma).into());
            let pose = LidarPose::new(stamp, pose, Some(covariance)).unwrap();
            calibrator.step(Event::LidarPose(pose));
        }
    }
    calibrator.step(Event::EndOfSession);
    calibrator.estimate()
}

const FOUR: [Parameter; 4] = [
    Parameter::SteeringOffset,
    Parameter::LidarX,
    Parameter::LidarY,
    Parameter::LidarYaw,
];

/// Errors of the four, m and rad.
fn errors(estimate: &Estimate, truth: &Truth) -> [f64; 4] {
    let [x_m, y_m, yaw_rad] = truth.mount;
    let wanted = [truth.offset_rad, x_m, y_m, yaw_rad];
    let values = FOUR.map(|parameter| estimate.parameter(parameter).value);
    std::array::from_fn(|i| values[i] - wanted[i])
}

#[test]
fn a_forklift_converges_to_its_truth_within_the_published_sigmas() {
    let mut sum = 0.0;
    let seeds = 1..=8;
    for seed in seeds.clone() {
        let truth = Truth::of(seed);
        let estimate = driven(
            seed,
            &truth,
            truth.vehicle(VehicleModel::RearSteered),
            DRIVEN_S,
        );
        let errors = errors(&estimate, &truth);
        for (parameter, error) in FOUR.into_iter().zip(errors) {
            let of = estimate.parameter(parameter);
            let said = format!("seed {seed}, {}: {error} ± {}", parameter.name(), of.sigma);
            assert_eq!(of.status, Status::Converged, "{said}");
            assert!(error.abs() < 3.5 * of.sigma, "{said}");
        }
        let covariance = Matrix4::from_fn(|i, j| estimate.covariance.rows()[i][j]);
        let error = Vector4::from(errors);
        sum += error.dot(&covariance.cholesky().unwrap().solve(&error));
    }
    let mean = sum / seeds.count() as f64;
    println!("published NEES of the four, mean of 8: {mean:.2}");
    // Sigmas allow for imperfections that this vehicle lacks; 32 degrees of freedom at 99.9 %.
    assert!(mean < 62.5 / 8.0, "{mean}");
}

#[test]
fn straight_driving_backwards_tells_no_x() {
    let truth = Truth {
        offset_rad: 0.0,
        ..Truth::of(1)
    };
    let vehicle = truth.vehicle(VehicleModel::RearSteered);
    let mut calibrator = Calibrator::new(CalibratorConfig::of(vehicle));
    for tick in 0..6_000_i64 {
        let stamp = RobotTime(1_700_000_000_000_000_000 + (tick + 1) * 10_000_000);
        let sample = DriveSample::new(stamp, -1.0, 0.0).unwrap();
        calibrator.step(Event::WheelOdometry(sample));
        if tick % 10 == 0 {
            let along_m = -(tick as f64 + 1.0) * STEP_S;
            let [at_x, at_y, at_yaw] = truth.mount;
            let pose = Pose2::new(along_m + at_x, at_y, at_yaw);
            let sigmas = [POSE_SIGMA_M, POSE_SIGMA_M, POSE_SIGMA_RAD];
            let covariance = Matrix3::from_diagonal(&sigmas.map(|sigma| sigma * sigma).into());
            let pose = LidarPose::new(stamp, pose, Some(covariance)).unwrap();
            calibrator.step(Event::LidarPose(pose));
        }
    }
    let estimate = calibrator.estimate();
    for parameter in [Parameter::LidarX, Parameter::LidarY] {
        let status = estimate.parameter(parameter).status;
        assert_ne!(status, Status::Converged, "{}", parameter.name());
    }
}

#[test]
fn a_forklift_described_as_steered_in_front_claims_nothing() {
    for seed in 1..=4 {
        let truth = Truth::of(seed);
        let told = if truth.at_steered_wheel {
            VehicleModel::Tricycle
        } else {
            VehicleModel::Bicycle
        };
        let estimate = driven(seed, &truth, truth.vehicle(told), 120.0);
        for parameter in FOUR {
            let status = estimate.parameter(parameter).status;
            assert_ne!(status, Status::Converged, "{}", parameter.name());
        }
    }
}
