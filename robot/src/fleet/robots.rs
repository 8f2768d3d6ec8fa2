//! The simulated robots: each with its own faults, drawn from one seed.

use std::f64::consts::TAU;
use std::sync::Arc;

use fleetcal_proto::RobotId;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use thiserror::Error;

use crate::simulator::{
    Applied, DriveSettings, Imperfections, LidarOutput, LidarSettings, LocalisationNoise,
    PeopleSettings, PersonShape, Point, Pose2, Route, SimulationConfig, Slip, SpeedProfile,
    VehicleModel, VehicleTruth, World,
};

/// Most robots of one simulated fleet.
pub const ROBOTS_MAX: usize = 500;

/// Default start of a robot's message time, s since 1970: recordings are the same on every day.
pub const START_STAMP_S: i32 = 1_760_000_000;

/// Error of more robots than one process simulates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("robots: got {0}, expected at most {ROBOTS_MAX}")]
pub struct TooManyRobots(pub usize);

/// One robot of a simulated fleet.
#[derive(Debug, Clone)]
pub struct SimulatedRobot {
    /// Its id, `tugger_01` and so on.
    pub id: RobotId,
    /// The robot with its truth.
    pub config: SimulationConfig,
}

impl SimulatedRobot {
    /// Returns its steering geometry as an operator would register it.
    pub fn model(&self) -> VehicleModel {
        self.config.vehicle.model
    }

    /// Returns its wheelbase as an operator would register it, m.
    pub fn wheelbase_m(&self) -> f64 {
        self.config.configured_wheelbase_m()
    }

    /// Returns the LiDAR's pose by the drawing, which it uses until a calibration is applied.
    pub fn nominal(&self) -> Pose2 {
        self.config.applied.lidar_in_base
    }
}

/// Makes a fleet in one warehouse. Each steering zero is off by up to 3°, its LiDAR by up to 4 cm
/// and 2°; every third robot is a tricycle; the routes have left and right turns. The first robots
/// of a larger fleet are those of a smaller one.
///
/// # Errors
/// There are more than [`ROBOTS_MAX`].
pub fn simulated_robots(count: usize, seed: u64) -> Result<Vec<SimulatedRobot>, TooManyRobots> {
    if count > ROBOTS_MAX {
        return Err(TooManyRobots(count));
    }
    let world = Arc::new(World::warehouse(seed));
    Ok((0..count)
        .filter_map(|number| robot(number, seed, &world))
        .collect())
}

fn robot(number: usize, seed: u64, world: &Arc<World>) -> Option<SimulatedRobot> {
    let id = RobotId::parse(&format!("tugger_{:02}", number + 1)).ok()?;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(1000 + number as u64);
    let vehicle = vehicle(number, &mut random);
    let nominal = nominal_mount(vehicle.model);
    let config = SimulationConfig {
        seed: random.random(),
        start_stamp_ns: i64::from(START_STAMP_S) * 1_000_000_000,
        world: Arc::clone(world),
        people: PeopleSettings {
            count: 3,
            shape: PersonShape::Legs,
        },
        vehicle,
        applied: Applied {
            steering_offset_rad: 0.0,
            lidar_in_base: nominal,
        },
        route: route(number),
        speed: SpeedProfile {
            period_s: random.random_range(17.0..29.0),
            ..SpeedProfile::default()
        },
        localisation: LocalisationNoise::default(),
        drive: DriveSettings::default(),
        lidar: LidarOutput::Scans(LidarSettings {
            field_of_view_rad: TAU,
            phase_s: random.random_range(0.0..0.1),
            ..LidarSettings::default()
        }),
        changes: Vec::new(),
        imperfections: Imperfections::default(),
    };
    Some(SimulatedRobot { id, config })
}

fn nominal_mount(model: VehicleModel) -> Pose2 {
    match model {
        VehicleModel::Bicycle | VehicleModel::RearSteered => Pose2::new(0.434, 0.0, 0.0),
        VehicleModel::Tricycle => Pose2::new(0.95, 0.0, 0.0),
    }
}

fn vehicle(number: usize, random: &mut ChaCha8Rng) -> VehicleTruth {
    let (model, wheelbase_m) = if number % 3 == 2 {
        (VehicleModel::Tricycle, 1.4)
    } else {
        (VehicleModel::Bicycle, 1.2)
    };
    let nominal = nominal_mount(model);
    let mut around = |half_width: f64| random.random_range(-half_width..half_width);
    VehicleTruth {
        model,
        wheelbase_m,
        steering_offset_rad: around(3.0).to_radians(),
        lidar_in_base: Pose2::new(
            nominal.x_m + around(0.04),
            nominal.y_m + around(0.04),
            nominal.yaw_rad + around(2.0).to_radians(),
        ),
        speed_scale: 1.0 + around(0.008),
        time_offset_s: around(0.03),
        slip: Slip {
            longitudinal_sigma: 0.002,
            lateral_rad_per_mps2: 0.0,
        },
        ..VehicleTruth::default()
    }
}

fn route(number: usize) -> Route {
    match number % 3 {
        0 => Route::staging_figure_eight(),
        1 => Route::aisle_loop(),
        _ => Route::figure_eight(Point::new(-11.0, 1.0), -5.0, 1.7),
    }
}
