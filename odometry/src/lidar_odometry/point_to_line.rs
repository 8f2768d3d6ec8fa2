//! Point-to-line alignment of a scan with the local map, pose and velocity at once.
//!
//! A beam taken `tau` seconds from the reference time at the point `p` (LiDAR's frame) lies, for
//! the pose `T` and the velocity `v` there, at `T * exp(tau v) * p`. Its residual is the distance
//! to the line of the cell it falls into; `exp(tau v)` is the correction of the rolling scan, so
//! each iteration corrects the scan again with the motion just found.
//! With the normal `m` seen from the LiDAR and `q = exp(tau v) p` the derivative is
//! `j = (m, m_y q_x - m_x q_y)` for the pose and `tau j` for the velocity.

use nalgebra::{Matrix3, Matrix6, Vector2, Vector6};

use super::beam_filter::{Block, LANES, ScanPoints};
use super::fit::Fit;
use super::local_motion::LocalMotion;
use super::normal_equations::NormalEquations;
use super::range_errors::RangeErrors;
use super::submap::{Cell, FreeSpace, Submap};

/// Sigmas beyond which a residual loses its weight (Geman-McClure).
const ROBUST_SIGMAS: f32 = 3.0;
/// Least standard deviation of a residual, m: the map is no better than this.
const RESIDUAL_FLOOR_M: f32 = 0.002;
/// Sigmas within which a point lies on the map.
const ON_MAP_SIGMAS: f32 = 4.0;

/// Least cosine between a direction and the normal of a surface that faces it (75°).
const FACING_COS: f32 = 0.26;

/// Sums over points, in the order xx, xy, xt, yy, yt, tt of the pose's information.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    pose: [f32; 6],
    pose_velocity: [f32; 6],
    velocity: [f32; 6],
    gradient_pose: [f32; 3],
    gradient_velocity: [f32; 3],
    on_map: f32,
    chi2: f32,
}

/// Terms of the normal equations: information xx, xy, xt, yy, yt, tt, gradient x, y, t, points on
/// the map, and their squared normalised residuals.
const TERMS: usize = 11;

/// The terms of a block, one lane a point.
struct Terms {
    sums: [[f32; LANES]; TERMS],
}

/// The lines that a block's points are matched with, one lane a point; kept from pass to pass, since most
/// points stay in their cells.
#[derive(Clone)]
pub struct Matches {
    cells: [Cell; LANES],
    nx: [f32; LANES],
    ny: [f32; LANES],
    d: [f32; LANES],
    /// Negative where there is no line.
    variance: [f32; LANES],
    cos: [f32; LANES],
    /// Squared residuals over their variances; infinite where the map has no line.
    squares: [f32; LANES],
}

impl Matches {
    /// Matches before the first pass.
    pub const NONE: Self = Self {
        cells: [Cell::NOWHERE; LANES],
        nx: [0.0; LANES],
        ny: [0.0; LANES],
        d: [0.0; LANES],
        variance: [-1.0; LANES],
        cos: [0.0; LANES],
        squares: [f32::INFINITY; LANES],
    };

    /// Reads the lines of the points that have come into another cell.
    fn read(&mut self, submap: &Submap, cells: &[Cell; LANES], count: usize) {
        let lanes = self.cells.iter_mut().zip(cells).enumerate();
        for (i, (before, &cell)) in lanes.take(count) {
            if *before != cell {
                let line = submap.line(cell);
                *before = cell;
                (self.nx[i], self.ny[i], self.d[i]) = (line.nx, line.ny, line.d);
                (self.variance[i], self.cos[i]) = (line.variance, line.cos);
            }
        }
    }
}

/// A block of points laid over the map, one lane a point.
pub struct Laid {
    /// The deskewed points in the LiDAR's frame.
    qx: [f32; LANES],
    qy: [f32; LANES],
    /// Normals of the lines.
    nx: [f32; LANES],
    ny: [f32; LANES],
    /// Distances from the lines, m, and the lines' variances, m².
    distance: [f32; LANES],
    variance: [f32; LANES],
    /// Cosines of the incidence that the lines were seen under, signed by their normals.
    pub cos: [f32; LANES],
    /// 1 where there is a line, else 0.
    matched: [f32; LANES],
}

/// A point of a block against its line.
pub struct Seen {
    /// Derivative of the residual by x of the pose.
    pub jx: f32,
    /// Derivative by y.
    pub jy: f32,
    /// Derivative by yaw.
    pub jt: f32,
    /// Cosine of the incidence, signed by the line's normal.
    pub cos: f32,
    /// The residual, m.
    pub distance: f32,
    /// The residual over its standard deviation, squared.
    normalised2: f32,
    /// One over the residual's variance, 1/m²; 0 where there is no line.
    information: f32,
    /// Weight of the residual, 1/m².
    pub weight: f32,
}

