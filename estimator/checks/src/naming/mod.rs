//! Causes by the evidence: each part reads what the motion shows and names what contradicts it.

mod clocks;
mod speed;
mod steering;

use crate::finding::Suspicion;
use crate::motion::Motion;

/// Facts beside the motion.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Known {
    /// `true` if the speed is described as that of the steered wheel.
    pub is_at_steered_wheel: bool,
    pub wheelbase_m: f64,
    /// Yaw by the drawing, rad, where there is one.
    pub nominal_yaw_rad: Option<f64>,
    /// Shift of the LiDAR's stamps so far, s.
    pub aligned_s: f64,
    /// The LiDAR's way, m.
    pub way_m: f64,
    /// The wheels' way as sent, m.
    pub wheels_way_m: f64,
    /// `true` if LiDAR odometry lost its way of late.
    pub lost_its_way: bool,
    /// `true` if the robot sends poses instead of scans.
    pub sends_poses: bool,
}

pub(crate) use clocks::explanation;
pub(crate) use speed::is_off_centre;

/// Returns the suspicions from the motion.
pub(crate) fn suspicions(motion: &Motion, known: &Known) -> Vec<Suspicion> {
    let mut found = Vec::new();
    let is_apart = clocks::suspicions(motion, known, &mut found);
    if clocks::are_of_two(motion, known, &mut found) {
        return found;
    }
    let is_usable = speed::suspicions(motion, known, &mut found);
    if is_usable {
        steering::suspicions(motion, known, is_apart, &mut found);
    }
    found
}
