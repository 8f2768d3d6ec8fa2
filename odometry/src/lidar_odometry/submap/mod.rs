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

use std::ops::Range;
use std::sync::Arc;

pub use cell::{CELL_M, Cell, LocalOrigin};
pub use free_space::{FreeSpace, RAY_STRIDE};
pub use known_map::KnownMap;
pub use surfel::{Fitted, Line, LineQuality, Moments, WindowMoments};

use cell::CELL;
use tiles::{Around, TilePool, points_at};

/// Fewest points of a window of cells; of fewer, a wider window is used.
const SPARSE_POINTS: f32 = 8.0;

/// Edge of the window of cells that a line is laid through,
const NEAR: usize = 3;
/// and of the wider one.
const WIDE: usize = 5;

/// A window of three by three cells without one of its sides: columns and rows.
const WITHOUT_A_SIDE: [(Range<usize>, Range<usize>); 4] =
    [(0..2, 0..3), (1..3, 0..3), (0..3, 0..2), (0..3, 1..3)];

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

/// The line of a cell, by its column and row in the middle one of nine tiles.
fn fit(
    around: &Around<'_>,
    x: i32,
    y: i32,
    quality: &LineQuality,
    quality_alone: &LineQuality,
) -> Line {
    let near = window::<NEAR>(around, x, y);
    let all = gathered(&near, 0..NEAR, 0..NEAR);
    if all.count() < 0.5 {
        return Line::NONE;
    }
    if let Some(whole) = all.fit(quality) {
        return without_corner(&near, &whole, quality).unwrap_or(whole.line);
    }
    // Clutter or a corner: the cell alone may still show a line. Few points: a wider look may.
    if all.count() < SPARSE_POINTS {
        gathered(&window::<WIDE>(around, x, y), 0..WIDE, 0..WIDE).line(quality)
    } else {
        gathered(&near, 1..2, 1..2).line(quality_alone)
    }
}

/// The line through a window less the side on which another surface begins, where there is one:
/// without it the points scatter less across their line, and more so than by chance.
///
/// Corners of boxes stick out, so that lines laid around them lie too far back, and a scan
/// compared with those looks too small. A rolling scan shows that as a motion to its side: its
/// turns came out displaced by 0.4 mm a radian.
fn without_corner(near: &Window<NEAR>, whole: &Fitted, quality: &LineQuality) -> Option<Line> {
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

/// Cells around a middle one, row by row, each with its points about the middle one's centre.
type Window<const EDGE: usize> = [[WindowMoments; EDGE]; EDGE];

/// The window around a cell.
fn window<const EDGE: usize>(around: &Around<'_>, x: i32, y: i32) -> Window<EDGE> {
    let middle = EDGE as i32 / 2;
    let mut window = [[WindowMoments::default(); EDGE]; EDGE];
    for (row, cells) in (-middle..).zip(&mut window) {
        for (column, cell) in (-middle..).zip(cells) {
            if let Some(moments) = points_at(around, x + column, y + row) {
                *cell = WindowMoments::of(moments, column as f32 * CELL, row as f32 * CELL);
            }
        }
    }
    window
}

/// The points in some columns and rows of a window.
#[inline]
fn gathered<const EDGE: usize>(
    window: &Window<EDGE>,
    columns: Range<usize>,
    rows: Range<usize>,
) -> WindowMoments {
    let mut sum = WindowMoments::default();
    for cells in &window[rows] {
        for cell in &cells[columns.clone()] {
            sum.add(cell);
        }
    }
    sum
}
