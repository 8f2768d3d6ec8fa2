//! The pool of tiles that the local map lives in.
//!
//! A toroidal table of tile numbers covers ±100 m around the LiDAR, so finding a tile is one array
//! read. Tiles are a bounded pool: the one unseen longest makes room. That bounds the memory
//! whatever the route.

use super::cell::{Cell, TABLE_TILES, TILE_CELLS, TILE_SHIFT};
use super::surfel::{Line, Moments};
use super::tile_cells::{TileCells, slots, spread};

const TILE_EDGE: usize = TILE_CELLS as usize;
/// Most tiles: 64 cells of 56 bytes each at most, 3.2 MiB in all. A wall fills a third of its tiles' cells.
pub const TILES_MAX: usize = 900;
/// Tiles that memory is reserved for at first.
const TILES_AT_START: usize = 64;
/// Largest distance of a tile from the LiDAR, in tiles (80 m); farther ones are dropped.
const TILE_DISTANCE_MAX: i32 = 100;

/// Cells beside a tile that the lines of its own depend on.
const MARGIN: i32 = 2;
/// Edge of a tile with its margin, in cells.
const EDGE: usize = (TILE_CELLS + 2 * MARGIN) as usize;

/// The points of a tile's cells and of those beside it, row by row.
pub struct Around<'a>([[Option<&'a Moments>; EDGE]; EDGE]);

impl<'a> Around<'a> {
    /// Points of a cell by its column and row in the tile, from [`MARGIN`] cells before it to as many behind.
    #[inline]
    pub fn points(&self, x: i32, y: i32) -> Option<&'a Moments> {
        self.0[(y + MARGIN) as usize][(x + MARGIN) as usize]
    }
}

/// A square of 8 × 8 cells.
#[derive(Debug, Clone)]
struct Tile {
    x: i32,
    y: i32,
    last_update: u32,
    /// Cells whose points changed in this update, one bit each.
    changed: u64,
    /// Cells whose lines are to be laid anew.
    due: u64,
    lines: TileCells<Line>,
    moments: TileCells<Moments>,
}

/// Tiles of 8 × 8 cells, with the points and the lines of those that have any.
#[derive(Debug, Clone, Default)]
pub struct TilePool {
    /// Tile number plus one at (y mod 256, x mod 256); 0: none. Empty until the first tile.
    table: Vec<u16>,
    tiles: Vec<Tile>,
}

fn table_index(tile_x: i32, tile_y: i32) -> usize {
    ((tile_y & (TABLE_TILES - 1)) * TABLE_TILES + (tile_x & (TABLE_TILES - 1))) as usize
}

impl TilePool {
    /// Empties the pool.
    pub fn clear(&mut self) {
        self.table.fill(0);
        self.tiles.clear();
    }

    /// Number of tiles in use.
    #[cfg(test)]
    pub fn len(&self) -> usize {
        self.tiles.len()
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        let of_cells = |tile: &Tile| tile.lines.memory_bytes() + tile.moments.memory_bytes();
        self.table.capacity() * size_of::<u16>()
            + self.tiles.capacity() * size_of::<Tile>()
            + self.tiles.iter().map(of_cells).sum::<usize>()
    }

    #[inline]
    fn number(&self, tile_x: i32, tile_y: i32) -> Option<usize> {
        let number = *self.table.get(table_index(tile_x, tile_y))? as usize;
        number.checked_sub(1)
    }

    #[inline]
    fn number_of(&self, cell: Cell) -> Option<usize> {
        self.number(cell.x >> TILE_SHIFT, cell.y >> TILE_SHIFT)
    }

    /// The line of a cell.
    #[inline]
    pub fn line(&self, cell: Cell) -> Line {
        self.number_of(cell)
            .and_then(|number| self.tiles.get(number)?.lines.get(cell.slot()).copied())
            .unwrap_or(Line::NONE)
    }

    /// Adds a point, given relative to its cell's centre and seen in a direction, in a new tile if need be.
    #[inline]
    pub fn add(
        &mut self,
        cell: Cell,
        point: (f32, f32),
        direction: (f32, f32),
        weight: f32,
        update: u32,
    ) {
        if let Some(number) = self.number_or_new(cell, update)
            && let Some(tile) = self.tiles.get_mut(number)
            && let Some(moments) = tile.moments.get_or_default(cell.slot())
            && moments.add(point, direction, weight, update as u16)
        {
            tile.changed |= 1 << cell.slot();
        }
    }

    /// Forgets the points of a cell.
    pub fn forget(&mut self, cell: Cell) {
        if let Some(number) = self.number_of(cell)
            && let Some(tile) = self.tiles.get_mut(number)
            && tile.moments.get(cell.slot()).is_some()
        {
            tile.moments.set(cell.slot(), None);
            tile.changed |= 1 << cell.slot();
        }
    }

