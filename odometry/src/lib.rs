//! Planar LiDAR odometry: scans or clouds in, poses with their covariance out.
//!
//! Everything here is a pure function of the scans it is given: no I/O, no clock, no threads. Nothing here
//! knows of wheels, steering or where the LiDAR sits on a vehicle.
//!
//! The frame `odom` is the LiDAR's frame at the first scan, or that of a known map. SI units and radians;
//! transforms are named `a_from_b`.

pub mod field;
pub mod lidar_odometry;
pub mod occupancy_grid;
pub mod point_cloud;
pub mod scan;

/// Poses in the plane, SE(2).
pub use fleetcal_model::plane as geometry;
pub use fleetcal_model::{Pose2, RobotTime};
pub use lidar_odometry::{LidarOdometry, OdometryPose};
pub use occupancy_grid::OccupancyGrid;
pub use scan::{Scan, ScanShape};
