//! A map that was known before: the lines along its occupied cells, and where it is free.
//!
//! A beam ends on occupied cells that touch free ones; their middles are the points that lines are
//! fitted to. A surface lies anywhere in its cell, so each line is off by up to half a cell, all
//! along a wall alike.

use super::cell::{CELLS_IN_TILE, Cell, TILE_CELLS, TILE_SHIFT};
use super::edges::{Edges, LineFitter, cell_at, centre_m, edges_of};
use super::surfel::Line;
use crate::occupancy_grid::{Occupancy, OccupancyGrid};

/// Distance from anything occupied within which space does not count as free, in cells: a wall's
/// returns scatter.
const FREE_MARGIN: i32 = 3;

/// The map as scans are aligned with it: tiles of 10 cm cells over the whole grid.
#[derive(Debug, Clone)]
pub struct KnownMap {
    /// The lowest tile.
    low: Cell,
    columns: i32,
    rows: i32,
    tiles: Vec<Tile>,
    lines: Vec<[Line; CELLS_IN_TILE]>,
}

/// One bit a cell, and the places of the lines.
#[derive(Debug, Clone, Copy, Default)]
struct Tile {
    occupied: u64,
    free: u64,
    /// Number of its lines plus one; 0: none.
    lines: u32,
}

impl KnownMap {
    /// The lines and the free space of a grid.
    pub fn new(grid: &OccupancyGrid) -> Self {
        let edges = edges_of(grid);
        let mut map = Self::over(grid);
        let fitter = LineFitter::new(grid.resolution_m());
        for &(x, y) in edges.keys() {
            map.mark(Cell { x, y }, |tile, bit| tile.occupied |= bit);
            for dy in -fitter.capture..=fitter.capture {
                for dx in -fitter.capture..=fitter.capture {
                    let cell = Cell {
                        x: x + dx,
                        y: y + dy,
                    };
                    if !map.line(cell).exists()
                        && let Some(line) = fitter.fit(&edges, cell)
                    {
                        map.set_line(cell, line);
                    }
                }
            }
        }
        map.mark_free(grid, &edges);
        map
    }

    /// An empty map that covers a grid.
    fn over(grid: &OccupancyGrid) -> Self {
        let (columns, rows) = (grid.width() as i64 - 1, grid.height() as i64 - 1);
        let corners = [(0, 0), (columns, 0), (0, rows), (columns, rows)]
            .map(|(column, row)| cell_at(grid.centre_m(column, row)));
        let mut low = cell_at(grid.centre_m(0, 0));
        let mut high = low;
        for corner in corners {
            (low.x, low.y) = (low.x.min(corner.x), low.y.min(corner.y));
            (high.x, high.y) = (high.x.max(corner.x), high.y.max(corner.y));
        }
        // A tile more on each side, for the cells beside the outermost.
        let low = Cell {
            x: (low.x >> TILE_SHIFT) - 1,
            y: (low.y >> TILE_SHIFT) - 1,
        };
        let columns = (high.x >> TILE_SHIFT) + 2 - low.x;
        let rows = (high.y >> TILE_SHIFT) + 2 - low.y;
        Self {
            low,
            columns,
            rows,
            tiles: vec![Tile::default(); (columns * rows) as usize],
            lines: Vec::new(),
        }
    }

    fn mark_free(&mut self, grid: &OccupancyGrid, edges: &Edges) {
        for y in self.low.y * TILE_CELLS..(self.low.y + self.rows) * TILE_CELLS {
            for x in self.low.x * TILE_CELLS..(self.low.x + self.columns) * TILE_CELLS {
                let cell = Cell { x, y };
                let (column, row) = grid.cell_of(centre_m(cell));
                if grid.at(column, row) == Occupancy::Free {
                    self.mark(cell, |tile, bit| tile.free |= bit);
                }
            }
        }
        for &(x, y) in edges.keys() {
            for dy in -FREE_MARGIN..=FREE_MARGIN {
                for dx in -FREE_MARGIN..=FREE_MARGIN {
                    let beside = Cell {
                        x: x + dx,
                        y: y + dy,
                    };
                    self.mark(beside, |tile, bit| tile.free &= !bit);
                }
            }
        }
    }

