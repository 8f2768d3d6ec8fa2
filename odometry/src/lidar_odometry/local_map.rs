//! Map of the surroundings, and the rule by which a scan adds to it.

use std::sync::Arc;

use super::beam_filter::{LANES, ScanPoints};
use super::local_motion::LocalMotion;
use super::motion::Motion;
use super::submap::{Cell, FreeSpace, KnownMap, LocalOrigin, RAY_STRIDE, Submap};
use crate::RobotTime;
use crate::geometry::Pose2;

/// Way of the LiDAR after which the map is updated, m.
const UPDATE_DISTANCE_M: f64 = 0.2;
/// Turn of the LiDAR after which the map is updated, rad.
const UPDATE_ANGLE_RAD: f64 = 0.1;
/// Longest time after which the map is updated, s.
const UPDATE_PERIOD_S: f64 = 2.0;
/// Scans after the first that all go into the map.
const UPDATES_AT_START: u32 = 5;

/// Spacing of the points that join returns of one surface, m.
const FILL_SPACING_M: f32 = 0.07;
/// Largest distance between two joined returns, m.
const FILL_MAX_M: f32 = 0.7;
/// Weight of such a point against a return.
const FILL_WEIGHT: f32 = 0.5;

/// The local map: surfaces, free space, and where the LiDAR was at the last update.
#[derive(Debug, Clone, Default)]
pub struct LocalMap {
    /// Lines, cell by cell.
    pub submap: Submap,
    /// Space that was seen free.
    pub free_space: FreeSpace,
    pose: Pose2,
    stamp: RobotTime,
}

impl LocalMap {
    /// Begins a map that holds only the known one.
    pub fn knowing(known: Arc<KnownMap>) -> Self {
        Self {
            submap: Submap::knowing(known),
            ..Self::default()
        }
    }

    /// Bytes held, without the known map.
    pub fn memory_bytes(&self) -> usize {
        self.submap.memory_bytes() + self.free_space.memory_bytes()
    }

    /// Forgets everything that was seen; the known map stays.
    pub fn clear(&mut self) {
        self.submap.clear();
        self.free_space.clear();
    }

    /// True if a scan at `pose` should go into the map.
    pub fn is_due(&self, pose: &Pose2, stamp: RobotTime) -> bool {
        let moved = self.pose.between(pose);
        self.submap.updates() < UPDATES_AT_START
            || moved.translation().norm() > UPDATE_DISTANCE_M
            || moved.yaw_rad.abs() > UPDATE_ANGLE_RAD
            || stamp.seconds_since(self.stamp) > UPDATE_PERIOD_S
    }

    /// Adds a scan to the map: the beams mark free space and forget the points that they went
    /// through, then the returns that are not a moving object's are added.
    pub fn update(
        &mut self,
        points: &ScanPoints,
        motion: &Motion,
        stamp: RobotTime,
        range_noise_m: f32,
    ) {
        self.pose = motion.pose;
        self.stamp = stamp;
        let origin = LocalOrigin::near(motion.pose.x_m, motion.pose.y_m);
        let local = LocalMotion::new(motion, origin);
        let from = local.position();
        let (centre, _, _) = origin.locate(from.0, from.1);
        self.submap.begin_update(centre, range_noise_m);
        self.free_space.begin_update(centre, self.submap.known());
        // Other beams mark free space each time.
        let phase = self.submap.updates() as usize * (RAY_STRIDE / 2 + 1);
        let mut previous = None;
        for (number, block) in points.blocks().iter().enumerate() {
            let placed = local.place(block);
            for i in 0..block.count().min(LANES) {
                let point = (placed.wx[i], placed.wy[i]);
                let (cell, _, _) = origin.locate(point.0, point.1);
                if (number * LANES + i + phase).is_multiple_of(RAY_STRIDE) {
                    let cos_incidence = self.cos_incidence(cell, from, point);
                    self.free_space
                        .pass(origin, from, point, cos_incidence, &mut self.submap);
                }
                let direction = local.direction(placed.qx[i], placed.qy[i], block.inverse_range[i]);
                let is_still = !self.free_space.was_free(cell);
                self.free_space.hit(cell);
                if is_still {
                    self.submap.insert(origin, point, direction, 1.0);
                    if let Some(previous) = previous {
                        self.fill(origin, previous, point, direction);
                    }
                }
                previous = (block.joined[i] && is_still).then_some(point);
            }
        }
        self.submap.end_update();
    }

    /// Cosine of the incidence of a beam on the line it hits; 1 where none is known.
    fn cos_incidence(&self, cell: Cell, from: (f32, f32), to: (f32, f32)) -> f32 {
        let line = self.submap.line(cell);
        let (dx, dy) = (to.0 - from.0, to.1 - from.1);
        if line.exists() {
            (line.nx * dx + line.ny * dy).abs() / (dx * dx + dy * dy).sqrt()
        } else {
            1.0
        }
    }

    /// Fills the surface between two neighbouring returns that lie farther apart than cells.
    fn fill(
        &mut self,
        origin: LocalOrigin,
        from: (f32, f32),
        to: (f32, f32),
        direction: (f32, f32),
    ) {
        let (dx, dy) = (to.0 - from.0, to.1 - from.1);
        let length2 = dx * dx + dy * dy;
        if !(FILL_SPACING_M * FILL_SPACING_M..FILL_MAX_M * FILL_MAX_M).contains(&length2) {
            return;
        }
        let parts = (length2.sqrt() / FILL_SPACING_M).ceil();
        for part in 1..parts as i32 {
            let share = part as f32 / parts;
            let point = (from.0 + share * dx, from.1 + share * dy);
            self.submap.insert(origin, point, direction, FILL_WEIGHT);
        }
    }
}
