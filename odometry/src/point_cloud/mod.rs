//! Scan of a planar scanner from the points of a 3D one.
//!
//! Floor and ceiling go, then of each direction the nearest surface within a band of heights stays:
//! a fan of beams, as a planar scanner would have measured it.

mod band;
mod horizontal;
mod turn;

pub use band::{BandFields, PlanarBand};

use crate::RobotTime;
use crate::field::FieldRefused;
use crate::scan::{BEAMS_MAX, Scan, ScanShape};
use horizontal::HorizontalSurface;
use turn::Turn;

/// Beams of a whole turn when neither the cloud nor its owner gives a number.
const BEAMS_UNLESS_GIVEN: usize = 1024;

/// Largest depth of a beam's returns behind the nearest one on the same surface, m.
const SURFACE_DEPTH_M: f32 = 0.08;
/// Most points among which floor and ceiling are looked for.
const ASKED_MAX: usize = 8192;

/// A point in the LiDAR's frame, z up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CloudPoint {
    /// Position, m; not a number for no return.
    pub position_m: [f32; 3],
    /// Time of its measurement, s after the cloud's stamp.
    pub time_s: f32,
}

impl CloudPoint {
    fn range_m(&self) -> f32 {
        let [x, y, _] = self.position_m;
        x.hypot(y)
    }

    fn azimuth_rad(&self) -> f64 {
        let [x, y, _] = self.position_m;
        f64::from(y).atan2(f64::from(x))
    }
}

/// The points of one turn of a scanner.
#[derive(Debug, Clone)]
pub struct PointCloud {
    /// The cloud's stamp.
    pub stamp: RobotTime,
    /// Its points, in any order.
    pub points: Vec<CloudPoint>,
    /// Number of directions of an organised cloud.
    pub columns: Option<usize>,
}

impl PlanarBand {
    /// Scan of a planar scanner at the LiDAR's height. A cloud whose points have times becomes a
    /// rolling scan, one whose times are to be ignored a scan taken at once, and one without times
    /// a scan whose beam times are unknown.
    ///
    /// # Errors
    /// Names the field when the points' times are not those of a scanner that turns, or when the
    /// scan would be impossible.
    pub fn scan(&self, cloud: &PointCloud) -> Result<Scan, FieldRefused> {
        // 1. What is there, without floor and ceiling.
        let is_there = |point: &CloudPoint| {
            let [x, y, z] = point.position_m;
            let range_m = point.range_m();
            x.is_finite()
                && y.is_finite()
                && z.is_finite()
                && self.range_m().contains(&f64::from(range_m))
        };
        let points: Vec<CloudPoint> = cloud.points.iter().copied().filter(is_there).collect();
        let stride = points.len().div_ceil(ASKED_MAX).max(1);
        let some: Vec<CloudPoint> = points.iter().copied().step_by(stride).collect();
        let surfaces: Vec<HorizontalSurface> = [-1.0, 1.0]
            .into_iter()
            .filter_map(|side| HorizontalSurface::find(&some, side))
            .collect();

        // 2. Which beam looks where and when.
        let beams = self.beams().or(cloud.columns).unwrap_or(BEAMS_UNLESS_GIVEN);
        let turn = Turn::of(&points, beams.clamp(1, BEAMS_MAX), self.ignores_times())?;

        // 3. The nearest surface of each.
        let clearance_m = self.clearance_m() as f32;
        let is_taken = |point: &&CloudPoint| {
            let height_m = f64::from(point.position_m[2]);
            let is_flat = |surface: &HorizontalSurface| surface.distance_m(point) < clearance_m;
            self.height_m().contains(&height_m) && !surfaces.iter().any(is_flat)
        };
        let taken = points.iter().filter(is_taken);
        let returns = taken.filter_map(|point| Some((turn.beam_of(point)?, point.range_m())));
        let ranges_m = nearest_surfaces(turn.beams, &returns.collect::<Vec<_>>());

        let shape = ScanShape {
            angle_min_rad: turn.first_rad,
            angle_increment_rad: turn.increment_rad,
            time_increment_s: turn.time_increment_s,
            range_min_m: *self.range_m().start(),
            range_max_m: *self.range_m().end(),
        };
        let stamp = cloud.stamp.plus_seconds(turn.first_s);
        let scan = Scan::new(stamp, shape, ranges_m.into())?;
        let has_times = turn.time_increment_s > 0.0 || self.ignores_times();
        Ok(if has_times {
            scan
        } else {
            scan.without_beam_times()
        })
    }
}

/// The range of the nearest surface of each beam: the mean of the returns that lie just behind the
/// nearest, which alone would be too near by the noise of many.
fn nearest_surfaces(beams: usize, returns: &[(usize, f32)]) -> Vec<f32> {
    let mut nearest_m = vec![f32::INFINITY; beams];
    for &(beam, range_m) in returns {
        if let Some(nearest_m) = nearest_m.get_mut(beam) {
            *nearest_m = nearest_m.min(range_m);
        }
    }
    let mut sums = vec![(0.0_f32, 0.0_f32); beams];
    for &(beam, range_m) in returns {
        if let Some((nearest_m, (sum_m, count))) = nearest_m.get(beam).zip(sums.get_mut(beam))
            && range_m < nearest_m + SURFACE_DEPTH_M
        {
            *sum_m += range_m - nearest_m;
            *count += 1.0;
        }
    }
    for (nearest_m, (sum_m, count)) in nearest_m.iter_mut().zip(sums) {
        if count > 0.0 {
            *nearest_m += sum_m / count;
        }
    }
    nearest_m
}

#[cfg(test)]
mod tests;