/// The points of a scan laid over the map: the one place where residuals come from.
#[derive(Clone, Copy)]
pub struct Alignment<'a> {
    /// The scan.
    pub points: &'a ScanPoints,
    /// The map.
    pub submap: &'a Submap,
    /// The scanner's range noise, m.
    pub range_noise_m: f32,
    /// The scanner's range errors.
    pub range_errors: RangeErrors,
}

impl Alignment<'_> {
    /// No matches yet, for each block of points.
    pub fn unmatched(&self) -> Vec<Matches> {
        vec![Matches::NONE; self.points.blocks().len()]
    }

    /// One pass over every `stride`-th block of points: residuals, weights and normal equations. Notes the
    /// matches of these blocks.
    pub fn linearise(
        &self,
        motion: &LocalMotion,
        stride: usize,
        matches: &mut [Matches],
    ) -> NormalEquations {
        let mut sums = Sums::default();
        let blocks = self.points.blocks().iter().zip(matches);
        for (block, matches) in blocks.step_by(stride) {
            let laid = self.lay(motion, block, matches);
            let terms = self.weigh(motion, block, &laid, &mut matches.squares);
            sums.add(&terms, block.mean_tau_s());
        }
        sums.into_equations()
    }

    /// Lays a block over the map: deskews, transforms, and compares each point with its cell's line.
    pub fn lay(&self, motion: &LocalMotion, block: &Block, matches: &mut Matches) -> Laid {
        // 1. The points' cells, and the points about the cells' centres.
        let placed = motion.place(block);
        let mut cells = [Cell::NOWHERE; LANES];
        let (mut cx, mut cy) = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            (cells[i], cx[i], cy[i]) = motion.origin.locate(placed.wx[i], placed.wy[i]);
        }
        // 2. The cells' lines.
        matches.read(self.submap, &cells, block.count());
        // 3. The distances n · c - d.
        let mut laid = Laid {
            qx: placed.qx,
            qy: placed.qy,
            nx: matches.nx,
            ny: matches.ny,
            distance: [0.0; LANES],
            variance: [0.0; LANES],
            cos: matches.cos,
            matched: [0.0; LANES],
        };
        for i in 0..LANES {
            laid.distance[i] = matches.nx[i] * cx[i] + matches.ny[i] * cy[i] - matches.d[i];
            laid.variance[i] = matches.variance[i].max(0.0);
            laid.matched[i] = if matches.variance[i] >= 0.0 { 1.0 } else { 0.0 };
        }
        laid
    }

    /// The terms of the normal equations of a block, lane by lane.
    fn weigh(
        &self,
        motion: &LocalMotion,
        block: &Block,
        laid: &Laid,
        squares: &mut [f32; LANES],
    ) -> Terms {
        let mut terms = Terms {
            sums: [[0.0; LANES]; TERMS],
        };
        for (i, square) in squares.iter_mut().enumerate() {
            let Seen {
                jx,
                jy,
                jt,
                distance,
                normalised2,
                weight,
                ..
            } = self.seen(motion, block, laid, i);
            let is_on_map = normalised2 < ON_MAP_SIGMAS * ON_MAP_SIGMAS;
            let on_map = if is_on_map { laid.matched[i] } else { 0.0 };
            *square = if laid.matched[i] > 0.0 {
                normalised2
            } else {
                f32::INFINITY
            };
            let pull = -weight * distance;
            let (wx, wy, wt) = (weight * jx, weight * jy, weight * jt);
            terms.sums[0][i] = wx * jx;
            terms.sums[1][i] = wx * jy;
            terms.sums[2][i] = wx * jt;
            terms.sums[3][i] = wy * jy;
            terms.sums[4][i] = wy * jt;
            terms.sums[5][i] = wt * jt;
            terms.sums[6][i] = pull * jx;
            terms.sums[7][i] = pull * jy;
            terms.sums[8][i] = pull * jt;
            terms.sums[9][i] = on_map;
            terms.sums[10][i] = on_map * normalised2;
        }
        terms
    }

    /// Compares a point with its line: derivatives, residual and robust weight (Geman-McClure). The
    /// errors of the scanner's ranges are subtracted from the point and from the line alike.
    #[inline]
    pub fn seen(&self, motion: &LocalMotion, block: &Block, laid: &Laid, i: usize) -> Seen {
        let (qx, qy) = (laid.qx[i], laid.qy[i]);
        let jx = motion.cos * laid.nx[i] + motion.sin * laid.ny[i];
        let jy = motion.cos * laid.ny[i] - motion.sin * laid.nx[i];
        let cos = (jx * qx + jy * qy) * block.inverse_range[i];
        let errors = self.range_errors;
        let distance = laid.distance[i] - (errors.across_m(cos) - errors.across_m(laid.cos[i]));
        let noise = cos * self.range_noise_m;
        let variance = noise * noise + laid.variance[i] + RESIDUAL_FLOOR_M * RESIDUAL_FLOOR_M;
        let information = laid.matched[i] / variance;
        let normalised2 = distance * distance * information;
        let robust = 1.0 / (1.0 + normalised2 * (1.0 / (ROBUST_SIGMAS * ROBUST_SIGMAS)));
        Seen {
            jx,
            jy,
            jt: jy * qx - jx * qy,
            cos,
            distance,
            normalised2,
            information,
            weight: robust * robust * information,
        }
    }

    /// The information of the surfaces that face `direction` (LiDAR's frame) on the position along
    /// it: the others show it only through the noise of their normals.
    pub fn information_facing(
        &self,
        motion: &LocalMotion,
        direction: Vector2<f64>,
        matches: &mut [Matches],
    ) -> f64 {
        let (ex, ey) = (direction.x as f32, direction.y as f32);
        let mut sum = 0.0;
        for (block, matches) in self.points.blocks().iter().zip(matches) {
            let laid = self.lay(motion, block, matches);
            for i in 0..LANES {
                let seen = self.seen(motion, block, &laid, i);
                let facing = seen.jx * ex + seen.jy * ey;
                if facing.abs() > FACING_COS {
                    sum += facing * facing * seen.information;
                }
            }
        }
        f64::from(sum)
    }

    /// Sorts every `stride`-th point by its squared residual: on the map, where space was seen free, or
    /// neither; and where a map was known before, whether it agrees.
    pub fn assess(
        &self,
        motion: &LocalMotion,
        free_space: &FreeSpace,
        matches: &[Matches],
        stride: usize,
    ) -> Fit {
        let mut fit = Fit::default();
        for (number, (block, matches)) in self.points.blocks().iter().zip(matches).enumerate() {
            let squares = &matches.squares;
            let before = number * LANES;
            let first = before.next_multiple_of(stride) - before;
            for i in (first..block.count().min(LANES)).step_by(stride) {
                let cell = || {
                    let (qx, qy) = motion.deskew(block.x[i], block.y[i], block.tau_s[i]);
                    let (wx, wy) = motion.transform(qx, qy);
                    motion.origin.locate(wx, wy).0
                };
                fit.points += 1.0;
                let is_on_map = squares[i] < ON_MAP_SIGMAS * ON_MAP_SIGMAS;
                let score = 1.0 / (1.0 + squares[i] * (1.0 / (ROBUST_SIGMAS * ROBUST_SIGMAS)));
                fit.score += score;
                if is_on_map {
                    fit.on_map += 1.0;
                } else if free_space.was_free(cell()) {
                    fit.moving += 1.0;
                    fit.score_of_moving += score;
                }
                if let Some(known) = self.submap.known() {
                    let cell = cell();
                    if known.line(cell).exists() && is_on_map {
                        fit.agrees += 1.0;
                    } else if known.is_free(cell) || known.line(cell).exists() {
                        fit.disagrees += 1.0;
                    }
                }
            }
        }
        fit
    }
}

