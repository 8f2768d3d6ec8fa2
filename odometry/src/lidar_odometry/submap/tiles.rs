//! The pool of tiles that the local map lives in.
//!
//! A toroidal table of tile numbers covers ±100 m around the LiDAR, so finding a cell is two array
//! reads. Tiles are a fixed pool: the one unseen longest makes room. That bounds the memory
//! whatever the route.

use super::cell::{CELLS_IN_TILE, Cell, TABLE_TILES, TILE_CELLS, TILE_SHIFT};
use super::surfel::{Line, Moments};

/// Most tiles: 64 cells of 60 bytes each, 3.3 MiB in all.
pub const TILES_MAX: usize = 900;
/// Tiles that memory is reserved for at first.
const TILES_AT_START: usize = 64;
/// Largest distance of a tile from the LiDAR, in tiles (80 m); farther ones are dropped.
const TILE_DISTANCE_MAX: i32 = 100;

/// The points of a square of cells, row by row, where they have any.
pub type Neighbours<'a, const EDGE: usize> = [[Option<&'a Moments>; EDGE]; EDGE];

#[derive(Debug, Clone, Copy)]
struct TileHeader {
    x: i32,
    y: i32,
    last_update: u32,
}

/// Tiles of 8 × 8 cells, each cell with its points and its line.
#[derive(Debug, Clone, Default)]
pub struct TilePool {
    /// Tile number plus one at (y mod 256, x mod 256); 0: none. Empty until the first tile.
    table: Vec<u16>,
    headers: Vec<TileHeader>,
    lines: Vec<[Line; CELLS_IN_TILE]>,
    moments: Vec<[Moments; CELLS_IN_TILE]>,
}

fn table_index(tile_x: i32, tile_y: i32) -> usize {
    ((tile_y & (TABLE_TILES - 1)) * TABLE_TILES + (tile_x & (TABLE_TILES - 1))) as usize
}

impl TilePool {
    /// Empties the pool.
    pub fn clear(&mut self) {
        self.table.fill(0);
        self.headers.clear();
        self.lines.clear();
        self.moments.clear();
    }

    /// Number of tiles in use.
    #[cfg(test)]
    pub fn len(&self) -> usize {
        self.headers.len()
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        self.table.capacity() * size_of::<u16>()
            + self.headers.capacity() * size_of::<TileHeader>()
            + self.lines.capacity() * size_of::<[Line; CELLS_IN_TILE]>()
            + self.moments.capacity() * size_of::<[Moments; CELLS_IN_TILE]>()
    }

    #[inline]
    fn tile_of(&self, cell: Cell) -> Option<usize> {
        let number = *self
            .table
            .get(table_index(cell.x >> TILE_SHIFT, cell.y >> TILE_SHIFT))?
            as usize;
        number.checked_sub(1)
    }

    /// The line of a cell.
    #[inline]
    pub fn line(&self, cell: Cell) -> Line {
        self.tile_of(cell)
            .and_then(|tile| self.lines.get(tile)?.get(cell.slot()).copied())
            .unwrap_or(Line::NONE)
    }

    /// Sets the line of a cell, where the cell has a tile.
    pub fn set_line(&mut self, cell: Cell, line: Line) {
        if let Some(tile) = self.tile_of(cell)
            && let Some(old) = self
                .lines
                .get_mut(tile)
                .and_then(|cells| cells.get_mut(cell.slot()))
        {
            *old = line;
        }
    }

