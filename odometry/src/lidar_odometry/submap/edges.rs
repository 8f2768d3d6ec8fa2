//! The occupied cells of a grid on which beams end, and the lines through them.

use std::collections::BTreeMap;

use nalgebra::Vector2;

use super::cell::{CELL_M, Cell};
use super::surfel::{Line, LineQuality, Moments, WindowMoments};
use crate::occupancy_grid::OccupancyGrid;

/// Windows in which a line is looked for, the widest first: so many cells of the grid on each side.
/// Over a wide one the steps of a slanting wall level out.
const WINDOWS: [f64; 3] = [6.0, 4.0, 2.0];
/// Least cosine between the facings of two edges of one surface.
const FACING_COS: f64 = 0.6;

/// An occupied cell of the grid that touches free ones.
#[derive(Debug, Clone, Copy)]
pub struct Edge {
    position_m: Vector2<f64>,
    /// Towards the free cells; zero when they are on both sides.
    facing: Vector2<f64>,
}

impl Edge {
    fn is_of_surface(&self, other: &Self) -> bool {
        let cos = self.facing.dot(&other.facing);
        self.facing == Vector2::zeros() || other.facing == Vector2::zeros() || cos > FACING_COS
    }
}

/// The edges of a grid, by the cell of the map that they lie in.
pub type Edges = BTreeMap<(i32, i32), Vec<Edge>>;

/// The cell of a point of the map.
pub fn cell_at(point_m: Vector2<f64>) -> Cell {
    Cell {
        x: (point_m.x / CELL_M).floor() as i32,
        y: (point_m.y / CELL_M).floor() as i32,
    }
}

/// The middle of a cell in the map, m.
pub fn centre_m(cell: Cell) -> Vector2<f64> {
    Vector2::new(f64::from(cell.x) + 0.5, f64::from(cell.y) + 0.5) * CELL_M
}

/// The edges of a grid.
pub fn edges_of(grid: &OccupancyGrid) -> Edges {
    let mut edges = Edges::new();
    for row in 0..grid.height() as i64 {
        for column in 0..grid.width() as i64 {
            let Some(facing) = grid.facing(column, row) else {
                continue;
            };
            let position_m = grid.centre_m(column, row);
            let Cell { x, y } = cell_at(position_m);
            edges
                .entry((x, y))
                .or_default()
                .push(Edge { position_m, facing });
        }
    }
    edges
}

/// Fits the line of a cell to the edges around it.
pub struct LineFitter {
    /// Half the windows, in cells.
    reaches: Vec<i32>,
    /// Cells from an edge within which a cell still gets its line.
    pub capture: i32,
    quality: LineQuality,
    variance_m2: f32,
}

impl LineFitter {
    /// Prepares the fit for a grid of this resolution.
    pub fn new(resolution_m: f64) -> Self {
        let in_cells = |count: f64| (count * resolution_m / CELL_M).ceil().max(1.0) as i32;
        let mut reaches = WINDOWS.map(in_cells).to_vec();
        reaches.dedup();
        let resolution2 = (resolution_m * resolution_m) as f32;
        Self {
            reaches,
            capture: in_cells(1.0),
            quality: LineQuality {
                points_min: 3.0,
                across_max_m2: 0.36 * resolution2,
                along_min_m2: 0.6 * resolution2,
                ratio_max: 0.25,
                noise_m2: 0.0,
                noise_floor_m2: 0.0,
                sightings_min: 0,
            },
            // Anywhere in a cell, all along a wall alike: more points do not average it away.
            variance_m2: resolution2 / 12.0,
        }
    }

    /// The line of the surface nearest to a cell, where the edges around it lie on one.
    pub fn fit(&self, edges: &Edges, cell: Cell) -> Option<Line> {
        let widest = *self.reaches.first()?;
        let centre_m = centre_m(cell);
        let around = || {
            (cell.x - widest..=cell.x + widest)
                .flat_map(|x| edges.range((x, cell.y - widest)..=(x, cell.y + widest)))
                .flat_map(|(&at, edges)| edges.iter().map(move |edge| (at, edge)))
        };
        let distance2 = |edge: &Edge| (edge.position_m - centre_m).norm_squared();
        let nearest = around()
            .map(|(_, edge)| edge)
            .min_by(|a, b| distance2(a).total_cmp(&distance2(b)))?;
        self.reaches.iter().find_map(|&reach| {
            let mut points = Moments::default();
            for ((x, y), edge) in around() {
                let is_inside = (x - cell.x).abs().max((y - cell.y).abs()) <= reach;
                if is_inside && nearest.is_of_surface(edge) {
                    let offset = edge.position_m - centre_m;
                    points.add((offset.x as f32, offset.y as f32), (0.0, 0.0), 1.0, 0);
                }
            }
            let line = WindowMoments::of(&points, 0.0, 0.0).line(&self.quality);
            line.exists().then_some(Line {
                variance: self.variance_m2,
                ..line
            })
        })
    }
}
