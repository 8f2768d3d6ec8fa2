//! One cell of the local map: the points that fell into it, and the line through them.

/// Points in one cell, as moments about the cell's centre. Old points fade as new ones come.
#[derive(Debug, Clone, Copy, Default)]
pub struct Moments {
    /// Number of points (weighted).
    pub n: f32,
    /// Sums of x, y, x², xy and y², m and m².
    pub sx: f32,
    /// Sum of y.
    pub sy: f32,
    /// Sum of x².
    pub sxx: f32,
    /// Sum of xy.
    pub sxy: f32,
    /// Sum of y².
    pub syy: f32,
    /// `n` when the line was fitted last.
    pub n_at_fit: f32,
    /// The map update that added the last point.
    pub last_update: u16,
    /// Number of map updates that added points, saturating.
    pub sightings: u16,
    /// Mean direction of the beams that saw the points, in parts of [`DIRECTION_ONE`].
    pub direction: [i16; 2],
}

/// A direction's unit: 16 bits are enough for a mean, and the map stays small.
const DIRECTION_ONE: f32 = 32_000.0;

/// Number of points in a cell beyond which the old ones fade.
pub const POINTS_IN_CELL_MAX: f32 = 400.0;

impl Moments {
    /// Adds a point given relative to the cell's centre, seen in a direction. Returns whether the
    /// line should be fitted again: the first time and each time the points have grown by a quarter.
    #[inline]
    pub fn add(
        &mut self,
        (x, y): (f32, f32),
        (dx, dy): (f32, f32),
        weight: f32,
        update: u16,
    ) -> bool {
        if self.n > POINTS_IN_CELL_MAX {
            self.fade(0.5);
        }
        self.n += weight;
        let share = weight / self.n;
        for (mean, new) in self.direction.iter_mut().zip([dx, dy]) {
            let before = f32::from(*mean);
            let now = before + (new * DIRECTION_ONE - before) * share;
            // To the nearest: `round` is a call where the processor may be any.
            *mean = (now + 0.5_f32.copysign(now)) as i16;
        }
        self.sx += weight * x;
        self.sy += weight * y;
        self.sxx += weight * x * x;
        self.sxy += weight * x * y;
        self.syy += weight * y * y;
        let is_new_sighting = self.last_update != update || self.sightings == 0;
        if is_new_sighting {
            self.last_update = update;
            self.sightings = self.sightings.saturating_add(1);
        }
        let grown = self.n > 1.25 * self.n_at_fit;
        if grown || (is_new_sighting && self.sightings <= 4) {
            self.n_at_fit = self.n;
            return true;
        }
        false
    }

    fn fade(&mut self, factor: f32) {
        self.n *= factor;
        self.sx *= factor;
        self.sy *= factor;
        self.sxx *= factor;
        self.sxy *= factor;
        self.syy *= factor;
        self.n_at_fit *= factor;
    }
}

/// Sums of the moments of cells, about the middle cell's centre.
#[derive(Debug, Clone, Copy, Default)]
pub struct WindowMoments {
    /// Sums of 1, x, y, x², xy and y², and of the beams' directions x and y.
    sums: [f32; 8],
    sightings: u16,
}

impl WindowMoments {
    /// The moments of a cell whose centre lies at (`ox`, `oy`) from the middle, m.
    #[inline]
    pub fn of(cell: &Moments, ox: f32, oy: f32) -> Self {
        let [dx, dy] = cell.direction.map(f32::from);
        Self {
            sums: [
                cell.n,
                cell.sx + cell.n * ox,
                cell.sy + cell.n * oy,
                cell.sxx + 2.0 * ox * cell.sx + cell.n * ox * ox,
                cell.sxy + ox * cell.sy + oy * cell.sx + cell.n * ox * oy,
                cell.syy + 2.0 * oy * cell.sy + cell.n * oy * oy,
                cell.n * dx * (1.0 / DIRECTION_ONE),
                cell.n * dy * (1.0 / DIRECTION_ONE),
            ],
            sightings: cell.sightings,
        }
    }

    /// Adds others.
    #[inline]
    pub fn add(&mut self, other: &Self) {
        for (sum, term) in self.sums.iter_mut().zip(other.sums) {
            *sum += term;
        }
        self.sightings = self.sightings.max(other.sightings);
    }

    /// Number of points.
    pub fn count(&self) -> f32 {
        self.sums[0]
    }

    /// The line through the points, or [`Line::NONE`] when they do not lie on one.
    pub fn line(&self, quality: &LineQuality) -> Line {
        self.fit(quality).map_or(Line::NONE, |fitted| fitted.line)
    }

    /// The line through the points, where they lie on one, and how they scatter about it.
    pub fn fit(&self, quality: &LineQuality) -> Option<Fitted> {
        let [n, sx, sy, sxx, sxy, syy, dx, dy] = self.sums;
        if n < quality.points_min {
            return None;
        }
        let inverse_n = n.recip();
        let (mx, my) = (sx * inverse_n, sy * inverse_n);
        let cxx = sxx * inverse_n - mx * mx;
        let cxy = sxy * inverse_n - mx * my;
        let cyy = syy * inverse_n - my * my;
        // Eigenvalues and the minor eigenvector of a symmetric 2×2 matrix.
        let half_trace = 0.5 * (cxx + cyy);
        let half_difference = 0.5 * (cxx - cyy);
        let radius = (half_difference * half_difference + cxy * cxy).sqrt();
        let along = half_trace + radius;
        let across = (half_trace - radius).max(0.0);
        if across > quality.across_max_m2
            || along < quality.along_min_m2
            || across > quality.ratio_max * along
        {
            return None;
        }
        let (ex, ey) = if half_difference >= 0.0 {
            (half_difference + radius, cxy)
        } else {
            (cxy, radius - half_difference)
        };
        let inverse_norm = (ex * ex + ey * ey).sqrt().recip();
        let (nx, ny) = (-ey * inverse_norm, ex * inverse_norm);
        let d = nx * mx + ny * my;
        // The line's own uncertainty at the cell: that of the mean, and of the direction.
        let off_centre = (mx * ex + my * ey) * inverse_norm;
        let spread = across.max(quality.noise_floor_m2);
        let variance = spread * inverse_n * (1.0 + off_centre * off_centre / along);
        let variance = if self.sightings < quality.sightings_min {
            variance + UNCONFIRMED_M2
        } else {
            variance
        };
        let line = Line {
            nx,
            ny,
            d,
            variance,
            cos: (nx * dx + ny * dy) * inverse_n,
        };
        Some(Fitted {
            line,
            across_m2: across,
            points: n,
        })
    }
}

