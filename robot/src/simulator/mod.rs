//! A deterministic simulator of a wheeled robot with a rolling 2D LiDAR in a warehouse.
//!
//! Everything random comes from the seed and all time is simulated, so a [`SimulationConfig`] gives
//! the same messages bit for bit on every run. Frames and signs: `base` is the rear-axle centre, x
//! forward, y left; `steering_true = steering_gain * (steering_measured - steering_offset)`;
//! `speed_true = speed_scale * speed_measured`; a motion shows in the drive stream `time_offset`
//! later than in the LiDAR's.

mod check;
mod config;
mod controller;
mod drive_sensor;
mod lidar;
mod message;
mod people;
mod plane;
mod pose_sensor;
mod random;
mod ray;
mod route;
mod simulation;
#[cfg(test)]
mod tests;
mod track;
mod vehicle;
mod warehouse;
mod world;

pub use check::SettingRefused;
pub use config::{
    Applied, Change, LidarOutput, LocalisationNoise, PeopleSettings, PersonShape, ScheduledChange,
    SimulationConfig, SpeedProfile,
};
pub use drive_sensor::DriveSettings;
pub use lidar::LidarSettings;
pub use message::{
    CrossTrackError, Drive, Emitted, LidarPose, SimulatedMessage, Sweep, TrueParameters, Truth,
};
pub use plane::{Point, Pose2};
pub use pose_sensor::PoseSettings;
pub use route::Route;
pub use simulation::Simulation;
pub use vehicle::{Slip, VehicleModel, VehicleTruth};
pub use world::{Area, Pillar, Segment, World};
