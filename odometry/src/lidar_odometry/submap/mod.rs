//! The map that scans are aligned with: a table of 10 cm cells, each with the line through the
//! points around it.
//!
//! What the LiDAR has seen lies in a bounded pool of tiles around it. Where a known map is given,
//! its lines stand first: they never change and never make room.

mod cell;
mod edges;
mod free_space;
mod known_map;
mod surfel;
#[cfg(test)]
mod tests;
mod tile_cells;
mod tiles;

use std::ops::RangeInclusive;
use std::sync::Arc;

pub use cell::{CELL_M, Cell, LocalOrigin};
pub use free_space::{FreeSpace, RAY_STRIDE};
pub use known_map::KnownMap;
pub use surfel::{Fitted, Line, LineQuality, WindowMoments};

use cell::CELL;
use tiles::{Around, TilePool};

/// Fewest points of a window of cells; of fewer, a wider window is used.
const SPARSE_POINTS: f32 = 8.0;

/// Edge of the window of cells that a line is laid through,
const NEAR: usize = 3;
/// and of the wider one.
const WIDE: usize = 5;

/// A window of three by three cells without one of its sides: columns and rows from the middle.
const WITHOUT_A_SIDE: [(RangeInclusive<i32>, RangeInclusive<i32>); 4] = [
    (-1..=0, -1..=1),
    (0..=1, -1..=1),
    (-1..=1, -1..=0),
    (-1..=1, 0..=1),
];

/// The map.
#[derive(Debug, Clone)]
pub struct Submap {
    tiles: TilePool,
    known: Option<Arc<KnownMap>>,
    updates: u32,
    quality: LineQuality,
    /// Quality that a line of one cell alone needs.
    quality_alone: LineQuality,
}

impl Default for Submap {
    fn default() -> Self {
        let quality = LineQuality {
            points_min: 3.0,
            across_max_m2: 2.5e-3,
            along_min_m2: 1e-3,
            ratio_max: 0.2,
            noise_m2: 4e-4,
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
            tiles: TilePool::default(),
            known: None,
            updates: 0,
            quality,
            quality_alone,
        }
    }
}

impl Submap {
    /// Begins a map that holds only the known one.
    pub fn knowing(known: Arc<KnownMap>) -> Self {
        Self {
            known: Some(known),
            ..Self::default()
        }
    }

    /// Forgets everything that was seen; the known map stays.
    pub fn clear(&mut self) {
        self.tiles.clear();
        self.updates = 0;
    }

    /// Known map, where one was given.
    pub fn known(&self) -> Option<&KnownMap> {
        self.known.as_deref()
    }

    /// Number of map updates so far.
    pub fn updates(&self) -> u32 {
        self.updates
    }

    /// Bytes held, without the known map, which robots share.
    pub fn memory_bytes(&self) -> usize {
        self.tiles.memory_bytes()
    }

    /// The line of a cell: the known one, else the one that was seen.
    #[inline]
    pub fn line(&self, cell: Cell) -> Line {
        if let Some(known) = &self.known {
            let line = known.line(cell);
            if line.exists() {
                return line;
            }
        }
        self.tiles.line(cell)
    }

    /// Begins a map update made with the LiDAR at `centre`: drops far tiles.
    pub fn begin_update(&mut self, centre: Cell, range_noise_m: f32) {
        self.updates += 1;
        // A line may look as thick as the noise makes it, and no thicker than clutter.
        self.quality.across_max_m2 = (1.6 * range_noise_m).clamp(0.015, 0.06).powi(2);
        self.quality.noise_m2 = range_noise_m.powi(2);
        self.quality.noise_floor_m2 = (0.7 * range_noise_m).powi(2);
        self.quality.sightings_min = self.updates.min(3) as u16;
        self.quality_alone = LineQuality {
            points_min: self.quality_alone.points_min,
            along_min_m2: self.quality_alone.along_min_m2,
            ratio_max: self.quality_alone.ratio_max,
            ..self.quality
        };
        self.tiles.drop_far(centre);
    }

    /// Adds a point given from `origin` and seen in a direction, unless it lies on the known map.
    pub fn insert(
        &mut self,
        origin: LocalOrigin,
        (x, y): (f32, f32),
        direction: (f32, f32),
        weight: f32,
    ) {
        let (cell, x, y) = origin.locate(x, y);
        if self.known().is_some_and(|known| known.line(cell).exists()) {
            return;
        }
        self.tiles
            .add(cell, (x, y), direction, weight, self.updates);
    }

