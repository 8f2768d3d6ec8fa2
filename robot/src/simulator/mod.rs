//! A deterministic simulator of a wheeled robot with a rolling 2D LiDAR in a warehouse.
//!
//! Everything random comes from the seed and all time is simulated, so a [`SimulationConfig`] gives
//! the same messages bit for bit on every run. Frames and signs: `base` is the rear-axle centre, x
//! forward, y left; `steering_true = steering_gain * (steering_measured - steering_offset)`;
//! `speed_true = speed_scale * speed_measured`; a motion shows in the wheel odometry `time_offset`
//! later than in the LiDAR's.

mod beams;
mod check;
mod config;
mod controller;
mod drive_sensor;
mod imperfections;
mod lidar;
mod message;
#[cfg(test)]
mod parity_tests;
mod people;
mod plane;
mod pose_sensor;
mod random;
mod ray;
#[cfg(test)]
mod reversal_tests;
mod route;
mod shape;
mod simulation;
mod stamps;
mod steering_curve;
#[cfg(test)]
mod tests;
mod track;
mod vehicle;
mod warehouse;
mod world;
mod wrong;

pub use check::SettingRefused;
pub use config::{
    Applied, Change, LidarOutput, LocalisationNoise, PeopleSettings, PersonShape, ScheduledChange,
    SimulationConfig, SpeedProfile,
};
pub use drive_sensor::DriveSettings;
pub use fleetcal_model::{Point, Pose2, VehicleModel};
pub use imperfections::{
    CURVE_REFERENCE_RAD, ClockImperfections, INCIDENCE_REFERENCE_RAD, ImperfectionKind,
    Imperfections, LidarImperfections, ScannerImperfections, Strength, VehicleImperfections,
};
pub use lidar::LidarSettings;
pub use message::{
    CrossTrackError, DriveSample, Emitted, LidarPose, Scan, SimulatedMessage, TrueParameters, Truth,
};
pub use pose_sensor::PoseSettings;
pub use route::{Reversal, Route};
pub use shape::{Area, Pillar, Segment};
pub use simulation::Simulation;
pub use vehicle::{Slip, VehicleTruth};
pub use world::World;
pub use wrong::{Delivered, WrongInput, WrongInputs};
