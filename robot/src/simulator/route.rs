//! Routes: dense polylines that a robot follows.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::plane::{Point, Pose2, wrap_angle_rad};

/// Distance between the points of a route, m.
const SPACING_M: f64 = 0.05;
/// Distance back from the last place within which the nearest one is searched, m.
const BACK_M: f64 = 0.5;
/// Distance ahead of the last place within which the nearest one is searched, m.
const AHEAD_M: f64 = 1.5;
/// Length over which the curvature is computed, m.
const CURVATURE_SPAN_M: f64 = 0.3;

/// A route along the floor.
#[derive(Debug, Clone, PartialEq)]
pub struct Route {
    points: Vec<Point>,
    closed: bool,
    length_m: f64,
    reversals: Vec<Reversal>,
}

/// A stretch that a robot drives backwards on its way: it stops, backs up and goes on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reversal {
    /// Distance of the stop from the start of the route, m.
    pub at_m: f64,
    /// Length of the stretch, m.
    pub length_m: f64,
}

/// The place on a route that is nearest to a robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    /// Way along the route, m.
    pub along_m: f64,
    /// Distance to the left of it, m.
    pub left_m: f64,
}

impl Route {
    /// Makes a route through points, evenly spaced again. Consecutive equal points are left out.
    pub fn from_points(points: &[Point], closed: bool) -> Self {
        let mut corners = points.to_vec();
        if closed {
            corners.extend(points.first());
        }
        let mut even: Vec<Point> = corners.first().copied().into_iter().collect();
        let mut until_next_m = SPACING_M;
        for (from, to) in corners.iter().zip(corners.iter().skip(1)) {
            let edge_m = from.distance_m(*to);
            let mut along_m = until_next_m;
            while along_m <= edge_m {
                even.push(from.toward(*to, along_m / edge_m));
                along_m += SPACING_M;
            }
            until_next_m = along_m - edge_m;
        }
        // A closing gap shorter than half a spacing would make a kink.
        if closed && even.len() > 2 && until_next_m > 0.5 * SPACING_M {
            even.pop();
        }
        let edges = even.len().saturating_sub(usize::from(!closed));
        Self {
            length_m: edges as f64 * SPACING_M,
            points: even,
            closed,
            reversals: Vec::new(),
        }
    }

    /// Adds stretches that are driven backwards, in their order along the route; on a closed route
    /// in every lap.
    #[must_use]
    pub fn with_reversals(mut self, reversals: &[Reversal]) -> Self {
        self.reversals = reversals.to_vec();
        self
    }

    /// Returns the reversal of this number, counted from 0 over all laps.
    pub(super) fn reversal(&self, number: usize) -> Option<Reversal> {
        let each_lap = self.reversals.len();
        let lap = number.checked_div(each_lap)?;
        if lap > 0 && !self.closed {
            return None;
        }
        let reversal = *self.reversals.get(number % each_lap)?;
        Some(Reversal {
            at_m: reversal.at_m + lap as f64 * self.length_m,
            ..reversal
        })
    }

    /// Makes a figure-eight (Gerono's lemniscate): both turns, the crossing straight. It starts at
    /// the crossing. `half_length_m` along x, `half_width_m` along y.
    pub fn figure_eight(centre: Point, half_length_m: f64, half_width_m: f64) -> Self {
        let point = |turn: f64| {
            Point::new(
                centre.x_m + half_length_m * (TAU * turn).sin(),
                centre.y_m + half_width_m * (2.0 * TAU * turn).sin(),
            )
        };
        Self::curve(point, true)
    }

    /// Makes the figure-eight in the staging area of the warehouse.
    pub fn staging_figure_eight() -> Self {
        Self::figure_eight(Point::new(-11.0, 0.0), 5.5, 1.8)
    }

