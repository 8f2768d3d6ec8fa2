//! The coarse stage: a discrete search over x, y and yaw, scored on the occupied map.
//!
//! An even subsample of the scan is laid over the map at every pose of a grid bounded by how far
//! the LiDAR can have come; the score is the number of points on occupied cells. It runs where the
//! predicted pose does not fit: at a bad prediction, after missing scans, after a loss.
//!
//! The points of one yaw are scored at a whole row of shifts at once: of the map's picture, one bit a cell,
//! each point takes the bits beside it, and [`picture::Counts`] adds them up in columns.

mod picture;

use picture::Picture;

use super::beam_filter::ScanPoints;
use super::local_motion::LocalMotion;
use super::submap::{CELL_M, Cell, LocalOrigin, Submap};
use crate::geometry::Pose2;

/// Points of the subsample.
const POINTS_SCORED: usize = 128;
/// Candidates of the coarse grid that are refined,
pub const CANDIDATES: usize = 24;
/// and where a pose that fits is known.
pub const CANDIDATES_BESIDE: usize = 8;
/// Largest reach of a window, m, in which every pose is scored; in a wider one, poses at which a
/// quarter of the points fit badly are passed over.
const WIDE_M: f64 = 4.0;
/// Candidates that are held before the best are picked out.
const CANDIDATES_HELD_MAX: usize = 1 << 16;
/// Sigmas of a prediction within which the pose is looked for: its accelerations are generous already.
const SIGMAS: f64 = 2.0;
/// Candidates that are returned.
const BEST: usize = 4;
/// Step of the coarse grid, in cells of the map, and the reach of its widened map.
const COARSE_CELLS: i32 = 4;
const STEP: usize = COARSE_CELLS as usize;
/// Columns of shifts that are scored at once.
const COLUMNS: usize = 16 * STEP;
/// Step of the coarse grid in yaw, rad: 2.5°, half a step moves a point at 10 m by two cells.
const COARSE_YAW_RAD: f64 = 0.044;

/// Reach of the search on each side of the guess.
#[derive(Debug, Clone, Copy)]
pub struct Window {
    /// Reach in x and y, m.
    pub reach_m: f64,
    /// Reach in yaw, rad.
    pub yaw_rad: f64,
}

