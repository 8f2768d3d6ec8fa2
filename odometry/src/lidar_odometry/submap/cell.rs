//! Cells, tiles of cells, and the origin that single-precision coordinates are measured from.

/// Edge of a cell, m.
pub const CELL_M: f64 = 0.1;
pub(super) const CELL: f32 = CELL_M as f32;
const CELLS_PER_M: f32 = 1.0 / CELL;
pub(super) const TILE_SHIFT: i32 = 3;
/// Edge of a tile, in cells.
pub(super) const TILE_CELLS: i32 = 1 << TILE_SHIFT;
pub(super) const CELLS_IN_TILE: usize = (TILE_CELLS * TILE_CELLS) as usize;
/// Edge of the local map's table of tiles.
pub(super) const TABLE_TILES: i32 = 256;
/// Bits of a cell's fraction that are left of a coordinate before it is rounded down: 0.1 mm.
const FRACTION_BITS: i32 = 10;
/// Offset that, added to a coordinate of up to 4096 cells, leaves single precision so many bits of
/// a fraction, with numbers in the order of their bits. Beyond, a cell is another's, as the table's
/// are.
const FIXED_POINT: f32 = 12_288.0;

/// A cell of the odometry frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cell {
    /// Column.
    pub x: i32,
    /// Row.
    pub y: i32,
}

impl Cell {
    /// No cell that a point lies in.
    pub const NOWHERE: Self = Self {
        x: i32::MIN,
        y: i32::MIN,
    };

    /// Its place in its tile.
    #[inline]
    pub(super) fn slot(self) -> usize {
        (((self.y & (TILE_CELLS - 1)) << TILE_SHIFT) | (self.x & (TILE_CELLS - 1))) as usize
    }
}

/// Origin of single-precision coordinates: a tile's corner near the LiDAR, so that they stay exact
/// to micrometres after any distance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LocalOrigin {
    cell: Cell,
}

impl LocalOrigin {
    /// The origin near a point of the odometry frame, m.
    pub fn near(x_m: f64, y_m: f64) -> Self {
        let tile_m = CELL_M * f64::from(TILE_CELLS);
        let corner = |v: f64| ((v / tile_m).floor() as i32) << TILE_SHIFT;
        Self {
            cell: Cell {
                x: corner(x_m),
                y: corner(y_m),
            },
        }
    }

    /// Its position in the odometry frame, m.
    pub fn position_m(self) -> (f64, f64) {
        (
            f64::from(self.cell.x) * CELL_M,
            f64::from(self.cell.y) * CELL_M,
        )
    }

    /// The cell of a point given from this origin, and the point relative to the cell's centre.
    #[inline]
    pub fn locate(self, x: f32, y: f32) -> (Cell, f32, f32) {
        let (column, row) = (rounded_down(x * CELLS_PER_M), rounded_down(y * CELLS_PER_M));
        let cell = Cell {
            x: self.cell.x + column,
            y: self.cell.y + row,
        };
        (
            cell,
            x - (column as f32 + 0.5) * CELL,
            y - (row as f32 + 0.5) * CELL,
        )
    }
}

/// The whole number below `value`, where a point just below a cell's edge lies on it: `floor` and a cast
/// would take several times as long.
#[inline]
fn rounded_down(value: f32) -> i32 {
    let bits = (value + FIXED_POINT).to_bits() as i32;
    bits.wrapping_sub(FIXED_POINT.to_bits() as i32) >> FRACTION_BITS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_reaches_from_its_edge_to_the_next() {
        for column in [-4_000, -1_023, -600, -1, 0, 1, 2, 3, 599, 1_023, 4_000] {
            let edge = column as f32;
            assert_eq!(rounded_down(edge), column);
            assert_eq!(rounded_down(edge + 0.999), column);
            assert_eq!(rounded_down(edge - 0.001), column - 1);
        }
        // Only the last bits are off the edge.
        assert_eq!(rounded_down((0.82 - 0.02) * CELLS_PER_M), 8);
    }
}