    /// Makes a loop through the warehouse's aisles with left and right turns, a minute long at 1
    /// m/s.
    pub fn aisle_loop() -> Self {
        let corners = [
            (-1.5, -2.0),
            (9.4, -2.0),
            (9.4, 2.0),
            (17.3, 2.0),
            (17.3, 6.0),
            (-1.5, 6.0),
        ];
        Self::through(&corners.map(|(x_m, y_m)| Point::new(x_m, y_m)), 1.5, true)
    }

    /// Makes the same loop with two stretches of each lap driven backwards.
    pub fn aisles_with_reversals() -> Self {
        let reversal = |at_m, length_m| Reversal { at_m, length_m };
        Self::aisle_loop().with_reversals(&[reversal(6.0, 2.5), reversal(33.0, 3.0)])
    }

    /// Makes one circle, left about.
    pub fn circle(centre: Point, radius_m: f64) -> Self {
        let point = |turn: f64| {
            let (sin, cos) = (TAU * turn - FRAC_PI_2).sin_cos();
            Point::new(centre.x_m + radius_m * cos, centre.y_m + radius_m * sin)
        };
        Self::curve(point, true)
    }

    /// Makes a rectangle with round corners driven left about: straights and left turns, no right
    /// ones.
    pub fn left_loop(centre: Point, length_m: f64, width_m: f64) -> Self {
        let (x_m, y_m) = (0.5 * length_m, 0.5 * width_m);
        let corners = [(-x_m, -y_m), (x_m, -y_m), (x_m, y_m), (-x_m, y_m)];
        let corners = corners.map(|(dx, dy)| Point::new(centre.x_m + dx, centre.y_m + dy));
        Self::through(&corners, 0.4 * width_m.min(length_m), true)
    }

    /// Makes a straight line.
    pub fn straight(from: Point, to: Point) -> Self {
        Self::from_points(&[from, to], false)
    }

    /// Makes a sine along x around a straight line.
    pub fn slalom(from: Point, length_m: f64, amplitude_m: f64, wave_length_m: f64) -> Self {
        let point = |part: f64| {
            let x_m = part * length_m;
            let y_m = amplitude_m * (TAU * x_m / wave_length_m).sin();
            Point::new(from.x_m + x_m, from.y_m + y_m)
        };
        Self::curve(point, false)
    }

    /// Makes straight lines between corners, which are rounded with `radius_m`.
    pub fn through(corners: &[Point], radius_m: f64, closed: bool) -> Self {
        let mut points = Vec::new();
        for (number, corner) in corners.iter().enumerate() {
            let end = !closed && (number == 0 || number + 1 == corners.len());
            let before = corners.get((number + corners.len() - 1) % corners.len());
            let after = corners.get((number + 1) % corners.len());
            match (before, after) {
                (Some(before), Some(after)) if !end => {
                    round_corner(&mut points, *before, *corner, *after, radius_m);
                }
                _ => points.push(*corner),
            }
        }
        // The route starts on a straight, where its first arc ends.
        if closed {
            let arc = points.len() / corners.len().max(1);
            let first = arc.saturating_sub(1).min(points.len());
            points.rotate_left(first);
        }
        Self::from_points(&points, closed)
    }

    fn curve(point: impl Fn(f64) -> Point, closed: bool) -> Self {
        let count = 20_000;
        let last = if closed { count } else { count + 1 };
        let points: Vec<_> = (0..last)
            .map(|n| point(f64::from(n) / f64::from(count)))
            .collect();
        Self::from_points(&points, closed)
    }

    /// Returns its length, m.
    pub fn length_m(&self) -> f64 {
        self.length_m
    }

    /// True if it ends at its start.
    pub fn is_closed(&self) -> bool {
        self.closed
    }

    /// Returns a robot's initial pose: on the first point, looking along the route.
    pub fn start(&self) -> Pose2 {
        let start = self.point_at(0.0);
        Pose2::new(start.x_m, start.y_m, self.heading_at(0.0))
    }

