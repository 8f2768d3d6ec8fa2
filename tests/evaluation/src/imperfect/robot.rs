//! The robot of a cell and a seed: mount, offsets and imperfections drawn again for every seed.

use std::f64::consts::TAU;

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::{Vehicle, VehicleModel};
use fleetcal_robot::simulator::{
    Change, LidarOutput, LidarSettings, Pose2, PoseSettings, ScheduledChange, SimulationConfig,
    SpeedProfile,
};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

use super::cell::{Cell, InjectedChange, Scenario, Sensor, Speed};
use crate::drive::Robot;

/// Beams of a scan.
const BEAMS: u32 = 720;
/// Time before a change: a first part that is the same for all, and a share of a lap, s.
const BEFORE_CHANGE_S: [(Speed, f64, f64); 2] =
    [(Speed::Slow, 180.0, 90.0), (Speed::Fast, 120.0, 40.0)];

/// Makes the robot; returns it with the time of its change (s): between two distances (m), if these
/// are given.
pub fn robot(cell: Cell, seed: u64, changed_within_m: Option<(f64, f64)>) -> (Robot, Option<f64>) {
    let mut random = StdRng::seed_from_u64(seed);
    let mut simulation = SimulationConfig::figure_eight(seed);
    let mut around = |half: f64| random.random_range(-half..half);
    let vehicle = &mut simulation.vehicle;
    vehicle.steering_offset_rad = around(3f64.to_radians());
    vehicle.lidar_in_base = Pose2::new(
        0.434 + around(0.05),
        around(0.05),
        around(3f64.to_radians()),
    );
    vehicle.speed_scale = 1.0 + around(0.01);
    vehicle.time_offset_s = around(0.03);
    let (turn, part) = (around(0.5 * TAU), 0.5 + around(0.5));
    simulation.route = cell.road.route();
    simulation.lidar = match cell.sensor {
        Sensor::Poses => {
            simulation.people.count = 0;
            LidarOutput::Poses(PoseSettings {
                position_sigma_m: 0.003,
                yaw_sigma_rad: 5e-4,
                ..PoseSettings::default()
            })
        }
        Sensor::Scans => LidarOutput::Scans(LidarSettings {
            beams: BEAMS,
            ..LidarSettings::default()
        }),
    };
    simulation.imperfections = cell.flaw.imperfections(seed, cell.sensor);
    let change_s = match cell.scenario {
        Scenario::Unchanged => None,
        Scenario::Changed(change, speed) => {
            let at_s = change_at_s(speed, part, changed_within_m);
            simulation.speed = steady(speed);
            simulation.changes = vec![ScheduledChange {
                at_s,
                change: injected(change, turn),
            }];
            Some(at_s)
        }
    };
    // What its owner knows: the wheelbase of the data sheet, and nothing of the mount.
    let known = Vehicle::new(VehicleModel::Bicycle, simulation.configured_wheelbase_m());
    let calibrator = CalibratorConfig::of(known);
    (
        Robot {
            simulation,
            calibrator,
            heard_from_s: 0.0,
        },
        change_s,
    )
}

fn steady(speed: Speed) -> SpeedProfile {
    SpeedProfile {
        min_mps: speed.mps(),
        max_mps: speed.mps(),
        ..SpeedProfile::default()
    }
}

/// Returns the time of the change, s: anywhere on the lap, or between two distances, `part` of 0 to
/// 1.
fn change_at_s(speed: Speed, part: f64, within_m: Option<(f64, f64)>) -> f64 {
    if let Some((first_m, last_m)) = within_m {
        return (first_m + part * (last_m - first_m)) / speed.mps();
    }
    let of_speed = BEFORE_CHANGE_S.iter().find(|(of, ..)| *of == speed);
    of_speed.map_or(120.0, |(_, first_s, lap_s)| first_s + part * lap_s)
}

/// Makes the change: its sign, or the direction it moves the LiDAR in, by `turn` of -pi to pi.
fn injected(change: InjectedChange, turn: f64) -> Change {
    let half_degree_rad = 0.5_f64.to_radians() * turn.signum();
    match change {
        InjectedChange::Steering => Change::SteeringOffset(half_degree_rad),
        InjectedChange::MountYaw => Change::Mount(Pose2::new(0.0, 0.0, half_degree_rad)),
        InjectedChange::MountMoved => {
            Change::Mount(Pose2::new(0.02 * turn.cos(), 0.02 * turn.sin(), 0.0))
        }
        InjectedChange::MountSideways => Change::Mount(Pose2::new(0.0, 0.01 * turn.signum(), 0.0)),
    }
}