    #[inline]
    fn tile_index(&self, cell: Cell) -> Option<usize> {
        let (x, y) = (
            (cell.x >> TILE_SHIFT) - self.low.x,
            (cell.y >> TILE_SHIFT) - self.low.y,
        );
        let is_inside = (0..self.columns).contains(&x) && (0..self.rows).contains(&y);
        is_inside.then(|| (y * self.columns + x) as usize)
    }

    #[inline]
    fn tile(&self, cell: Cell) -> Option<&Tile> {
        self.tiles.get(self.tile_index(cell)?)
    }

    fn mark(&mut self, cell: Cell, set: impl FnOnce(&mut Tile, u64)) {
        if let Some(tile) = self
            .tile_index(cell)
            .and_then(|index| self.tiles.get_mut(index))
        {
            set(tile, 1 << cell.slot());
        }
    }

    /// The line of a cell.
    #[inline]
    pub fn line(&self, cell: Cell) -> Line {
        self.tile(cell)
            .and_then(|tile| (tile.lines as usize).checked_sub(1))
            .and_then(|number| self.lines.get(number)?.get(cell.slot()).copied())
            .unwrap_or(Line::NONE)
    }

    fn set_line(&mut self, cell: Cell, line: Line) {
        let next = self.lines.len() as u32 + 1;
        let Some(tile) = self
            .tile_index(cell)
            .and_then(|index| self.tiles.get_mut(index))
        else {
            return;
        };
        if tile.lines == 0 {
            tile.lines = next;
            self.lines.push([Line::NONE; CELLS_IN_TILE]);
        }
        if let Some(old) = self
            .lines
            .get_mut(tile.lines as usize - 1)
            .and_then(|cells| cells.get_mut(cell.slot()))
        {
            *old = line;
        }
    }

    /// True if the map has nothing in a cell and near it.
    #[inline]
    pub fn is_free(&self, cell: Cell) -> bool {
        self.tile(cell)
            .is_some_and(|tile| tile.free >> cell.slot() & 1 == 1)
    }

