//! The local map: a table of 10 cm cells, each with the line through the points around it.
//!
//! Cells live in tiles of 8 × 8; a toroidal table of tile numbers covers ±100 m around the LiDAR,
//! so finding a point's line is two array reads. Tiles are a fixed pool: the one unseen longest
//! makes room. That bounds the memory whatever the route.

mod free_space;
mod surfel;

pub use free_space::{FreeSpace, RAY_STRIDE};
pub use surfel::{Line, LineQuality, Moments, WindowMoments};

/// Edge of a cell, m.
pub const CELL_M: f64 = 0.1;
const CELL: f32 = CELL_M as f32;
const CELLS_PER_M: f32 = 1.0 / CELL;
const TILE_SHIFT: i32 = 3;
const TILE_CELLS: i32 = 1 << TILE_SHIFT;
const CELLS_IN_TILE: usize = (TILE_CELLS * TILE_CELLS) as usize;
/// Edge of the table of tiles.
const TABLE_TILES: i32 = 256;
/// Most tiles: 64 cells of 52 bytes each, 2.9 MiB in all.
pub const TILES_MAX: usize = 900;
/// Tiles farther from the LiDAR are dropped, in tiles (80 m).
const TILE_DISTANCE_MAX: i32 = 100;
/// Added before truncation, so that it rounds down: cells from the local origin to the table's rim.
const BIAS: i32 = TABLE_TILES / 2 * TILE_CELLS;

/// A window of cells with fewer points is looked at more widely.
const SPARSE_POINTS: f32 = 8.0;

/// A cell of the odometry frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cell {
    /// Column.
    pub x: i32,
    /// Row.
    pub y: i32,
}

/// Where single-precision coordinates are measured from: a tile's corner near the LiDAR, so that
/// they stay exact to micrometres after any distance.
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
        let column = (x * CELLS_PER_M + BIAS as f32) as i32 - BIAS;
        let row = (y * CELLS_PER_M + BIAS as f32) as i32 - BIAS;
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

#[derive(Debug, Clone, Copy)]
struct TileHeader {
    x: i32,
    y: i32,
    last_update: u32,
}

/// The local map.
#[derive(Debug, Clone)]
pub struct Submap {
    /// Tile number plus one at (y mod 256, x mod 256); 0: none.
    table: Vec<u16>,
    headers: Vec<TileHeader>,
    lines: Vec<[Line; CELLS_IN_TILE]>,
    moments: Vec<[Moments; CELLS_IN_TILE]>,
    updates: u32,
    to_fit: Vec<Cell>,
    quality: LineQuality,
    /// Of a cell on its own.
    quality_alone: LineQuality,
}

impl Default for Submap {
    fn default() -> Self {
        let quality = LineQuality {
            points_min: 3.0,
            across_max_m2: 2.5e-3,
            along_min_m2: 1e-3,
            ratio_max: 0.2,
            noise_floor_m2: 2.5e-5,
            sightings_min: 1,
        };
        let quality_alone = LineQuality {
            points_min: 6.0,
            along_min_m2: 2e-4,
            ratio_max: 0.3,
            ..quality
        };
        Self {
            table: vec![0; (TABLE_TILES * TABLE_TILES) as usize],
            headers: Vec::new(),
            lines: Vec::new(),
            moments: Vec::new(),
            updates: 0,
            to_fit: Vec::new(),
            quality,
            quality_alone,
        }
    }
}

fn table_index(tile_x: i32, tile_y: i32) -> usize {
    ((tile_y & (TABLE_TILES - 1)) * TABLE_TILES + (tile_x & (TABLE_TILES - 1))) as usize
}

fn cell_in_tile(cell: Cell) -> usize {
    (((cell.y & (TILE_CELLS - 1)) << TILE_SHIFT) | (cell.x & (TILE_CELLS - 1))) as usize
}

impl Submap {
    /// Empties the map.
    pub fn clear(&mut self) {
        self.table.fill(0);
        self.headers.clear();
        self.lines.clear();
        self.moments.clear();
        self.updates = 0;
    }

