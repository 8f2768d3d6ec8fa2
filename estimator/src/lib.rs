//! The mathematics of fleetcal: vehicle models, the filter, observability and trust, above the LiDAR odometry
//! of `fleetcal_odometry`.
//!
//! Everything here is a pure function of the messages it is given: no I/O, no clock, no threads.
//! A recording replayed at any speed gives bit for bit the numbers of the live run.
//!
//! Frames: `base` is the rear-axle centre (x forward, y left, yaw counter-clockwise), `lidar` the
//! scanner. SI units and radians. Transforms are named `a_from_b`; `lidar_in_base` is the LiDAR's
//! pose in `base`, the paper's compact `T^B_L`.
//!
//! Sign of steering: `steering_true = steering_measured - steering_offset`, left positive.

pub mod advice;
pub mod calibrator;
pub mod change;
mod claim;
pub mod drive_history;
pub mod estimate;
pub mod excitation;
pub mod filter;
mod initial_guess;
mod merge;
pub mod motion_noise;
pub mod settings;
pub mod steered_way;
pub mod stream;
mod trust;
pub mod vehicle;

pub use calibrator::{Calibrator, Checkpoint};
pub use claim::without_range_scale;
pub use estimate::{Estimate, Parameter, ParameterEstimate, Status};
pub use fleetcal_model::Pose2;
/// Poses in the plane, SE(2).
pub use fleetcal_model::plane as geometry;
pub use fleetcal_odometry::{
    LidarOdometry, OccupancyGrid, lidar_odometry, occupancy_grid, point_cloud,
};
pub use merge::{JUMP_BACK_MIN_S, MergerPosition};
pub use settings::{EstimatorSettings, Freedom};
pub use stream::{DriveSample, Dropped, Effect, Event, LidarPose, Note, NoteKind, RobotTime, Scan};
pub use vehicle::{Vehicle, VehicleModel};