    /// The points of a cell and of those around it.
    pub fn around<const EDGE: usize>(&self, cell: Cell) -> Neighbours<'_, EDGE> {
        let corner = EDGE as i32 / 2;
        let mut around = [[None; EDGE]; EDGE];
        // Most lie in one tile.
        let mut last = None;
        for (y, row) in (cell.y - corner..).zip(&mut around) {
            for (x, moments) in (cell.x - corner..).zip(row) {
                let tile = (x >> TILE_SHIFT, y >> TILE_SHIFT);
                let cells = match last {
                    Some((of, cells)) if of == tile => cells,
                    _ => self
                        .tile_of(Cell { x, y })
                        .and_then(|tile| self.moments.get(tile)),
                };
                last = Some((tile, cells));
                *moments = cells
                    .and_then(|cells| cells.get(Cell { x, y }.slot()))
                    .filter(|moments| moments.n > 0.0);
            }
        }
        around
    }

    /// Points of a cell, where it has a tile.
    #[inline]
    pub fn moments_mut(&mut self, cell: Cell) -> Option<&mut Moments> {
        let tile = self.tile_of(cell)?;
        self.moments.get_mut(tile)?.get_mut(cell.slot())
    }

    /// Points of a cell, in a new tile if need be; the update is noted on the tile.
    #[inline]
    pub fn moments_or_new(&mut self, cell: Cell, update: u32) -> Option<&mut Moments> {
        let tile = self.tile_or_new(cell, update)?;
        self.moments.get_mut(tile)?.get_mut(cell.slot())
    }

    fn tile_or_new(&mut self, cell: Cell, update: u32) -> Option<usize> {
        let (x, y) = (cell.x >> TILE_SHIFT, cell.y >> TILE_SHIFT);
        if let Some(tile) = self.tile_of(cell) {
            if let Some(header) = self.headers.get_mut(tile)
                && (header.x, header.y) == (x, y)
            {
                header.last_update = update;
                return Some(tile);
            }
            self.drop_tile(tile);
        }
        if self.headers.len() >= TILES_MAX {
            let oldest = (0..self.headers.len())
                .min_by_key(|&tile| self.headers.get(tile).map_or(0, |h| h.last_update))?;
            self.drop_tile(oldest);
        }
        self.table.resize((TABLE_TILES * TABLE_TILES) as usize, 0);
        if self.headers.len() == self.headers.capacity() {
            // Never more than the pool may hold: doubling would.
            let more = self.headers.len().max(TILES_AT_START);
            let more = more.min(TILES_MAX - self.headers.len());
            self.headers.reserve_exact(more);
            self.lines.reserve_exact(more);
            self.moments.reserve_exact(more);
        }
        self.headers.push(TileHeader {
            x,
            y,
            last_update: update,
        });
        self.lines.push([Line::NONE; CELLS_IN_TILE]);
        self.moments.push([Moments::default(); CELLS_IN_TILE]);
        let number = self.headers.len();
        *self.table.get_mut(table_index(x, y))? = number as u16;
        Some(number - 1)
    }

    /// Drops the tiles that are far from `centre`.
    pub fn drop_far(&mut self, centre: Cell) {
        let (x, y) = (centre.x >> TILE_SHIFT, centre.y >> TILE_SHIFT);
        let mut tile = 0;
        while let Some(header) = self.headers.get(tile).copied() {
            let distance = (header.x - x).abs().max((header.y - y).abs());
            if distance > TILE_DISTANCE_MAX {
                self.drop_tile(tile);
            } else {
                tile += 1;
            }
        }
    }

    /// Drops a tile; the last one takes its number.
    fn drop_tile(&mut self, tile: usize) {
        let header = self.headers.swap_remove(tile);
        self.lines.swap_remove(tile);
        self.moments.swap_remove(tile);
        if let Some(slot) = self.table.get_mut(table_index(header.x, header.y)) {
            *slot = 0;
        }
        if let Some(moved) = self.headers.get(tile)
            && let Some(slot) = self.table.get_mut(table_index(moved.x, moved.y))
        {
            *slot = tile as u16 + 1;
        }
    }

    /// Calls `visit` with each cell that holds points.
    pub fn for_each_occupied(&self, mut visit: impl FnMut(Cell)) {
        for (header, cells) in self.headers.iter().zip(&self.moments) {
            for (slot, moments) in (0i32..).zip(cells) {
                if moments.n > 0.0 {
                    let x = (header.x << TILE_SHIFT) + (slot & (TILE_CELLS - 1));
                    let y = (header.y << TILE_SHIFT) + (slot >> TILE_SHIFT);
                    visit(Cell { x, y });
                }
            }
        }
    }
}
