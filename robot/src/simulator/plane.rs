//! Points and poses in the plane, under the names that the simulator uses.

pub(crate) use fleetcal_model::wrap_angle_rad;
pub use fleetcal_model::{Point, Pose2};
