//! The map's occupied cells as a picture of one bit a cell, and counts of many bits at once.

use crate::lidar_odometry::submap::{Cell, Submap};

/// Edge of the picture, in cells (±25.6 m).
const EDGE: i32 = 512;
/// Words of a row.
const WORDS: usize = (EDGE / 64) as usize;
/// Digits of a count: of up to 255 points.
const DIGITS: usize = 8;

/// The occupied cells around the LiDAR, one bit a cell.
pub struct Picture {
    low: Cell,
    rows: Vec<[u64; WORDS]>,
}

impl Picture {
    /// The picture of the map around a cell.
    pub fn of(submap: &Submap, centre: Cell) -> Self {
        let low = Cell {
            x: centre.x - EDGE / 2,
            y: centre.y - EDGE / 2,
        };
        let mut rows = vec![[0; WORDS]; EDGE as usize];
        submap.for_each_occupied(centre, EDGE / 2, |cell| {
            let (x, y) = (cell.x - low.x, cell.y - low.y);
            if let Some(row) = usize::try_from(y).ok().and_then(|y| rows.get_mut(y)) {
                set(row, x);
            }
        });
        Self { low, rows }
    }

    /// The picture with every occupied cell widened by `reach` cells on each side.
    pub fn widened(&self, reach: usize) -> Self {
        let narrow: Vec<_> = self.rows.iter().map(|row| widen_row(row, reach)).collect();
        let rows = (0..narrow.len()).map(|index| {
            let to = (index + reach + 1).min(narrow.len());
            let mut wide = [0; WORDS];
            for other in narrow
                .get(index.saturating_sub(reach)..to)
                .unwrap_or_default()
            {
                for (word, more) in wide.iter_mut().zip(other) {
                    *word |= more;
                }
            }
            wide
        });
        Self {
            low: self.low,
            rows: rows.collect(),
        }
    }

    /// Numbers of the cells that are occupied when they are shifted by `shift`, and by 1 to 63 columns more.
    pub fn counts(&self, cells: &[Cell], shift: Cell) -> Counts {
        let mut counts = Counts::default();
        for cell in cells {
            counts.add(self.row_from(Cell {
                x: cell.x + shift.x,
                y: cell.y + shift.y,
            }));
        }
        counts
    }

    /// A cell and those in the 63 columns after it, the cell in the lowest bit.
    #[inline]
    fn row_from(&self, cell: Cell) -> u64 {
        let (x, y) = (cell.x - self.low.x, cell.y - self.low.y);
        let Some(row) = usize::try_from(y).ok().and_then(|y| self.rows.get(y)) else {
            return 0;
        };
        let word = |index: i32| {
            let index = usize::try_from(index).ok();
            index.and_then(|index| row.get(index)).copied().unwrap_or(0)
        };
        let (index, shift) = (x >> 6, x & 63);
        word(index) >> shift | word(index + 1) << 1 << (63 - shift)
    }
}

fn set(row: &mut [u64; WORDS], x: i32) {
    if let Some(word) = usize::try_from(x >> 6).ok().and_then(|x| row.get_mut(x)) {
        *word |= 1 << (x & 63);
    }
}

fn widen_row(row: &[u64; WORDS], reach: usize) -> [u64; WORDS] {
    let mut wide = *row;
    for _ in 0..reach {
        let before = wide;
        let mut from_left = 0;
        for (word, &old) in wide.iter_mut().zip(&before) {
            *word |= old << 1 | from_left;
            from_left = old >> 63;
        }
        let mut from_right = 0;
        for (word, &old) in wide.iter_mut().zip(&before).rev() {
            *word |= old >> 1 | from_right;
            from_right = old << 63;
        }
    }
    wide
}

/// A count for each of 64 columns: digit `k` of all of them stands in word `k`.
#[derive(Debug, Clone, Copy, Default)]
pub struct Counts([u64; DIGITS]);

impl Counts {
    /// Counts one more in each column whose bit is set.
    #[inline]
    pub fn add(&mut self, bits: u64) {
        let mut carry = bits;
        for digits in &mut self.0 {
            let both = *digits & carry;
            *digits ^= carry;
            carry = both;
        }
    }

    /// The count of a column.
    #[inline]
    pub fn of(&self, column: usize) -> u32 {
        let digits = (0..).zip(&self.0);
        digits
            .map(|(k, digits)| ((digits >> column & 1) as u32) << k)
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_counted_apart() {
        let mut counts = Counts::default();
        for point in 0..128_u64 {
            // The columns 0, 1, 2 … get every point, every second one, every fourth one …
            counts.add(
                (0..8)
                    .map(|column| u64::from(point % (1 << column) == 0) << column)
                    .sum(),
            );
        }
        let found: Vec<_> = (0..9).map(|column| counts.of(column)).collect();
        assert_eq!(found, [128, 64, 32, 16, 8, 4, 2, 1, 0]);
    }

    #[test]
    fn a_row_is_read_from_any_column() {
        let low = Cell { x: -256, y: -256 };
        let mut rows = vec![[0; WORDS]; EDGE as usize];
        let is_occupied = |x: i32| (0..EDGE).contains(&x) && x % 7 < 2;
        let occupied = (0..EDGE).filter(|x| is_occupied(*x));
        occupied.for_each(|x| set(&mut rows[300], x));
        let picture = Picture { low, rows };
        for x in [-100, -64, -20, 0, 1, 63, 64, 130, 250, 449, 500, 511, 530] {
            let wanted = (0..64).map(|more| u64::from(is_occupied(x + more)) << more);
            let cell = Cell {
                x: x + low.x,
                y: 300 + low.y,
            };
            assert_eq!(picture.row_from(cell), wanted.sum::<u64>(), "from {x}");
        }
        let below = Cell { x: 0, y: low.y - 1 };
        assert_eq!(picture.row_from(below), 0);
    }
}
