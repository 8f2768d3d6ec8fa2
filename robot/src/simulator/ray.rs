//! Ray casting: obstacles sorted into square cells, which a ray walks through one by one.

use super::plane::Point;
use super::shape::{Area, Pillar, Segment};

/// Side of a cell, m: about two obstacles a cell in a warehouse.
const CELL_M: f64 = 0.5;
/// Largest number of cells a side: 1 km of hall.
const CELLS_MAX: usize = 2048;
/// Slack that keeps an obstacle on a cell's edge in both cells, m.
const EDGE_M: f64 = 1e-6;

/// A direction of unit length.
#[derive(Debug, Clone, Copy)]
pub(super) struct Direction {
    pub x: f64,
    pub y: f64,
}

impl Direction {
    pub fn from_angle_rad(angle_rad: f64) -> Self {
        let (y, x) = angle_rad.sin_cos();
        Self { x, y }
    }
}

/// Hit of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Met {
    /// Range, m; infinite without an obstacle.
    pub range_m: f64,
    /// Cosine of the angle of incidence.
    pub cos_incidence: f64,
}

/// A wall in the form for intersection.
#[derive(Debug, Clone, Copy)]
struct Edge {
    from: Point,
    along_x_m: f64,
    along_y_m: f64,
}

/// Returns the distance at which a ray meets a circle from outside; infinite if it misses.
pub(super) fn circle_range_m(
    origin: Point,
    direction: Direction,
    centre: Point,
    radius_m: f64,
) -> f64 {
    let (dx, dy) = (centre.x_m - origin.x_m, centre.y_m - origin.y_m);
    let along_m = dx * direction.x + dy * direction.y;
    let across_m = dx * direction.y - dy * direction.x;
    let half_chord_squared = radius_m * radius_m - across_m * across_m;
    if half_chord_squared < 0.0 {
        return f64::INFINITY;
    }
    let range_m = along_m - half_chord_squared.sqrt();
    if range_m > 0.0 {
        range_m
    } else {
        f64::INFINITY
    }
}

impl Edge {
    fn range_m(&self, origin: Point, direction: Direction) -> f64 {
        let (dx, dy) = (self.from.x_m - origin.x_m, self.from.y_m - origin.y_m);
        let denominator = direction.x * self.along_y_m - direction.y * self.along_x_m;
        let range_m = (dx * self.along_y_m - dy * self.along_x_m) / denominator;
        let fraction = (dx * direction.y - dy * direction.x) / denominator;
        // A parallel ray divides by zero and fails both comparisons.
        if range_m > 0.0 && (0.0..=1.0).contains(&fraction) {
            range_m
        } else {
            f64::INFINITY
        }
    }
}

/// Obstacles of a world by cell.
#[derive(Debug, Clone)]
pub(super) struct RayIndex {
    corner: Point,
    columns: usize,
    rows: usize,
    /// First obstacle of each cell in `obstacles`, and one more for the end.
    starts: Vec<u32>,
    /// Obstacles cell by cell: an edge, or a pillar from `edges.len()` on.
    obstacles: Vec<u32>,
    edges: Vec<Edge>,
    pillars: Vec<Pillar>,
}

/// One coordinate of the walk from cell to cell.
struct Axis {
    cell: usize,
    cells: usize,
    forward: bool,
    /// Range at which the ray leaves the present cell along this axis.
    exit_m: f64,
    step_m: f64,
}

impl Axis {
    fn new(offset_m: f64, direction: f64, cells: usize) -> Self {
        let cell = ((offset_m / CELL_M).max(0.0) as usize).min(cells.saturating_sub(1));
        let forward = direction > 0.0;
        let edge_m = (cell + usize::from(forward)) as f64 * CELL_M;
        let (exit_m, step_m) = if direction == 0.0 {
            (f64::INFINITY, f64::INFINITY)
        } else {
            ((edge_m - offset_m) / direction, CELL_M / direction.abs())
        };
        Self {
            cell,
            cells,
            forward,
            exit_m,
            step_m,
        }
    }

    /// Moves to the next cell; returns `false` at the border of the world.
    fn step(&mut self) -> bool {
        self.exit_m += self.step_m;
        if self.forward {
            self.cell += 1;
            self.cell < self.cells
        } else {
            let inside = self.cell > 0;
            self.cell = self.cell.saturating_sub(1);
            inside
        }
    }
}

impl RayIndex {
    pub fn new(segments: &[Segment], pillars: &[Pillar], bounds: Area) -> Self {
        let corner = Point::new(bounds.min.x_m - CELL_M, bounds.min.y_m - CELL_M);
        let cells = |low_m: f64, high_m: f64| {
            (((high_m - low_m) / CELL_M).ceil() as usize + 2).min(CELLS_MAX)
        };
        let mut index = Self {
            corner,
            columns: cells(bounds.min.x_m, bounds.max.x_m),
            rows: cells(bounds.min.y_m, bounds.max.y_m),
            starts: Vec::new(),
            obstacles: Vec::new(),
            edges: segments.iter().map(edge).collect(),
            pillars: pillars.to_vec(),
        };
        index.sort_into_cells(segments);
        index
    }

