//! Scan of a planar LiDAR, checked where it is made, so that nothing behind it has to check again.

use std::sync::Arc;

use fleetcal_model::RobotTime;
use serde::{Deserialize, Serialize};

use crate::field::{FieldRefused, check_finite, check_stamp};

/// Largest number of beams a scan may have. Real planar scanners stay below 4096.
pub const BEAMS_MAX: usize = 16_384;

/// The shape of a scan: everything of a `LaserScan` but its beams.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ScanShape {
    /// Direction of the first beam in the LiDAR's frame, rad.
    pub angle_min_rad: f64,
    /// Angle from one beam to the next, rad; negative for a scanner that turns clockwise.
    pub angle_increment_rad: f64,
    /// Time from one beam to the next, s; 0 when all were taken at once or corrected already, or
    /// when the scanner does not state it: LiDAR odometry determines which.
    pub time_increment_s: f64,
    /// Shortest valid range, m.
    pub range_min_m: f64,
    /// Longest valid range, m.
    pub range_max_m: f64,
}

/// One scan of a planar LiDAR, stamped at its first beam.
#[derive(Debug, Clone, PartialEq)]
pub struct Scan {
    stamp: RobotTime,
    shape: ScanShape,
    ranges_m: Arc<[f32]>,
    lacks_beam_times: bool,
}

impl Scan {
    /// Checks and builds a scan. Ranges that are not finite or lie outside `range_min..range_max`
    /// are no returns, which is normal input.
    ///
    /// # Errors
    /// Names the impossible field of the shape, or the number of beams.
    pub fn new(
        stamp: RobotTime,
        shape: ScanShape,
        ranges_m: Arc<[f32]>,
    ) -> Result<Self, FieldRefused> {
        check_stamp(stamp)?;
        check_finite("angle_min", shape.angle_min_rad, 10.0)?;
        check_finite("angle_increment", shape.angle_increment_rad, 1.0)?;
        if shape.angle_increment_rad == 0.0 {
            return Err(FieldRefused::new(
                "angle_increment",
                0.0,
                "a step other than zero",
            ));
        }
        if !(0.0..=1.0).contains(&shape.time_increment_s) {
            return Err(FieldRefused::new(
                "time_increment",
                shape.time_increment_s,
                "0 to 1 s",
            ));
        }
        if !(shape.range_min_m >= 0.0 && shape.range_min_m.is_finite()) {
            return Err(FieldRefused::new(
                "range_min",
                shape.range_min_m,
                "0 m or more",
            ));
        }
        if shape.range_max_m.is_nan() || shape.range_max_m <= shape.range_min_m {
            return Err(FieldRefused::new(
                "range_max",
                shape.range_max_m,
                "more than range_min",
            ));
        }
        if ranges_m.is_empty() || ranges_m.len() > BEAMS_MAX {
            return Err(FieldRefused::new(
                "ranges",
                ranges_m.len(),
                "1 to 16384 beams",
            ));
        }
        let span_rad = shape.angle_increment_rad.abs() * (ranges_m.len() - 1) as f64;
        if span_rad > std::f64::consts::TAU + 0.2 {
            return Err(FieldRefused::new(
                "angle_increment",
                span_rad,
                "at most one turn in all",
            ));
        }
        let duration_s = shape.time_increment_s * ranges_m.len() as f64;
        if duration_s > 2.0 {
            return Err(FieldRefused::new(
                "time_increment",
                duration_s,
                "a scan of at most 2 s",
            ));
        }
        Ok(Self {
            stamp,
            shape,
            ranges_m,
            lacks_beam_times: false,
        })
    }

    /// Marks a scan made of points without times: not even the order of its beams is known.
    #[must_use]
    pub fn without_beam_times(self) -> Self {
        Self {
            lacks_beam_times: true,
            ..self
        }
    }

    /// True if it was made of points without times.
    pub fn lacks_beam_times(&self) -> bool {
        self.lacks_beam_times
    }

    /// Time of the first beam.
    pub fn stamp(&self) -> RobotTime {
        self.stamp
    }

    /// The scan's shape.
    pub fn shape(&self) -> &ScanShape {
        &self.shape
    }

    /// Ranges, m, one a beam.
    pub fn ranges_m(&self) -> &[f32] {
        &self.ranges_m
    }

    /// The scan's reference time: its middle. Poses of a scan are poses at this time.
    pub fn reference_stamp(&self) -> RobotTime {
        self.middle_stamp(self.shape.time_increment_s)
    }

    /// Its middle when its beams follow each other after `time_increment_s`.
    pub(crate) fn middle_stamp(&self, time_increment_s: f64) -> RobotTime {
        let half_s = 0.5 * (self.ranges_m.len() - 1) as f64 * time_increment_s;
        self.stamp.plus_seconds(half_s)
    }
}