    /// Lays the lines anew of all cells in whose window of three by three cells points have changed, by
    /// `fit`, which is given the cell's column and row in its tile.
    pub fn fit_changed(&mut self, fit: impl Fn(&Around<'_>, i32, i32) -> Line) {
        // 1. The cells that are due, in the changed ones' tiles and beside them.
        for number in 0..self.tiles.len() {
            let Some(tile) = self.tiles.get_mut(number) else {
                continue;
            };
            let (x, y, changed) = (tile.x, tile.y, std::mem::take(&mut tile.changed));
            if changed == 0 {
                continue;
            }
            for (y, row) in (y - 1..).zip(spread(changed)) {
                for (x, due) in (x - 1..).zip(row) {
                    if due != 0
                        && let Some(number) = self.number(x, y)
                        && let Some(tile) = self.tiles.get_mut(number)
                    {
                        tile.due |= due;
                    }
                }
            }
        }
        // 2. Their lines.
        for number in 0..self.tiles.len() {
            let Some(tile) = self.tiles.get_mut(number).filter(|tile| tile.due != 0) else {
                continue;
            };
            let (x, y, due) = (tile.x, tile.y, std::mem::take(&mut tile.due));
            let mut lines = std::mem::take(&mut tile.lines);
            let around = self.around(x, y);
            for slot in slots(due) {
                let (column, row) = (slot & (TILE_EDGE - 1), slot / TILE_EDGE);
                let line = fit(&around, column as i32, row as i32);
                lines.set(slot, line.exists().then_some(line));
            }
            if let Some(tile) = self.tiles.get_mut(number) {
                tile.lines = lines;
            }
        }
    }

    /// The points of a tile and beside it.
    fn around(&self, x: i32, y: i32) -> Around<'_> {
        let mut around = Around([[None; EDGE]; EDGE]);
        for (tile_y, rows) in [(y - 1, -TILE_CELLS), (y, 0), (y + 1, TILE_CELLS)] {
            for (tile_x, columns) in [(x - 1, -TILE_CELLS), (x, 0), (x + 1, TILE_CELLS)] {
                let number = self.number(tile_x, tile_y);
                let Some(tile) = number.and_then(|number| self.tiles.get(number)) else {
                    continue;
                };
                for (slot, moments) in tile.moments.iter() {
                    let row = rows + (slot / TILE_EDGE) as i32 + MARGIN;
                    let column = columns + (slot % TILE_EDGE) as i32 + MARGIN;
                    if let Some(cells) = around.0.get_mut(row as usize)
                        && let Some(cell) = cells.get_mut(column as usize)
                    {
                        *cell = Some(moments);
                    }
                }
            }
        }
        around
    }

    fn number_or_new(&mut self, cell: Cell, update: u32) -> Option<usize> {
        let (x, y) = (cell.x >> TILE_SHIFT, cell.y >> TILE_SHIFT);
        if let Some(number) = self.number(x, y) {
            if let Some(tile) = self.tiles.get_mut(number)
                && (tile.x, tile.y) == (x, y)
            {
                tile.last_update = update;
                return Some(number);
            }
            self.drop_tile(number);
        }
        if self.tiles.len() >= TILES_MAX {
            let tiles = self.tiles.iter().enumerate();
            let (oldest, _) = tiles.min_by_key(|(_, tile)| tile.last_update)?;
            self.drop_tile(oldest);
        }
        self.table.resize((TABLE_TILES * TABLE_TILES) as usize, 0);
        if self.tiles.len() == self.tiles.capacity() {
            // Never more than the pool may hold: doubling would.
            let more = self.tiles.len().max(TILES_AT_START);
            self.tiles
                .reserve_exact(more.min(TILES_MAX - self.tiles.len()));
        }
        self.tiles.push(Tile {
            x,
            y,
            last_update: update,
            changed: 0,
            due: 0,
            lines: TileCells::default(),
            moments: TileCells::default(),
        });
        let number = self.tiles.len();
        *self.table.get_mut(table_index(x, y))? = number as u16;
        Some(number - 1)
    }

    /// Drops the tiles that are far from `centre`.
    pub fn drop_far(&mut self, centre: Cell) {
        let (x, y) = (centre.x >> TILE_SHIFT, centre.y >> TILE_SHIFT);
        let mut number = 0;
        while let Some(tile) = self.tiles.get(number) {
            let distance = (tile.x - x).abs().max((tile.y - y).abs());
            if distance > TILE_DISTANCE_MAX {
                self.drop_tile(number);
            } else {
                number += 1;
            }
        }
    }

    /// Drops a tile; the last one takes its number.
    fn drop_tile(&mut self, number: usize) {
        let tile = self.tiles.swap_remove(number);
        if let Some(slot) = self.table.get_mut(table_index(tile.x, tile.y)) {
            *slot = 0;
        }
        if let Some(moved) = self.tiles.get(number)
            && let Some(slot) = self.table.get_mut(table_index(moved.x, moved.y))
        {
            *slot = number as u16 + 1;
        }
    }

    /// Calls `visit` with each cell that holds points.
    pub fn for_each_occupied(&self, mut visit: impl FnMut(Cell)) {
        for tile in &self.tiles {
            for slot in slots(tile.moments.filled()) {
                visit(Cell {
                    x: (tile.x << TILE_SHIFT) + (slot & (TILE_EDGE - 1)) as i32,
                    y: (tile.y << TILE_SHIFT) + (slot / TILE_EDGE) as i32,
                });
            }
        }
    }
}