    /// Number of map updates so far.
    pub fn updates(&self) -> u32 {
        self.updates
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        self.table.capacity() * size_of::<u16>()
            + self.headers.capacity() * size_of::<TileHeader>()
            + self.lines.capacity() * size_of::<[Line; CELLS_IN_TILE]>()
            + self.moments.capacity() * size_of::<[Moments; CELLS_IN_TILE]>()
            + self.to_fit.capacity() * size_of::<Cell>()
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
            .and_then(|tile| self.lines.get(tile)?.get(cell_in_tile(cell)).copied())
            .unwrap_or(Line::NONE)
    }

    fn moments(&self, cell: Cell) -> Option<&Moments> {
        let tile = self.tile_of(cell)?;
        self.moments
            .get(tile)?
            .get(cell_in_tile(cell))
            .filter(|moments| moments.n > 0.0)
    }

    /// Begins a map update made with the LiDAR at `centre`: far tiles go.
    pub fn begin_update(&mut self, centre: Cell, range_noise_m: f32) {
        self.updates += 1;
        // A line may look as thick as the noise makes it, and no thicker than clutter.
        self.quality.across_max_m2 = (1.6 * range_noise_m).clamp(0.015, 0.06).powi(2);
        self.quality.noise_floor_m2 = (0.7 * range_noise_m).powi(2);
        self.quality.sightings_min = self.updates.min(3) as u16;
        self.quality_alone = LineQuality {
            points_min: self.quality_alone.points_min,
            along_min_m2: self.quality_alone.along_min_m2,
            ratio_max: self.quality_alone.ratio_max,
            ..self.quality
        };
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

    /// Adds a point given from `origin`.
    pub fn insert(&mut self, origin: LocalOrigin, x: f32, y: f32, weight: f32) {
        let (cell, x, y) = origin.locate(x, y);
        let update = self.updates as u16;
        let Some(tile) = self.tile_or_new(cell) else {
            return;
        };
        if let Some(moments) = self
            .moments
            .get_mut(tile)
            .and_then(|cells| cells.get_mut(cell_in_tile(cell)))
            && moments.add(x, y, weight, update)
        {
            self.to_fit.push(cell);
        }
    }

    /// Ends the update: fits the lines around every cell that changed.
    pub fn end_update(&mut self) {
        let mut changed = std::mem::take(&mut self.to_fit);
        for &Cell { x, y } in &changed {
            for dy in -1..=1 {
                for dx in -1..=1 {
                    self.refit(Cell {
                        x: x + dx,
                        y: y + dy,
                    });
                }
            }
        }
        changed.clear();
        self.to_fit = changed;
    }

    /// Fits a cell's line, once in an update.
    fn refit(&mut self, cell: Cell) {
        let (Some(tile), slot) = (self.tile_of(cell), cell_in_tile(cell)) else {
            return;
        };
        let Some(moments) = self
            .moments
            .get_mut(tile)
            .and_then(|cells| cells.get_mut(slot))
        else {
            return;
        };
        if moments.last_fit == self.updates {
            return;
        }
        moments.last_fit = self.updates;
        let line = self.fit(cell);
        if let Some(old) = self
            .lines
            .get_mut(tile)
            .and_then(|cells| cells.get_mut(slot))
        {
            *old = line;
        }
    }

    /// Forgets what was seen in a cell: a beam went through it.
    pub fn forget(&mut self, cell: Cell) {
        if let Some(tile) = self.tile_of(cell) {
            let slot = cell_in_tile(cell);
            if let Some(moments) = self
                .moments
                .get_mut(tile)
                .and_then(|cells| cells.get_mut(slot))
                && moments.n > 0.0
            {
                *moments = Moments {
                    last_fit: moments.last_fit,
                    ..Moments::default()
                };
                self.to_fit.push(cell);
            }
        }
    }

    fn fit(&self, cell: Cell) -> Line {
        let mut window = WindowMoments::default();
        self.gather(cell, 1, &mut window);
        if window.count() < 0.5 {
            return Line::NONE;
        }
        let line = window.line(&self.quality);
        if line.exists() {
            return line;
        }
        // Clutter or a corner: the cell alone may still show a line. Few points: a wider look may.
        let is_sparse = window.count() < SPARSE_POINTS;
        let mut other = WindowMoments::default();
        self.gather(cell, if is_sparse { 2 } else { 0 }, &mut other);
        other.line(if is_sparse {
            &self.quality
        } else {
            &self.quality_alone
        })
    }

    fn gather(&self, cell: Cell, reach: i32, window: &mut WindowMoments) {
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                if let Some(moments) = self.moments(Cell {
                    x: cell.x + dx,
                    y: cell.y + dy,
                }) {
                    window.add(moments, dx as f32 * CELL, dy as f32 * CELL);
                }
            }
        }
    }

    fn tile_or_new(&mut self, cell: Cell) -> Option<usize> {
        let (x, y) = (cell.x >> TILE_SHIFT, cell.y >> TILE_SHIFT);
        if let Some(tile) = self.tile_of(cell) {
            if let Some(header) = self.headers.get_mut(tile)
                && (header.x, header.y) == (x, y)
            {
                header.last_update = self.updates;
                return Some(tile);
            }
            self.drop_tile(tile);
        }
        if self.headers.len() >= TILES_MAX {
            let oldest = (0..self.headers.len())
                .min_by_key(|&tile| self.headers.get(tile).map_or(0, |h| h.last_update))?;
            self.drop_tile(oldest);
        }
        self.headers.push(TileHeader {
            x,
            y,
            last_update: self.updates,
        });
        self.lines.push([Line::NONE; CELLS_IN_TILE]);
        self.moments.push([Moments::default(); CELLS_IN_TILE]);
        let number = self.headers.len();
        *self.table.get_mut(table_index(x, y))? = number as u16;
        Some(number - 1)
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall along y at `x_m`, seen a few times.
    fn wall_at(submap: &mut Submap, x_m: f64, y_m: f64) -> LocalOrigin {
        let origin = LocalOrigin::near(x_m, y_m);
        let (ox, oy) = origin.position_m();
        let (x, y) = ((x_m - ox) as f32, (y_m - oy) as f32);
        for update in 0..4 {
            submap.begin_update(origin.locate(x, y).0, 0.015);
            for i in 0..60 {
                submap.insert(origin, x, y + 0.01 * i as f32, 1.0);
                submap.insert(origin, x, y + 0.01 * i as f32 + 0.002 * update as f32, 1.0);
            }
            submap.end_update();
        }
        origin
    }

    #[test]
    fn a_wall_is_where_it_is_a_thousand_kilometres_from_the_start_too() {
        for x_m in [0.0437, -12.3437, 1.0e6 + 0.0437] {
            let mut submap = Submap::default();
            let origin = wall_at(&mut submap, x_m, -3.0);
            let (ox, oy) = origin.position_m();
            // A point 3 cm to the right of the wall.
            let (cell, cx, cy) = origin.locate((x_m + 0.03 - ox) as f32, (-2.7 - oy) as f32);
            let line = submap.line(cell);
            assert!(line.exists());
            let distance = (line.nx * cx + line.ny * cy - line.d).abs();
            assert!((distance - 0.03).abs() < 1e-4, "{distance} at {x_m}");
        }
    }

    #[test]
    fn the_pool_of_tiles_is_bounded_and_the_latest_stay() {
        let mut submap = Submap::default();
        for i in 0..1500 {
            wall_at(
                &mut submap,
                1.7 * f64::from(i % 100),
                1.7 * f64::from(i / 100),
            );
        }
        assert!(submap.headers.len() <= TILES_MAX);
        assert!(submap.memory_bytes() < 7 << 19, "{}", submap.memory_bytes());
        let origin = LocalOrigin::near(1.7 * 99.0, 1.7 * 14.0);
        let (ox, oy) = origin.position_m();
        let (cell, _, _) = origin.locate((1.7 * 99.0 - ox) as f32, (1.7 * 14.0 + 0.3 - oy) as f32);
        assert!(submap.line(cell).exists());
    }

    #[test]
    fn tiles_far_behind_are_dropped() {
        let mut submap = Submap::default();
        let origin = wall_at(&mut submap, 0.0, 0.0);
        wall_at(&mut submap, 60.0, 0.0);
        assert!(submap.line(origin.locate(0.01, 0.3).0).exists());
        wall_at(&mut submap, 120.0, 0.0);
        assert!(!submap.line(origin.locate(0.01, 0.3).0).exists());
    }
}