impl Window {
    /// The part of it that a prediction of these sigmas (position in m, yaw in rad) allows for.
    #[must_use]
    pub fn within(self, (position_m, yaw_rad): (f64, f64)) -> Self {
        Self {
            reach_m: self.reach_m.min(SIGMAS * position_m),
            yaw_rad: self.yaw_rad.min(SIGMAS * yaw_rad),
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Candidate {
    score: u32,
    yaw_step: i32,
    shift: Cell,
}

impl Candidate {
    /// The better first; of equals the one nearer to the guess, and of those always the same one.
    fn rank(&self) -> impl Ord + use<> {
        let Cell { x, y } = self.shift;
        (
            std::cmp::Reverse(self.score),
            x.abs() + y.abs() + 2 * self.yaw_step.abs(),
            (self.yaw_step, y, x),
        )
    }
}

/// A subsample of a scan, laid over the map at one yaw after the other.
struct Overlay {
    origin: LocalOrigin,
    /// The cell of the guess.
    centre: Cell,
    points: Vec<(f32, f32)>,
    cells: Vec<Cell>,
}

impl Overlay {
    fn new(points: &ScanPoints, deskew: &LocalMotion, guess: Pose2) -> Self {
        let origin = LocalOrigin::near(guess.x_m, guess.y_m);
        let (ox, oy) = origin.position_m();
        let stride = points.len().div_ceil(POINTS_SCORED).max(1);
        // Every fourth point first: any first part is spread over the scan.
        let points = (0..4).flat_map(|phase| {
            let part = points.iter().skip(phase * stride).step_by(4 * stride);
            part.map(|point| deskew.deskew(point.x, point.y, point.tau_s))
        });
        Self {
            origin,
            centre: origin
                .locate((guess.x_m - ox) as f32, (guess.y_m - oy) as f32)
                .0,
            points: points.collect(),
            cells: Vec::with_capacity(POINTS_SCORED + 1),
        }
    }

    /// The cells of the points at a pose.
    fn cells_at(&mut self, pose: Pose2) -> &[Cell] {
        let (s, c) = pose.yaw_rad.sin_cos();
        let (s, c) = (s as f32, c as f32);
        let (ox, oy) = self.origin.position_m();
        let (px, py) = ((pose.x_m - ox) as f32, (pose.y_m - oy) as f32);
        self.cells.clear();
        for &(x, y) in &self.points {
            self.cells
                .push(self.origin.locate(c * x - s * y + px, s * x + c * y + py).0);
        }
        &self.cells
    }
}

/// The best poses within `window` of `guess` (whose points are deskewed by `deskew`), best first, of so many
/// `candidates`.
pub fn search(
    points: &ScanPoints,
    submap: &Submap,
    guess: Pose2,
    deskew: &LocalMotion,
    window: Window,
    candidates: usize,
) -> Vec<Pose2> {
    let mut overlay = Overlay::new(points, deskew, guess);
    let fine = Picture::of(submap, overlay.centre);
    let coarse = fine.widened((COARSE_CELLS / 2) as usize);

    // 1. Every pose of the coarse grid, on the widened map.
    let mut found = Vec::new();
    let yaw_steps = (window.yaw_rad / COARSE_YAW_RAD).ceil() as i32;
    let reach = (window.reach_m / CELL_M / f64::from(COARSE_CELLS)).ceil() as i32 * COARSE_CELLS;
    let is_wide = window.reach_m > WIDE_M;
    for yaw_step in -yaw_steps..=yaw_steps {
        let yaw_rad = guess.yaw_rad + f64::from(yaw_step) * COARSE_YAW_RAD;
        let cells = overlay.cells_at(Pose2 { yaw_rad, ..guess });
        let (first, rest) = cells.split_at(cells.len() / 4);
        let columns = (-reach..=reach).step_by(COLUMNS);
        for (x, y) in columns.flat_map(|x| (-reach..=reach).step_by(STEP).map(move |y| (x, y))) {
            let shift = Cell { x, y };
            let of_first = coarse.counts(first, shift);
            let passes = |column: &usize| {
                x + *column as i32 <= reach
                    && (!is_wide || 2 * of_first.of(*column) >= first.len() as u32)
            };
            let columns = (0..COLUMNS).step_by(STEP).filter(passes);
            if columns.clone().next().is_none() {
                continue;
            }
            let of_rest = coarse.counts(rest, shift);
            found.extend(columns.map(|column| Candidate {
                score: of_first.of(column) + of_rest.of(column),
                yaw_step,
                shift: Cell {
                    x: x + column as i32,
                    y,
                },
            }));
        }
        if found.len() > CANDIDATES_HELD_MAX {
            keep_best(&mut found, candidates);
        }
    }
    keep_best(&mut found, candidates);

    // 2. The best of them closely, on the map as it is.
    let mut close: Vec<_> = found
        .iter()
        .filter_map(|candidate| refine(&fine, candidate, guess, &mut overlay))
        .collect();
    close.sort_by_key(|(score, _, _)| std::cmp::Reverse(*score));
    close.dedup_by_key(|(_, yaw, shift)| ((*yaw * 1e6) as i64, shift.x, shift.y));
    close
        .into_iter()
        .take(BEST)
        .map(|(_, yaw_rad, shift)| {
            let (x_m, y_m) = (f64::from(shift.x) * CELL_M, f64::from(shift.y) * CELL_M);
            Pose2::new(guess.x_m + x_m, guess.y_m + y_m, yaw_rad)
        })
        .collect()
}

fn keep_best(candidates: &mut Vec<Candidate>, count: usize) {
    if candidates.len() > count {
        candidates.select_nth_unstable_by_key(count, Candidate::rank);
        candidates.truncate(count);
    }
    candidates.sort_unstable_by_key(Candidate::rank);
}

/// The best pose around a candidate of the coarse grid: score, yaw and shift.
fn refine(
    fine: &Picture,
    candidate: &Candidate,
    guess: Pose2,
    overlay: &mut Overlay,
) -> Option<(u32, f64, Cell)> {
    let half = COARSE_CELLS / 2;
    let mut best: Option<(u32, f64, Cell)> = None;
    for quarter in -2..=2 {
        let yaw_rad = guess.yaw_rad
            + (f64::from(candidate.yaw_step) + 0.25 * f64::from(quarter)) * COARSE_YAW_RAD;
        let cells = overlay.cells_at(Pose2 { yaw_rad, ..guess });
        for y in -half..=half {
            let first = Cell {
                x: candidate.shift.x - half,
                y: candidate.shift.y + y,
            };
            let counts = fine.counts(cells, first);
            for column in 0..=STEP {
                let score = counts.of(column);
                let shift = Cell {
                    x: first.x + column as i32,
                    ..first
                };
                if best.is_none_or(|(highest, _, _)| score > highest) {
                    best = Some((score, yaw_rad, shift));
                }
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RobotTime;
    use crate::lidar_odometry::beam_filter::BeamFilter;
    use crate::lidar_odometry::local_map::LocalMap;
    use crate::lidar_odometry::motion::Motion;
    use crate::scan::{Scan, ScanShape};

    /// A scan from the middle of a room of 9 m by 6 m with a pillar in a corner.
    fn room() -> ScanPoints {
        let ranges: Vec<f32> = (0..720)
            .map(|beam| {
                let (s, c) = (f64::from(beam) * std::f64::consts::TAU / 720.0).sin_cos();
                let x = if c > 0.0 { 5.0 / c } else { -4.0 / c };
                let y = if s > 0.0 { 3.5 / s } else { -2.5 / s };
                let pillar = if s > 0.1 && c > 0.5 {
                    2.6 / c.max(s)
                } else {
                    99.0
                };
                x.min(y).min(pillar) as f32
            })
            .collect();
        let shape = ScanShape {
            angle_min_rad: 0.0,
            angle_increment_rad: std::f64::consts::TAU / 720.0,
            time_increment_s: 0.0,
            range_min_m: 0.1,
            range_max_m: 30.0,
        };
        let scan = Scan::new(RobotTime(1), shape, ranges.into()).unwrap();
        let mut points = ScanPoints::default();
        BeamFilter::default().filter(&scan, scan.shape().time_increment_s, None, &mut points);
        points
    }

    #[test]
    fn a_pose_a_metre_and_forty_degrees_away_is_found() {
        let points = room();
        let mut map = LocalMap::default();
        map.update(
            &points,
            &Motion::starting_at(Pose2::IDENTITY),
            RobotTime(1),
            0.01,
        );
        let deskew = LocalMotion::new(
            &Motion::starting_at(Pose2::IDENTITY),
            LocalOrigin::near(0.0, 0.0),
        );
        for (x, y, yaw) in [(1.0, 0.1, 0.7), (-0.7, 0.7, -0.7), (0.0, -1.2, 0.3)] {
            let guess = Pose2::new(x, y, yaw);
            let window = Window {
                reach_m: 1.6,
                yaw_rad: 1.05,
            };
            let best = search(&points, &map.submap, guess, &deskew, window, CANDIDATES)[0];
            let off = best.translation().norm();
            assert!(
                off < 0.15 && best.yaw_rad.abs() < 0.04,
                "{best:?} from {guess:?}"
            );
        }
    }
}
