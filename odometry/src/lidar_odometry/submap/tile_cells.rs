//! Cells of one tile: values of some of them, and sets of them with one bit a cell.

use super::cell::TILE_SHIFT;

/// The cells of a tile's first column,
const FIRST_COLUMN: u64 = 0x0101_0101_0101_0101;
/// and of its last one.
const LAST_COLUMN: u64 = FIRST_COLUMN << 7;
/// Bits from a tile's first row to its last one.
const LAST_ROW: u32 = 7 << TILE_SHIFT;

/// Values of those cells of a tile that have one, in the order of the cells.
#[derive(Debug, Clone)]
pub struct TileCells<T> {
    /// The cells that have a value.
    filled: u64,
    values: Vec<T>,
}

impl<T> Default for TileCells<T> {
    fn default() -> Self {
        Self {
            filled: 0,
            values: Vec::new(),
        }
    }
}

impl<T> TileCells<T> {
    /// Bytes held beside its own.
    pub fn memory_bytes(&self) -> usize {
        self.values.capacity() * size_of::<T>()
    }

    /// The cells that have a value.
    pub fn filled(&self) -> u64 {
        self.filled
    }

    /// The values, each with its cell's slot.
    pub fn iter(&self) -> impl Iterator<Item = (usize, &T)> {
        slots(self.filled).zip(&self.values)
    }

    #[inline]
    fn is_filled(&self, slot: usize) -> bool {
        self.filled >> slot & 1 == 1
    }

    /// Number of the values before a cell's.
    #[inline]
    fn rank(&self, slot: usize) -> usize {
        (self.filled & ((1 << slot) - 1)).count_ones() as usize
    }

    /// The value of a cell.
    #[inline]
    pub fn get(&self, slot: usize) -> Option<&T> {
        let rank = self.is_filled(slot).then(|| self.rank(slot))?;
        self.values.get(rank)
    }

    /// The value of a cell, a default one if it had none.
    #[inline]
    pub fn get_or_default(&mut self, slot: usize) -> Option<&mut T>
    where
        T: Default,
    {
        let rank = self.rank(slot);
        if !self.is_filled(slot) {
            self.filled |= 1 << slot;
            self.values.insert(rank, T::default());
        }
        self.values.get_mut(rank)
    }

    /// Sets the value of a cell.
    pub fn set(&mut self, slot: usize, value: Option<T>) {
        let rank = self.rank(slot);
        match (self.is_filled(slot), value) {
            (true, Some(value)) => {
                if let Some(old) = self.values.get_mut(rank) {
                    *old = value;
                }
            }
            (true, None) => {
                self.values.remove(rank);
                self.filled &= !(1 << slot);
            }
            (false, Some(value)) => {
                self.values.insert(rank, value);
                self.filled |= 1 << slot;
            }
            (false, None) => {}
        }
    }
}

/// The cells of a set, by their slots.
pub fn slots(mut set: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let slot = (set != 0).then(|| set.trailing_zeros() as usize)?;
        set &= set - 1;
        Some(slot)
    })
}

/// The cells at most one column and one row from those of a set, by the tile that they lie in: the set's own
/// in the middle, rows of tiles from the lowest.
pub fn spread(set: u64) -> [[u64; 3]; 3] {
    let columns = [
        (set & FIRST_COLUMN) << 7,
        set | (set & !LAST_COLUMN) << 1 | (set & !FIRST_COLUMN) >> 1,
        (set & LAST_COLUMN) >> 7,
    ];
    [
        columns.map(|set| set << LAST_ROW),
        columns.map(|set| set | set << 8 | set >> 8),
        columns.map(|set| set >> LAST_ROW),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_those_of_their_cells_whatever_the_order() {
        let mut cells = TileCells::default();
        for slot in [40, 3, 63, 0, 17] {
            cells.set(slot, Some(slot));
        }
        cells.set(17, None);
        cells.set(40, Some(41));
        *cells.get_or_default(5).unwrap() += 50;
        let values: Vec<_> = (0..64).filter_map(|slot| cells.get(slot)).collect();
        assert_eq!(values, [&0, &3, &50, &41, &63]);
        assert_eq!(slots(cells.filled()).collect::<Vec<_>>(), [0, 3, 5, 40, 63]);
    }

    #[test]
    fn a_set_spreads_by_a_cell_on_each_side_into_the_tiles_around() {
        for slot in 0..64_i32 {
            let (column, row) = (slot & 7, slot >> 3);
            let around = spread(1 << slot);
            for (y, tiles) in (-1..=1).zip(&around) {
                for (x, &set) in (-1..=1).zip(tiles) {
                    for other in 0..64_i32 {
                        let across = (8 * x + (other & 7) - column).abs();
                        let along = (8 * y + (other >> 3) - row).abs();
                        assert_eq!(set >> other & 1 == 1, across.max(along) <= 1);
                    }
                }
            }
        }
    }
}
