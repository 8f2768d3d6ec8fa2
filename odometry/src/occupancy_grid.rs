//! Map that was made before: cells that are occupied, free or unknown.

use nalgebra::Vector2;

use crate::field::FieldRefused;
use crate::geometry::Pose2;

/// Finest resolution accepted, m.
pub const RESOLUTION_MIN_M: f64 = 0.01;
/// Coarsest resolution accepted, m: beyond, a wall is not known well enough to be of use.
pub const RESOLUTION_MAX_M: f64 = 0.25;
/// Farthest origin from the map's own, m.
pub const ORIGIN_MAX_M: f64 = 1e6;
/// Longest side accepted, m.
pub const SIDE_MAX_M: f64 = 1000.0;
/// Most cells accepted: one byte each.
pub const GRID_CELLS_MAX: usize = 1 << 26;

/// Occupancy of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Occupancy {
    /// Cell of which nothing is known.
    #[default]
    Unknown,
    /// Cell in which nothing stands.
    Free,
    /// Cell in which something stands.
    Occupied,
}

/// An occupancy grid in the map's frame.
#[derive(Debug, Clone, PartialEq)]
pub struct OccupancyGrid {
    resolution_m: f64,
    grid_in_map: Pose2,
    width: usize,
    cells: Vec<Occupancy>,
}

impl OccupancyGrid {
    /// Checks and builds a grid. `grid_in_map` is the pose of the outer corner of the first cell;
    /// `cells` go along x of the grid first, row after row along its y.
    ///
    /// # Errors
    /// Names the impossible field, its value and the accepted values.
    pub fn new(
        resolution_m: f64,
        grid_in_map: Pose2,
        width: usize,
        cells: Vec<Occupancy>,
    ) -> Result<Self, FieldRefused> {
        if !(RESOLUTION_MIN_M..=RESOLUTION_MAX_M).contains(&resolution_m) {
            let accepted = "0.01 to 0.25 m a cell";
            return Err(FieldRefused::new("resolution", resolution_m, accepted));
        }
        let Pose2 { x_m, y_m, yaw_rad } = grid_in_map;
        let is_far = x_m.abs() > ORIGIN_MAX_M || y_m.abs() > ORIGIN_MAX_M;
        if is_far || !grid_in_map.is_finite() {
            let accepted = "x and y within 1000 km, and a finite yaw";
            let value = format!("[{x_m}, {y_m}, {yaw_rad}]");
            return Err(FieldRefused::new("origin", value, accepted));
        }
        if cells.is_empty() || cells.len() > GRID_CELLS_MAX {
            let accepted = "1 to 67108864 cells";
            return Err(FieldRefused::new("cells", cells.len(), accepted));
        }
        if width == 0 || !cells.len().is_multiple_of(width) {
            let accepted = "a number that divides the number of cells";
            return Err(FieldRefused::new("width", width, accepted));
        }
        for (side, count) in [("width", width), ("height", cells.len() / width)] {
            let side_m = count as f64 * resolution_m;
            if side_m > SIDE_MAX_M {
                let accepted = "at most 1000 m";
                return Err(FieldRefused::new(side, format!("{side_m} m"), accepted));
            }
        }
        if !cells.contains(&Occupancy::Occupied) {
            let accepted = "at least one that is occupied";
            return Err(FieldRefused::new("cells", "none occupied", accepted));
        }
        Ok(Self {
            resolution_m,
            grid_in_map,
            width,
            cells,
        })
    }

    /// Edge of a cell, m.
    pub fn resolution_m(&self) -> f64 {
        self.resolution_m
    }

    /// Number of columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of rows.
    pub fn height(&self) -> usize {
        self.cells.len() / self.width
    }

    /// Occupancy of the cell in a column and row; unknown outside.
    pub fn at(&self, column: i64, row: i64) -> Occupancy {
        let inside = usize::try_from(column)
            .ok()
            .filter(|&column| column < self.width)
            .zip(usize::try_from(row).ok().filter(|&row| row < self.height()));
        inside
            .and_then(|(column, row)| self.cells.get(row * self.width + column))
            .copied()
            .unwrap_or_default()
    }

    /// The middle of a cell in the map, m.
    pub fn centre_m(&self, column: i64, row: i64) -> Vector2<f64> {
        let along = |index: i64| (index as f64 + 0.5) * self.resolution_m;
        self.grid_in_map
            .transform_point(Vector2::new(along(column), along(row)))
    }

