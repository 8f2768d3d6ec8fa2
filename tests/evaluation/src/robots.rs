//! The robots of the evaluation: the paper's two, as far as it describes them.

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::geometry::Pose2;
use fleetcal_estimator::{Vehicle, VehicleModel};
use fleetcal_robot::simulator::{
    LidarOutput, LocalisationNoise, Point, Pose2 as TruePose, PoseSettings, Route,
    SimulationConfig, Slip, SpeedProfile, VehicleTruth,
};

use crate::drive::Robot;

/// The tugger's mount by CAD, from the paper: m, m, rad.
pub const TUGGER_CAD: Pose2 = Pose2::new(0.434, 0.0, 0.0);
/// The nano's mount by CAD, from the paper: m, m, rad.
pub const NANO_CAD: Pose2 = Pose2::new(0.26, 0.0, 0.0);
/// Errors that a robot's data sheet does not cover, in all studies unless stated otherwise: a wheel
/// 0.5 % larger than it should be, and wheel odometry that is 20 ms late.
const SPEED_SCALE: f64 = 1.005;
const TIME_OFFSET_S: f64 = 0.02;

/// Localisation noise of a robot in a warehouse: 1 cm and 0.3°, again ten times a second.
pub const WAREHOUSE_LOCALISATION: LocalisationNoise = LocalisationNoise {
    position_sigma_m: 0.01,
    yaw_sigma_rad: 0.3 / 180.0 * std::f64::consts::PI,
};

/// Makes a mount from metres and degrees.
pub fn mount(x_m: f64, y_m: f64, yaw_deg: f64) -> TruePose {
    TruePose::new(x_m, y_m, yaw_deg.to_radians())
}

/// Makes a tugger on the figure-eight, with raw scans and three people: its true mount, its true
/// steering offset (degrees), and a calibrator without either.
pub fn tugger(seed: u64, lidar_in_base: TruePose, steering_offset_deg: f64) -> Robot {
    let mut simulation = SimulationConfig::figure_eight(seed);
    simulation.vehicle.lidar_in_base = lidar_in_base;
    simulation.vehicle.steering_offset_rad = steering_offset_deg.to_radians();
    simulation.vehicle.speed_scale = SPEED_SCALE;
    simulation.vehicle.time_offset_s = TIME_OFFSET_S;
    simulation.applied.lidar_in_base = crate::drive::simulators_pose(&TUGGER_CAD);
    let vehicle = Vehicle::new(VehicleModel::Bicycle, simulation.vehicle.wheelbase_m);
    Robot {
        simulation,
        calibrator: CalibratorConfig::of(vehicle),
        heard_from_s: 0.0,
    }
}

/// Loads the tugger with 500 kg: its tyres give way in bends and its wheels slip more.
pub fn laden(mut robot: Robot) -> Robot {
    robot.simulation.vehicle.slip = Slip {
        longitudinal_sigma: 0.003,
        lateral_rad_per_mps2: 0.002,
    };
    robot
}

/// Makes the small robot on a small figure-eight: half a metre of wheelbase, at walking pace.
pub fn nano(seed: u64, lidar_in_base: TruePose, steering_offset_deg: f64) -> Robot {
    let mut robot = tugger(seed, lidar_in_base, steering_offset_deg);
    let simulation = &mut robot.simulation;
    simulation.vehicle = VehicleTruth {
        wheelbase_m: 0.5,
        steering_lag_s: 0.05,
        ..simulation.vehicle
    };
    simulation.applied.lidar_in_base = crate::drive::simulators_pose(&NANO_CAD);
    simulation.route = Route::figure_eight(Point::new(-11.0, 0.0), 3.0, 1.0);
    simulation.speed = SpeedProfile {
        min_mps: 0.3,
        max_mps: 0.9,
        ..simulation.speed
    };
    robot.calibrator = CalibratorConfig::of(Vehicle::new(VehicleModel::Bicycle, 0.5));
    robot
}

/// Replaces the robot's raw scans by its own LiDAR odometry of 3 mm and 0.03°: fast, and with white
/// noise as a filter assumes.
pub fn with_lidar_poses(mut robot: Robot) -> Robot {
    robot.simulation.people.count = 0;
    robot.simulation.lidar = LidarOutput::Poses(PoseSettings {
        position_sigma_m: 0.003,
        yaw_sigma_rad: 5e-4,
        ..PoseSettings::default()
    });
    robot
}