    /// Calls `visit` with the occupied cells of all tiles that come within `reach` cells of
    /// `centre` in x and y.
    pub fn for_each_occupied(&self, centre: Cell, reach: i32, visit: &mut impl FnMut(Cell)) {
        let span = |centre: i32, low: i32, count: i32| {
            let from = ((centre - reach) >> TILE_SHIFT).max(low);
            from..(((centre + reach) >> TILE_SHIFT) + 1).min(low + count)
        };
        for tile_y in span(centre.y, self.low.y, self.rows) {
            for tile_x in span(centre.x, self.low.x, self.columns) {
                let corner = Cell {
                    x: tile_x << TILE_SHIFT,
                    y: tile_y << TILE_SHIFT,
                };
                let mut rest = self.tile(corner).map_or(0, |tile| tile.occupied);
                while rest != 0 {
                    let slot = rest.trailing_zeros() as i32;
                    rest &= rest - 1;
                    visit(Cell {
                        x: corner.x + (slot & (TILE_CELLS - 1)),
                        y: corner.y + (slot >> TILE_SHIFT),
                    });
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;
    use crate::geometry::Pose2;

    /// A room of 4 m by 3 m around the origin whose walls are `thick` cells thick, unknown outside.
    fn room(resolution_m: f64, thick: i64, yaw_rad: f64) -> KnownMap {
        let (columns, rows) = ((5.0 / resolution_m) as i64, (4.0 / resolution_m) as i64);
        let margin = (0.5 / resolution_m).round() as i64;
        let mut cells = Vec::new();
        for row in 0..rows {
            for column in 0..columns {
                let depth =
                    (column.min(columns - 1 - column)).min(row.min(rows - 1 - row)) - margin;
                cells.push(match depth {
                    _ if depth >= thick => Occupancy::Free,
                    _ if depth >= 0 => Occupancy::Occupied,
                    _ => Occupancy::Unknown,
                });
            }
        }
        let corner = Pose2::new(0.0, 0.0, yaw_rad).compose(&Pose2::new(-2.5, -2.0, 0.0));
        KnownMap::new(&OccupancyGrid::new(resolution_m, corner, columns as usize, cells).unwrap())
    }

    /// Distance of a point from the line of its cell, m.
    fn distance(map: &KnownMap, point_m: Vector2<f64>) -> f64 {
        let cell = cell_at(point_m);
        let line = map.line(cell);
        assert!(line.exists(), "no line at {point_m}");
        let offset = point_m - centre_m(cell);
        let along = Vector2::new(f64::from(line.nx), f64::from(line.ny));
        (along.dot(&offset) - f64::from(line.d)).abs()
    }

    #[test]
    fn a_wall_runs_through_the_middles_of_the_cells_that_face_the_room() {
        for resolution_m in [0.02, 0.05, 0.1] {
            for thick in [1, 4] {
                for yaw_rad in [0.0, 0.3, -2.0] {
                    let map = room(resolution_m, thick, yaw_rad);
                    let turned = Pose2::new(0.0, 0.0, yaw_rad);
                    let wall_x_m = 2.0 - (thick as f64 - 0.5) * resolution_m;
                    for y_m in [-0.9, -0.33, 0.0, 0.71] {
                        let on_wall = turned.transform_point(Vector2::new(wall_x_m, y_m));
                        let off_m = distance(&map, on_wall);
                        assert!(off_m < 3e-3, "{off_m} {resolution_m} {thick} {yaw_rad}");
                        let before = turned.transform_point(Vector2::new(wall_x_m - 0.04, y_m));
                        assert!((distance(&map, before) - 0.04).abs() < 3e-3);
                    }
                }
            }
        }
    }

    #[test]
    fn the_middle_of_the_room_is_free_and_nothing_else() {
        let map = room(0.05, 2, 0.0);
        let free = |x: f64, y: f64| map.is_free(cell_at(Vector2::new(x, y)));
        assert!(free(0.0, 0.0) && free(1.4, 1.0));
        assert!(!free(1.75, 0.0), "a wall's returns scatter");
        assert!(!free(2.3, 0.0) && !free(30.0, 0.0), "nobody knows");
        assert!(!map.line(cell_at(Vector2::new(0.0, 0.0))).exists());
    }

    #[test]
    fn occupied_cells_are_visited_where_they_are() {
        let map = room(0.05, 1, 0.0);
        let visited = |centre: Vector2<f64>, reach| {
            let mut cells = Vec::new();
            map.for_each_occupied(cell_at(centre), reach, &mut |cell| cells.push(cell));
            cells
        };
        let all = visited(Vector2::zeros(), 100);
        assert_eq!(all.len(), 2 * (40 + 28));
        assert!(all.iter().all(|cell| map.line(*cell).exists() || {
            let corner = centre_m(*cell).abs();
            corner.x > 1.8 && corner.y > 1.3
        }));
        let near = visited(Vector2::new(2.0, 0.0), 4);
        assert!(!near.is_empty() && near.len() < all.len() / 2);
    }

    #[test]
    fn a_slanting_walls_steps_level_out() {
        // The wall y = 0.15 x through cells of 5 cm, free below and unknown above.
        let wall_row = |column: i64| (0.15 * (column as f64 + 0.5)).floor() as i64 + 2;
        let cells = (0..40)
            .flat_map(|row| (0..200).map(move |column| (row, column)))
            .map(|(row, column)| match row - wall_row(column) {
                0 => Occupancy::Occupied,
                below if below < 0 => Occupancy::Free,
                _ => Occupancy::Unknown,
            })
            .collect();
        let origin = Pose2::new(0.0, -0.1, 0.0);
        let map = KnownMap::new(&OccupancyGrid::new(0.05, origin, 200, cells).unwrap());
        let mut sum_m2 = 0.0;
        for step in 0..800 {
            let x_m = 0.5 + 0.01 * f64::from(step);
            sum_m2 += distance(&map, Vector2::new(x_m, 0.15 * x_m)).powi(2);
        }
        let rms_m = (sum_m2 / 800.0_f64).sqrt();
        assert!(rms_m < 0.006, "{rms_m}");
    }
}