    /// Column and row of the cell that a point of the map lies in, inside the grid or not.
    pub fn cell_of(&self, point_in_map_m: Vector2<f64>) -> (i64, i64) {
        let point = self.grid_in_map.inverse().transform_point(point_in_map_m);
        let index = |metres: f64| (metres / self.resolution_m).floor() as i64;
        (index(point.x), index(point.y))
    }

    /// Direction in the map, of length 1, from an occupied cell to the free cells around it, and
    /// zero where they lie on opposite sides; `None` for a cell that is not occupied, or that no
    /// free cell touches: no beam ends there.
    pub fn facing(&self, column: i64, row: i64) -> Option<Vector2<f64>> {
        if self.at(column, row) != Occupancy::Occupied {
            return None;
        }
        let mut sum = Vector2::zeros();
        let mut free = 0;
        for (dx, dy) in [
            (1, 0),
            (1, 1),
            (0, 1),
            (-1, 1),
            (-1, 0),
            (-1, -1),
            (0, -1),
            (1, -1),
        ] {
            if self.at(column + dx, row + dy) == Occupancy::Free {
                sum += Vector2::new(dx as f64, dy as f64).normalize();
                free += 1;
            }
        }
        if free == 0 {
            return None;
        }
        let facing = self.grid_in_map.rotation() * sum;
        Some(facing.try_normalize(0.5).unwrap_or_default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Occupancy::{Free, Occupied, Unknown};

    fn refused(resolution_m: f64, origin: Pose2, width: usize, cells: Vec<Occupancy>) -> String {
        OccupancyGrid::new(resolution_m, origin, width, cells)
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn what_cannot_be_is_refused_by_field_value_and_what_is_accepted() {
        let one = || vec![Occupied];
        let at = Pose2::IDENTITY;
        for resolution in [0.0, -0.05, 0.3, f64::NAN, f64::INFINITY] {
            let reason = refused(resolution, at, 1, one());
            assert!(reason.starts_with("resolution: got ") && reason.contains("0.25 m"));
        }
        let odd = Pose2::new(0.0, f64::NAN, 0.0);
        assert!(refused(0.05, odd, 1, one()).starts_with("origin: got [0, NaN, 0]"));
        assert!(refused(0.05, at, 1, Vec::new()).starts_with("cells: got 0"));
        assert!(refused(0.05, at, 0, one()).starts_with("width: got 0"));
        assert!(refused(0.05, at, 2, vec![Occupied; 3]).starts_with("width: got 2"));
        assert!(refused(0.25, at, 5000, vec![Occupied; 5000]).contains("width: got 1250 m"));
        assert!(refused(0.25, at, 1, vec![Occupied; 5000]).contains("height: got 1250 m"));
        assert!(refused(0.05, at, 1, vec![Free, Unknown]).contains("none occupied"));
    }

    #[test]
    fn cells_lie_where_the_origin_puts_them() {
        // A quarter turn: columns go along y of the map, rows against x.
        let origin = Pose2::new(2.0, 1.0, std::f64::consts::FRAC_PI_2);
        let grid = OccupancyGrid::new(0.1, origin, 2, vec![Occupied, Free, Free, Free]).unwrap();
        assert_eq!((grid.width(), grid.height()), (2, 2));
        let centre = grid.centre_m(1, 0);
        assert!(
            (centre - Vector2::new(1.95, 1.15)).norm() < 1e-12,
            "{centre}"
        );
        assert_eq!(grid.cell_of(centre), (1, 0));
        assert_eq!(grid.at(0, 0), Occupied);
        assert_eq!(
            (grid.at(-1, 0), grid.at(2, 0), grid.at(0, 2)),
            (Unknown, Unknown, Unknown)
        );
    }

    #[test]
    fn an_occupied_cell_faces_the_free_ones() {
        // Columns 0 to 2: unknown, a wall, free.
        let row = [Unknown, Occupied, Free];
        let grid = OccupancyGrid::new(0.05, Pose2::IDENTITY, 3, row.repeat(3)).unwrap();
        let facing = grid.facing(1, 1).unwrap();
        assert!((facing - Vector2::x()).norm() < 1e-12);
        assert_eq!(grid.facing(2, 1), None);
        // Free on both sides: it faces either way.
        let row = [Free, Occupied, Free];
        let grid = OccupancyGrid::new(0.05, Pose2::IDENTITY, 3, row.repeat(3)).unwrap();
        assert_eq!(grid.facing(1, 1), Some(Vector2::zeros()));
        let inside = OccupancyGrid::new(0.05, Pose2::IDENTITY, 3, vec![Occupied; 9]).unwrap();
        assert_eq!(inside.facing(1, 1), None);
    }
}