    /// Forgets the points of a cell: a beam went through it.
    pub fn forget(&mut self, cell: Cell) {
        self.tiles.forget(cell);
    }

    /// Ends the update: fits the lines around every cell that changed.
    pub fn end_update(&mut self) {
        let Self {
            tiles,
            quality,
            quality_alone,
            ..
        } = self;
        tiles.fit_changed(|around, x, y| fit(around, x, y, quality, quality_alone));
    }

    /// Calls `visit` with each occupied cell at most `reach` cells from `centre` in x and y, and
    /// perhaps some that lie farther away.
    pub fn for_each_occupied(&self, centre: Cell, reach: i32, mut visit: impl FnMut(Cell)) {
        if let Some(known) = &self.known {
            known.for_each_occupied(centre, reach, &mut visit);
        }
        self.tiles.for_each_occupied(visit);
    }
}

/// The line of a cell, by its column and row in its tile.
fn fit(
    around: &Around<'_>,
    x: i32,
    y: i32,
    quality: &LineQuality,
    quality_alone: &LineQuality,
) -> Line {
    let mut near = [(0, 0, WindowMoments::default()); NEAR * NEAR];
    let near = window(around, x, y, 1, &mut near);
    let all = gathered(near, -1..=1, -1..=1);
    if near.is_empty() || all.count() < 0.5 {
        return Line::NONE;
    }
    if let Some(whole) = all.fit(quality) {
        return without_corner(near, &whole, quality).unwrap_or(whole.line);
    }
    // Clutter or a corner: the cell alone may still show a line. Few points: a wider look may.
    if all.count() < SPARSE_POINTS {
        let mut wide = [(0, 0, WindowMoments::default()); WIDE * WIDE];
        let wide = window(around, x, y, 2, &mut wide);
        gathered(wide, -2..=2, -2..=2).line(quality)
    } else {
        gathered(near, 0..=0, 0..=0).line(quality_alone)
    }
}

/// The line through a window less the side on which another surface begins, where there is one:
/// without it the points scatter less across their line, and more so than by chance.
///
/// Corners of boxes stick out, so that lines laid around them lie too far back, and a scan
/// compared with those looks too small. A rolling scan shows that as a motion to its side: its
/// turns came out displaced by 0.4 mm a radian.
fn without_corner(near: &[Near], whole: &Fitted, quality: &LineQuality) -> Option<Line> {
    if whole.across_m2 < quality.noise_m2 {
        return None;
    }
    let (mut best, mut least_m2) = (None, whole.across_m2);
    for (columns, rows) in WITHOUT_A_SIDE {
        let part = gathered(near, columns, rows);
        if let Some(part) = part.fit(quality)
            && part.across_at_most_m2() < least_m2
        {
            least_m2 = part.across_at_most_m2();
            best = Some(part.line);
        }
    }
    best
}

/// A cell of a window with points: its column and row from the middle, and the points about the middle's centre.
type Near = (i32, i32, WindowMoments);

/// The cells with points at most `reach` columns and rows from one, row by row.
fn window<'a>(
    around: &Around<'_>,
    x: i32,
    y: i32,
    reach: i32,
    cells: &'a mut [Near],
) -> &'a [Near] {
    let mut count = 0;
    for row in -reach..=reach {
        for column in -reach..=reach {
            if let Some(moments) = around.points(x + column, y + row)
                && let Some(cell) = cells.get_mut(count)
            {
                let moments = WindowMoments::of(moments, column as f32 * CELL, row as f32 * CELL);
                *cell = (column, row, moments);
                count += 1;
            }
        }
    }
    cells.get(..count).unwrap_or_default()
}

/// The points in some columns and rows of a window.
#[inline]
fn gathered(
    window: &[Near],
    columns: RangeInclusive<i32>,
    rows: RangeInclusive<i32>,
) -> WindowMoments {
    let mut sum = WindowMoments::default();
    for (column, row, moments) in window {
        if columns.contains(column) && rows.contains(row) {
            sum.add(moments);
        }
    }
    sum
}