    /// Returns the point `along_m` from the start; closed routes repeat, open ones continue
    /// straight.
    pub fn point_at(&self, along_m: f64) -> Point {
        let place = along_m / SPACING_M;
        let before = place.floor();
        let fraction = place - before;
        let (Some(from), Some(to)) = (self.point(before as i64), self.point(before as i64 + 1))
        else {
            return Point::default();
        };
        from.toward(to, fraction)
    }

    fn point(&self, number: i64) -> Option<Point> {
        let count = self.points.len() as i64;
        if self.closed && count > 0 {
            return self.points.get(number.rem_euclid(count) as usize).copied();
        }
        let inside = number.clamp(0, (count - 2).max(0));
        let from = self.points.get(inside as usize)?;
        let to = self.points.get(inside as usize + 1)?;
        Some(from.toward(*to, (number - inside) as f64))
    }

    /// Returns the heading of the route at a place, rad.
    pub(super) fn heading_at(&self, along_m: f64) -> f64 {
        let half_m = 0.5 * SPACING_M;
        let (from, to) = (
            self.point_at(along_m - half_m),
            self.point_at(along_m + half_m),
        );
        (to.y_m - from.y_m).atan2(to.x_m - from.x_m)
    }

    /// Returns the curvature around a place, 1/m, left positive.
    pub(super) fn curvature_at(&self, along_m: f64) -> f64 {
        let before_rad = self.heading_at(along_m - 0.5 * CURVATURE_SPAN_M);
        let after_rad = self.heading_at(along_m + 0.5 * CURVATURE_SPAN_M);
        wrap_angle_rad(after_rad - before_rad) / CURVATURE_SPAN_M
    }

    /// Returns the place nearest to a point, near the last one: where the route crosses itself the
    /// robot stays on its branch.
    pub(super) fn nearest(&self, point: Point, last_along_m: f64) -> Place {
        let first = ((last_along_m - BACK_M) / SPACING_M).floor() as i64;
        let count = ((BACK_M + AHEAD_M) / SPACING_M) as i64;
        let distance = |number: &i64| {
            self.point(*number)
                .map_or(f64::INFINITY, |candidate| candidate.distance_m(point))
        };
        let nearest = (first..first + count)
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
            .unwrap_or(first);
        let (Some(before), Some(after)) = (self.point(nearest - 1), self.point(nearest + 1)) else {
            return Place {
                along_m: last_along_m,
                left_m: 0.0,
            };
        };
        let heading_rad = (after.y_m - before.y_m).atan2(after.x_m - before.x_m);
        let on_route = self.point(nearest).unwrap_or_default();
        let (sin, cos) = heading_rad.sin_cos();
        let (dx, dy) = (point.x_m - on_route.x_m, point.y_m - on_route.y_m);
        Place {
            along_m: nearest as f64 * SPACING_M + cos * dx + sin * dy,
            left_m: cos * dy - sin * dx,
        }
    }
}

/// Adds the arc that rounds one corner.
fn round_corner(points: &mut Vec<Point>, before: Point, at: Point, after: Point, radius_m: f64) {
    const STEPS: i32 = 64;
    let heading = |from: Point, to: Point| (to.y_m - from.y_m).atan2(to.x_m - from.x_m);
    let in_rad = heading(before, at);
    let turn_rad = wrap_angle_rad(heading(at, after) - in_rad);
    if turn_rad.abs() < 1e-6 || turn_rad.abs() > PI - 1e-6 {
        points.push(at);
        return;
    }
    let tangent_m = radius_m * (0.5 * turn_rad.abs()).tan();
    let start = Pose2::new(
        at.x_m - tangent_m * in_rad.cos(),
        at.y_m - tangent_m * in_rad.sin(),
        in_rad,
    );
    points.extend((0..=STEPS).map(|step| {
        let part = f64::from(step) / f64::from(STEPS);
        let arc = Pose2::arc(part * radius_m * turn_rad.abs(), 0.0, part * turn_rad);
        start.compose(&arc).point()
    }));
}
