//! Configuration of a simulation.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::drive_sensor::DriveSettings;
use super::imperfections::Imperfections;
use super::lidar::LidarSettings;
pub use super::people::{PeopleSettings, PersonShape};
use super::plane::Pose2;
use super::pose_sensor::PoseSettings;
use super::route::Route;
use super::vehicle::VehicleTruth;
use super::world::World;

/// Calibration that a robot has applied and drives with.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Applied {
    /// Steering offset that it subtracts from its measured steering, rad.
    pub steering_offset_rad: f64,
    /// Pose of the LiDAR in `base` from which it computes its own.
    pub lidar_in_base: Pose2,
}

/// Speed of the robot: at rest first, then up and down between two speeds, slower in bends.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SpeedProfile {
    /// Time at rest at the start, s.
    pub rest_s: f64,
    /// Slowest speed, m/s.
    pub min_mps: f64,
    /// Fastest speed, m/s.
    pub max_mps: f64,
    /// Time from one slowest moment to the next, s.
    pub period_s: f64,
    /// Acceleration, m/s².
    pub acceleration_mps2: f64,
}

impl Default for SpeedProfile {
    fn default() -> Self {
        Self {
            rest_s: 1.0,
            min_mps: 0.5,
            max_mps: 1.5,
            period_s: 23.0,
            acceleration_mps2: 0.5,
        }
    }
}

/// Noise of the robot's localisation. Without any its wheel would stand still on a straight, and a
/// coarse steering encoder would show a single wrong number there.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LocalisationNoise {
    /// Standard deviation of each coordinate, again ten times a second, m.
    pub position_sigma_m: f64,
    /// Standard deviation of the heading, rad.
    pub yaw_sigma_rad: f64,
}

impl Default for LocalisationNoise {
    fn default() -> Self {
        Self {
            position_sigma_m: 0.003,
            yaw_sigma_rad: 0.1_f64.to_radians(),
        }
    }
}

/// Change of the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Change {
    /// The steering offset jumps by this, rad.
    SteeringOffset(f64),
    /// The LiDAR is knocked: its pose in `base` moves by this, coordinate by coordinate.
    Mount(Pose2),
    /// The steering offset drifts from now on, rad/s; 0 ends it.
    SteeringDrift(f64),
    /// The LiDAR's heading drifts from now on, rad/s; 0 ends it.
    MountYawDrift(f64),
}

/// A change and its time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ScheduledChange {
    /// Time from the start of the simulation, s.
    pub at_s: f64,
    /// The change.
    pub change: Change,
}

/// LiDAR stream that the robot sends.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LidarOutput {
    /// Raw scans.
    Scans(LidarSettings),
    /// Poses of its own odometry, without any ray casting.
    Poses(PoseSettings),
}

/// Configuration of one simulated robot. The same configuration gives the same messages.
#[derive(Debug, Clone)]
pub struct SimulationConfig {
    /// Seed of all randomness.
    pub seed: u64,
    /// Message time at the start, ns since 1970.
    pub start_stamp_ns: i64,
    /// Walls and pillars.
    pub world: Arc<World>,
    /// People who walk about.
    pub people: PeopleSettings,
    /// The vehicle's true parameters.
    pub vehicle: VehicleTruth,
    /// The calibration the robot starts with.
    pub applied: Applied,
    /// Its route.
    pub route: Route,
    /// Its speed.
    pub speed: SpeedProfile,
    /// Noise of its localisation.
    pub localisation: LocalisationNoise,
    /// Its wheel odometry.
    pub drive: DriveSettings,
    /// Its LiDAR stream.
    pub lidar: LidarOutput,
    /// Changes during the drive.
    pub changes: Vec<ScheduledChange>,
    /// Imperfections that the model of a robot does not cover.
    pub imperfections: Imperfections,
}

impl SimulationConfig {
    /// Makes a tugger on the figure-eight in the warehouse's staging area with three people, in
    /// mint condition: the scene of the project's figures.
    pub fn figure_eight(seed: u64) -> Self {
        let vehicle = VehicleTruth::default();
        let applied = Applied {
            steering_offset_rad: 0.0,
            lidar_in_base: vehicle.lidar_in_base,
        };
        Self {
            seed,
            start_stamp_ns: 1_760_000_000_000_000_000,
            world: Arc::new(World::warehouse(seed)),
            people: PeopleSettings {
                count: 3,
                shape: PersonShape::Legs,
            },
            vehicle,
            applied,
            route: Route::staging_figure_eight(),
            speed: SpeedProfile::default(),
            localisation: LocalisationNoise::default(),
            drive: DriveSettings::default(),
            lidar: LidarOutput::Scans(LidarSettings::default()),
            changes: Vec::new(),
            imperfections: Imperfections::default(),
        }
    }

    /// Returns the wheelbase that its owner knows, m: a calibration is configured with it and the
    /// robot follows its path by it.
    pub fn configured_wheelbase_m(&self) -> f64 {
        self.vehicle.wheelbase_m * (1.0 + self.imperfections.vehicle.wheelbase)
    }

    /// Returns the configuration with the settings that an imperfection replaces.
    pub(super) fn with_imperfect_settings(mut self) -> Self {
        let imperfections = &self.imperfections;
        if let Some(scan_rate_hz) = imperfections.lidar.scan_rate_hz {
            match &mut self.lidar {
                LidarOutput::Scans(lidar) => lidar.rate_hz = scan_rate_hz,
                LidarOutput::Poses(poses) => poses.rate_hz = scan_rate_hz,
            }
        }
        if imperfections.vehicle.undithered_step_rad > 0.0 {
            self.drive.steering_step_rad = imperfections.vehicle.undithered_step_rad;
            self.drive.steering_sigma_rad = 0.0;
            self.localisation = LocalisationNoise {
                position_sigma_m: 0.0,
                yaw_sigma_rad: 0.0,
            };
        }
        self
    }
}
