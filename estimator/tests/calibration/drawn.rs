//! Vehicles whose true parameters are drawn from the filter's own priors.

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::motion_noise::MotionNoise;
use fleetcal_robot::simulator::{
    Pose2, SimulationConfig, Slip, VehicleImperfections, VehicleTruth,
};
use rand::{Rng, SeedableRng, rngs::StdRng};
use rand_distr::StandardNormal;

use crate::drive::{poses, vehicle_of};

/// A tugger whose true parameters are drawn from the filter's priors.
pub fn drawn(seed: u64) -> (SimulationConfig, CalibratorConfig) {
    let mut random = StdRng::seed_from_u64(seed);
    let mut normal = |sigma: f64| sigma * random.sample::<f64, _>(StandardNormal);
    let wheelbase_m = 1.2;
    let mut config = SimulationConfig::figure_eight(seed);
    config.lidar = poses();
    config.people.count = 0;
    config.vehicle = VehicleTruth {
        wheelbase_m: wheelbase_m * (1.0 + normal(0.005)),
        lidar_in_base: Pose2::new(0.434 + normal(0.1), normal(0.05), normal(0.1)),
        steering_offset_rad: normal(0.03),
        speed_scale: 1.0 + normal(0.02),
        time_offset_s: normal(0.03),
        slip: Slip {
            longitudinal_sigma: 0.002,
            lateral_rad_per_mps2: normal(0.003).abs(),
        },
        ..VehicleTruth::default()
    };
    // As the steering offset and the time offset, within the priors.
    let curve_rad = 0.2f64.to_radians();
    config.imperfections.vehicle = VehicleImperfections {
        steering_gain: normal(0.014),
        steering_asymmetry: normal(0.007),
        steering_quadratic_rad: normal(curve_rad),
        steering_cubic_rad: normal(curve_rad),
        ..VehicleImperfections::default()
    };
    config.applied.lidar_in_base = config.vehicle.lidar_in_base;
    let calibrator = CalibratorConfig::of(vehicle_of(&config.vehicle, wheelbase_m));
    (config, calibrator)
}

/// The same with a steering whose curve is drawn from the whole of its priors.
pub fn drawn_with_whole_curve(seed: u64) -> (SimulationConfig, CalibratorConfig) {
    let (mut config, calibrator) = drawn(seed);
    let vehicle = &mut config.imperfections.vehicle;
    // Priors of 0.02 and 0.01, and of 0.3 degrees at 20 degrees.
    vehicle.steering_gain *= 0.02 / 0.014;
    vehicle.steering_asymmetry *= 0.01 / 0.007;
    vehicle.steering_quadratic_rad *= 0.3 / 0.2;
    vehicle.steering_cubic_rad *= 0.3 / 0.2;
    (config, calibrator)
}

/// The same with sensors whose noise is as the filter models it, and the filter configured with its
/// size.
pub fn drawn_with_white_noise(seed: u64) -> (SimulationConfig, CalibratorConfig) {
    let (speed_sigma_mps, steering_sigma_rad) = (0.05, 0.002);
    let (mut config, mut calibrator) = drawn(seed);
    config.vehicle.slip.longitudinal_sigma = 0.0;
    config.drive.speed_sigma_mps = speed_sigma_mps;
    config.drive.steering_sigma_rad = steering_sigma_rad;
    config.drive.steering_step_rad = 0.0;
    // A white error of one of a hundred samples a second, at 1 m/s: sigma * dt * sqrt(rate).
    let per_sqrt_m = 0.1;
    calibrator.settings.motion_noise = MotionNoise {
        along_m_per_sqrt_m: speed_sigma_mps * per_sqrt_m,
        across_m_per_sqrt_m: 1e-5,
        yaw_rad_per_sqrt_m: 1e-5,
        steering_rad_sqrt_m: steering_sigma_rad * per_sqrt_m,
    };
    (config, calibrator)
}