impl Sums {
    /// Adds a block's terms. Its beams are 3 % of the scan, so that their mean time stands for all.
    fn add(&mut self, terms: &Terms, tau: f32) {
        let mut total = [0.0; TERMS];
        for (sum, lanes) in total.iter_mut().zip(&terms.sums) {
            *sum = sum_of_lanes(lanes);
        }
        let [xx, xy, xt, yy, yt, tt, gx, gy, gt, on_map, chi2] = total;
        for (index, term) in [xx, xy, xt, yy, yt, tt].into_iter().enumerate() {
            self.pose[index] += term;
            self.pose_velocity[index] += tau * term;
            self.velocity[index] += tau * tau * term;
        }
        for (index, term) in [gx, gy, gt].into_iter().enumerate() {
            self.gradient_pose[index] += term;
            self.gradient_velocity[index] += tau * term;
        }
        self.on_map += on_map;
        self.chi2 += chi2;
    }

    fn into_equations(self) -> NormalEquations {
        let block = |s: [f32; 6]| {
            let [xx, xy, xt, yy, yt, tt] = s.map(f64::from);
            Matrix3::new(xx, xy, xt, xy, yy, yt, xt, yt, tt)
        };
        let (pose, both) = (block(self.pose), block(self.pose_velocity));
        let mut information = Matrix6::zeros();
        information.fixed_view_mut::<3, 3>(0, 0).copy_from(&pose);
        information.fixed_view_mut::<3, 3>(0, 3).copy_from(&both);
        information.fixed_view_mut::<3, 3>(3, 0).copy_from(&both);
        information
            .fixed_view_mut::<3, 3>(3, 3)
            .copy_from(&block(self.velocity));
        let [px, py, pt] = self.gradient_pose.map(f64::from);
        let [vx, vy, vt] = self.gradient_velocity.map(f64::from);
        let gradient = Vector6::new(px, py, pt, vx, vy, vt);
        NormalEquations {
            information,
            gradient,
            on_map: self.on_map,
            chi2: self.chi2,
        }
    }
}

pub fn sum_of_lanes(lanes: &[f32; LANES]) -> f32 {
    let mut four = [0.0; 4];
    for part in lanes.chunks_exact(4) {
        for (sum, lane) in four.iter_mut().zip(part) {
            *sum += lane;
        }
    }
    four.iter().sum()
}