/// A line, and the points that it was laid through.
#[derive(Debug, Clone, Copy)]
pub struct Fitted {
    /// The line.
    pub line: Line,
    /// Variance of the points across it, m².
    pub across_m2: f32,
    /// Number of points.
    points: f32,
}

impl Fitted {
    /// Variance across the line that its points' own may be taken for, m².
    pub fn across_at_most_m2(&self) -> f32 {
        self.across_m2 * (1.0 + ACROSS_SIGMAS * (2.0 / self.points).sqrt())
    }
}

/// Standard deviations by which a counted variance may differ from the true one.
const ACROSS_SIGMAS: f32 = 3.0;

/// Variance added to a line's until it was seen often enough, m²: (4 cm)².
const UNCONFIRMED_M2: f32 = 1.6e-3;

/// Conditions under which a window of points makes a line.
#[derive(Debug, Clone, Copy)]
pub struct LineQuality {
    /// Fewest points.
    pub points_min: f32,
    /// Most variance across the line, m².
    pub across_max_m2: f32,
    /// Least variance along the line, m².
    pub along_min_m2: f32,
    /// Largest ratio of the two.
    pub ratio_max: f32,
    /// Variance that range noise alone may give them, m²: with less, they are on one surface.
    pub noise_m2: f32,
    /// Least noise of the points that is assumed, m².
    pub noise_floor_m2: f32,
    /// Fewest map updates that must have seen it for it to count in full.
    pub sightings_min: u16,
}

/// The line through a cell: points with `nx·x + ny·y = d`, relative to the cell's centre.
#[derive(Debug, Clone, Copy)]
pub struct Line {
    /// Unit normal.
    pub nx: f32,
    /// Unit normal.
    pub ny: f32,
    /// Distance of the line from the cell's centre along the normal, m.
    pub d: f32,
    /// Variance of `d`, m²; negative where there is no line.
    pub variance: f32,
    /// Mean cosine of the incidence under which its points were seen, signed by the normal; 0 where
    /// no beam drew it.
    pub cos: f32,
}

impl Line {
    /// Absence of a line in a cell.
    pub const NONE: Self = Self {
        nx: 0.0,
        ny: 0.0,
        d: 0.0,
        variance: -1.0,
        cos: 0.0,
    };

    /// True if there is a line.
    pub fn exists(&self) -> bool {
        self.variance >= 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUALITY: LineQuality = LineQuality {
        points_min: 3.0,
        across_max_m2: 6e-4,
        along_min_m2: 1e-3,
        ratio_max: 0.2,
        noise_m2: 1e-4,
        noise_floor_m2: 1e-4,
        sightings_min: 1,
    };

    fn window_of(points: &[(f32, f32)]) -> WindowMoments {
        let mut cell = Moments::default();
        for &(x, y) in points {
            cell.add((x, y), (1.0, 0.0), 1.0, 1);
        }
        // Seen from a neighbour 0.1 m to the left.
        WindowMoments::of(&cell, 0.1, 0.0)
    }

    #[test]
    fn points_along_a_wall_give_its_line_about_the_window() {
        // The wall x·0.6 + y·0.8 = 0.02 about the cell, so 0.08 about the window.
        let points: Vec<_> = (-10..=10)
            .map(|i| 0.01 * i as f32)
            .map(|t| (0.6 * 0.02 - 0.8 * t, 0.8 * 0.02 + 0.6 * t))
            .collect();
        let line = window_of(&points).line(&QUALITY);
        let sign = line.nx.signum();
        assert!((sign * line.nx - 0.6).abs() < 1e-3 && (sign * line.ny - 0.8).abs() < 1e-3);
        assert!((sign * line.d - 0.08).abs() < 1e-3, "{line:?}");
        // 21 points of at least the noise floor, some way from their middle.
        assert!(
            line.variance > 1e-4 / 21.0 && line.variance < 3.0 * 1e-4 / 21.0,
            "{line:?}"
        );
    }

    #[test]
    fn a_corner_and_a_few_points_give_none() {
        let corner: Vec<_> = (0..10)
            .flat_map(|i| [(0.01 * i as f32, 0.0), (0.0, 0.01 * i as f32)])
            .collect();
        assert!(!window_of(&corner).line(&QUALITY).exists());
        assert!(
            !window_of(&[(0.0, 0.0), (0.09, 0.0)])
                .line(&QUALITY)
                .exists()
        );
    }

    #[test]
    fn a_line_is_fitted_again_as_its_points_grow() {
        let mut cell = Moments::default();
        let refits = (0..1000_u32)
            .filter(|&i| cell.add((0.0, 0.0), (1.0, 0.0), 1.0, (i / 100) as u16))
            .count();
        assert!((15..60).contains(&refits), "{refits}");
        assert!(cell.n <= POINTS_IN_CELL_MAX + 1.0);
        assert_eq!(cell.sightings, 10);
    }
}
