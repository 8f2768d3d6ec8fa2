//! The floor or the ceiling among the points of a cloud.
//!
//! Points of a horizontal surface share their height, whatever their range; those of a wall on one
//! ring of the scanner share it too, but in each direction they have one range only. So a surface is
//! the height that most points have, made sure of by directions in which it is seen at several
//! ranges. Its plane is then fitted wider and wider, so that it may tilt by some degrees.

use nalgebra::{Matrix3, Vector3};

use super::CloudPoint;

/// Step in which heights are counted, m.
const STEP_M: f32 = 0.05;
/// Largest height above or below the LiDAR that is counted, m.
const HEIGHT_MAX_M: f32 = 12.0;
/// Smallest height of a floor or a ceiling from the LiDAR's own, m.
const HEIGHT_MIN_M: f32 = 0.05;
/// Range within which heights are counted, where a tilt has not raised them much, m.
const NEAR_M: f32 = 6.0;
/// Ranges within which the plane is fitted, one after the other, m, to points this near to it, m.
const FITS: [(f32, f32); 4] = [(6.0, 0.15), (10.0, 0.12), (20.0, 0.1), (40.0, 0.08)];
/// Fewest points.
const POINTS_MIN: usize = 40;
/// Steepest slope either way.
const SLOPE_MAX: f64 = 0.15;
/// Sectors in which directions are counted.
const SECTORS: usize = 64;
/// Least distance between the ranges of points in a sector at several ranges, m.
const APART_M: f32 = 0.4;
/// Fewest sectors with points at several ranges.
const SECTORS_MIN: usize = 6;
/// The least part of all sectors in which the surface is seen.
const SECTORS_PART: f32 = 0.25;

/// A plane that is horizontal but for some degrees: z = `height` + `slope_x` x + `slope_y` y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HorizontalSurface {
    height_m: f32,
    slope_x: f32,
    slope_y: f32,
}

impl HorizontalSurface {
    /// The floor (`side` −1) or the ceiling (`side` +1), where one is seen.
    pub fn find(points: &[CloudPoint], side: f32) -> Option<Self> {
        let mut surface = Self {
            height_m: commonest_height_m(points, side)?,
            slope_x: 0.0,
            slope_y: 0.0,
        };
        for (range_m, near_m) in FITS {
            let is_on = |point: &&CloudPoint| {
                point.range_m() < range_m
                    && side * point.position_m[2] > HEIGHT_MIN_M
                    && surface.distance_m(point) < near_m
            };
            surface = Self::through(points.iter().filter(is_on))?;
        }
        surface.is_seen_along_beams(points).then_some(surface)
    }

    /// Distance of a point from the plane, m.
    pub fn distance_m(&self, point: &CloudPoint) -> f32 {
        let [x, y, z] = point.position_m;
        (z - self.height_m - self.slope_x * x - self.slope_y * y).abs()
    }

    /// The least-squares plane, where there are points enough and it is level enough.
    fn through<'a>(points: impl Iterator<Item = &'a CloudPoint>) -> Option<Self> {
        let mut count = 0;
        let (mut information, mut sum) = (Matrix3::zeros(), Vector3::zeros());
        for point in points {
            let [x, y, z] = point.position_m.map(f64::from);
            let row = Vector3::new(1.0, x, y);
            information += row * row.transpose();
            sum += row * z;
            count += 1;
        }
        if count < POINTS_MIN {
            return None;
        }
        let plane: Vector3<f64> = information.cholesky()?.solve(&sum);
        let is_level = plane.y.abs() < SLOPE_MAX && plane.z.abs() < SLOPE_MAX;
        is_level.then_some(Self {
            height_m: plane.x as f32,
            slope_x: plane.y as f32,
            slope_y: plane.z as f32,
        })
    }

    fn is_seen_along_beams(&self, points: &[CloudPoint]) -> bool {
        let (_, near_m) = FITS[FITS.len() - 1];
        let mut sectors = [None::<(f32, f32)>; SECTORS];
        for point in points {
            if self.distance_m(point) >= near_m {
                continue;
            }
            let turns = point.azimuth_rad() / std::f64::consts::TAU + 0.5;
            let sector = ((turns * SECTORS as f64) as usize).min(SECTORS - 1);
            let range_m = point.range_m();
            if let Some(spread) = sectors.get_mut(sector) {
                let (least, most) = spread.unwrap_or((range_m, range_m));
                *spread = Some((least.min(range_m), most.max(range_m)));
            }
        }
        let seen = sectors.iter().flatten();
        let several = seen.clone().filter(|(least, most)| most - least > APART_M);
        let (seen, several) = (seen.count(), several.count());
        several >= SECTORS_MIN && several as f32 >= SECTORS_PART * seen as f32
    }
}

/// The height that most of the near points on one side of the LiDAR have, m.
fn commonest_height_m(points: &[CloudPoint], side: f32) -> Option<f32> {
    let steps = (HEIGHT_MAX_M / STEP_M) as usize;
    let mut counts = vec![0_usize; steps + 1];
    for point in points {
        let height_m = side * point.position_m[2];
        if point.range_m() < NEAR_M
            && (HEIGHT_MIN_M..HEIGHT_MAX_M).contains(&height_m)
            && let Some(count) = counts.get_mut((height_m / STEP_M) as usize)
        {
            *count += 1;
        }
    }
    // Two steps together: a surface may lie between them.
    let pairs = counts.windows(2).map(|pair| pair.iter().sum::<usize>());
    let (step, count) = pairs.enumerate().max_by_key(|&(_, count)| count)?;
    (count >= POINTS_MIN).then_some(side * (step as f32 + 1.0) * STEP_M)
}