    fn sort_into_cells(&mut self, segments: &[Segment]) {
        for row in 0..self.rows {
            for column in 0..self.columns {
                self.starts.push(self.obstacles.len() as u32);
                let cell = Area {
                    min: Point::new(
                        self.corner.x_m + column as f64 * CELL_M - EDGE_M,
                        self.corner.y_m + row as f64 * CELL_M - EDGE_M,
                    ),
                    max: Point::new(
                        self.corner.x_m + (column + 1) as f64 * CELL_M + EDGE_M,
                        self.corner.y_m + (row + 1) as f64 * CELL_M + EDGE_M,
                    ),
                };
                let edges = segments
                    .iter()
                    .enumerate()
                    .filter(|(_, s)| crosses(s, &cell));
                self.obstacles
                    .extend(edges.map(|(number, _)| number as u32));
                let first = self.edges.len();
                let round = self.pillars.iter().enumerate();
                let round = round.filter(|(_, p)| cell.distance_m(p.centre) <= p.radius_m);
                self.obstacles
                    .extend(round.map(|(number, _)| (first + number) as u32));
            }
        }
        self.starts.push(self.obstacles.len() as u32);
    }

    fn cell(&self, column: usize, row: usize) -> &[u32] {
        let number = row * self.columns + column;
        match (self.starts.get(number), self.starts.get(number + 1)) {
            (Some(&from), Some(&to)) => self
                .obstacles
                .get(from as usize..to as usize)
                .unwrap_or_default(),
            _ => &[],
        }
    }

    fn obstacle_range_m(&self, obstacle: u32, origin: Point, direction: Direction) -> f64 {
        let number = obstacle as usize;
        if let Some(edge) = self.edges.get(number) {
            return edge.range_m(origin, direction);
        }
        self.pillars
            .get(number - self.edges.len())
            .map_or(f64::INFINITY, |pillar| {
                circle_range_m(origin, direction, pillar.centre, pillar.radius_m)
            })
    }

    /// Returns the range to the nearest obstacle, m; infinite if none is nearer than `range_max_m`
    /// or the origin lies outside the world.
    pub fn range_m(&self, origin: Point, direction: Direction, range_max_m: f64) -> f64 {
        self.nearest(origin, direction, range_max_m).0
    }

    /// Returns the hit: the range, and the cosine of the angle at which the ray meets the obstacle:
    /// 1 for a surface that faces the origin, and without an obstacle.
    pub fn met(&self, origin: Point, direction: Direction, range_max_m: f64) -> Met {
        let (range_m, obstacle) = self.nearest(origin, direction, range_max_m);
        let cos_incidence = obstacle.map_or(1.0, |obstacle| {
            self.cos_incidence(obstacle, origin, direction, range_m)
        });
        Met {
            range_m,
            cos_incidence,
        }
    }

    fn cos_incidence(
        &self,
        obstacle: u32,
        origin: Point,
        direction: Direction,
        range_m: f64,
    ) -> f64 {
        let number = obstacle as usize;
        if let Some(edge) = self.edges.get(number) {
            let across = direction.x * edge.along_y_m - direction.y * edge.along_x_m;
            return (across / edge.along_x_m.hypot(edge.along_y_m)).abs();
        }
        self.pillars
            .get(number - self.edges.len())
            .map_or(1.0, |pillar| {
                let (dx, dy) = (
                    pillar.centre.x_m - origin.x_m,
                    pillar.centre.y_m - origin.y_m,
                );
                let along_m = dx * direction.x + dy * direction.y - range_m;
                (along_m / pillar.radius_m).clamp(0.0, 1.0)
            })
    }

    /// Returns the range to the nearest obstacle, and its index.
    fn nearest(&self, origin: Point, direction: Direction, range_max_m: f64) -> (f64, Option<u32>) {
        let (x_m, y_m) = (origin.x_m - self.corner.x_m, origin.y_m - self.corner.y_m);
        let inside =
            |offset_m: f64, cells: usize| offset_m >= 0.0 && offset_m < cells as f64 * CELL_M;
        if !inside(x_m, self.columns) || !inside(y_m, self.rows) {
            return (f64::INFINITY, None);
        }
        let mut x = Axis::new(x_m, direction.x, self.columns);
        let mut y = Axis::new(y_m, direction.y, self.rows);
        let (mut nearest_m, mut nearest) = (f64::INFINITY, None);
        loop {
            for &obstacle in self.cell(x.cell, y.cell) {
                let range_m = self.obstacle_range_m(obstacle, origin, direction);
                if range_m < nearest_m {
                    (nearest_m, nearest) = (range_m, Some(obstacle));
                }
            }
            let exit_m = x.exit_m.min(y.exit_m);
            if nearest_m <= exit_m || exit_m > range_max_m {
                break;
            }
            let went_on = if x.exit_m < y.exit_m {
                x.step()
            } else {
                y.step()
            };
            if !went_on {
                break;
            }
        }
        if nearest_m <= range_max_m {
            (nearest_m, nearest)
        } else {
            (f64::INFINITY, None)
        }
    }
}

fn edge(segment: &Segment) -> Edge {
    Edge {
        from: segment.from,
        along_x_m: segment.to.x_m - segment.from.x_m,
        along_y_m: segment.to.y_m - segment.from.y_m,
    }
}

/// True if a segment and a cell overlap: separating axes x, y and the segment's normal.
fn crosses(segment: &Segment, cell: &Area) -> bool {
    let (from, to) = (segment.from, segment.to);
    if from.x_m.max(to.x_m) < cell.min.x_m
        || from.x_m.min(to.x_m) > cell.max.x_m
        || from.y_m.max(to.y_m) < cell.min.y_m
        || from.y_m.min(to.y_m) > cell.max.y_m
    {
        return false;
    }
    let (normal_x, normal_y) = (to.y_m - from.y_m, from.x_m - to.x_m);
    let centre = cell.min.toward(cell.max, 0.5);
    let half_m = 0.5 * (cell.max.x_m - cell.min.x_m);
    let distance = (normal_x * (centre.x_m - from.x_m) + normal_y * (centre.y_m - from.y_m)).abs();
    distance <= half_m * (normal_x.abs() + normal_y.abs())
}
