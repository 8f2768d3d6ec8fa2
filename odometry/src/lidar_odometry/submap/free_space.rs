//! Free space that was seen: objects that appear there later move (a person, another robot).

use std::ops::Range;

use super::{CELL_M, Cell, KnownMap, LocalOrigin, Submap};

/// Edge of a cell of the grid, in cells of the map.
const SCALE_SHIFT: i32 = 1;
const FREE_CELL: f32 = (CELL_M * (1 << SCALE_SHIFT) as f64) as f32;
/// Edge of the grid, in its cells: ±25 m around the LiDAR.
const GRID: i32 = 256;
/// Length at which rays end, m: beyond, too few pass to decide.
const RAY_MAX_M: f32 = 20.0;
/// Distance of a ray's end from the surface that it hits, measured across the surface, m.
const BEFORE_SURFACE_M: f32 = 0.3;
/// Least cosine of incidence that this distance is divided by.
const COS_INCIDENCE_MIN: f32 = 0.05;
/// Stride of the beams that mark free space.
pub const RAY_STRIDE: usize = 4;
/// Evidence that returns in a cell add, once in an update; each ray through it subtracts one.
const HIT: i8 = 2;
const EVIDENCE_MAX: i8 = 10;
const EVIDENCE_MIN: i8 = -40;
/// Largest evidence of a cell in which a return is a moving object's.
const FREE: i8 = -5;
/// Evidence at which the map's content of a cell is forgotten.
const FORGET: i8 = -8;
/// Evidence of a cell that a known map holds free: an object there becomes a surface only after a
/// while.
const KNOWN_FREE: i8 = -15;

/// Evidence for and against a surface, on a grid that rolls along with the LiDAR.
#[derive(Debug, Clone, Default)]
pub struct FreeSpace {
    /// Empty until the first update: most registered robots of a fleet do not drive.
    evidence: Vec<i8>,
    /// The update (its low byte) in which a cell was hit last.
    hit_in: Vec<u8>,
    update: u8,
    /// Lowest cell of the grid.
    low: Option<Cell>,
}

impl FreeSpace {
    /// Forgets everything.
    pub fn clear(&mut self) {
        self.evidence.fill(0);
        self.low = None;
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        self.evidence.capacity() + self.hit_in.capacity()
    }

    #[inline]
    fn slot(&self, cell: Cell) -> Option<usize> {
        slot_of(self.low?, cell)
    }

    /// True if a return in this cell is a moving object's.
    #[inline]
    pub fn was_free(&self, cell: Cell) -> bool {
        self.slot(cell)
            .and_then(|slot| self.evidence.get(slot))
            .is_some_and(|&e| e <= FREE)
    }

    /// Begins an update: moves the grid so that `centre` lies in its middle part. Cells that enter
    /// are as free as in the known map.
    pub fn begin_update(&mut self, centre: Cell, known: Option<&KnownMap>) {
        self.update = self.update.wrapping_add(1);
        let cells = (GRID * GRID) as usize;
        self.evidence.resize(cells, 0);
        self.hit_in.resize(cells, 0);
        let wanted = Cell {
            x: (centre.x >> SCALE_SHIFT) - GRID / 2,
            y: (centre.y >> SCALE_SHIFT) - GRID / 2,
        };
        let Some(low) = self.low else {
            self.low = Some(wanted);
            if known.is_some() {
                self.enter(wanted.x..wanted.x + GRID, wanted.y..wanted.y + GRID, known);
            }
            return;
        };
        let (dx, dy) = (wanted.x - low.x, wanted.y - low.y);
        if dx.abs().max(dy.abs()) < 8 {
            return;
        }
        self.low = Some(wanted);
        let all_x = wanted.x..wanted.x + GRID;
        let all_y = wanted.y..wanted.y + GRID;
        if dx.abs().max(dy.abs()) >= GRID {
            self.enter(all_x, all_y, known);
            return;
        }
        let entering = |d: i32, old: i32, new: i32| {
            if d > 0 {
                old + GRID..new + GRID
            } else {
                new..old
            }
        };
        self.enter(entering(dx, low.x, wanted.x), all_y, known);
        self.enter(all_x, entering(dy, low.y, wanted.y), known);
    }

    /// Sets the evidence of cells that enter the grid.
    fn enter(&mut self, columns: Range<i32>, rows: Range<i32>, known: Option<&KnownMap>) {
        for y in rows {
            for x in columns.clone() {
                let slot = ((y & (GRID - 1)) * GRID + (x & (GRID - 1))) as usize;
                let is_free = known.is_some_and(|known| is_known_free(known, x, y));
                if let Some(e) = self.evidence.get_mut(slot) {
                    *e = if is_free { KNOWN_FREE } else { 0 };
                }
            }
        }
    }

    /// Adds a return in this cell.
    #[inline]
    pub fn hit(&mut self, cell: Cell) {
        let Some(slot) = self.slot(cell) else { return };
        if let (Some(e), Some(hit_in)) = (self.evidence.get_mut(slot), self.hit_in.get_mut(slot))
            && *hit_in != self.update
        {
            *hit_in = self.update;
            *e = (*e + HIT).min(EVIDENCE_MAX);
        }
    }

    /// Adds a beam from `from` to `to` (from `origin`, m) that met the surface there at an
    /// incidence of this cosine; forgets what `submap` held on its way.
    pub fn pass(
        &mut self,
        origin: LocalOrigin,
        from: (f32, f32),
        to: (f32, f32),
        cos_incidence: f32,
        submap: &mut Submap,
    ) {
        let (dx, dy) = (to.0 - from.0, to.1 - from.1);
        let range = (dx * dx + dy * dy).sqrt();
        let before_return = BEFORE_SURFACE_M / cos_incidence.max(COS_INCIDENCE_MIN);
        let length = (range - before_return).min(RAY_MAX_M);
        let (ux, uy) = (dx / range * FREE_CELL, dy / range * FREE_CELL);
        let steps = (length / FREE_CELL) as i32;
        let (Some(low), evidence) = (self.low, self.evidence.as_mut_slice()) else {
            return;
        };
        let (mut x, mut y) = from;
        for _ in 0..steps {
            x += ux;
            y += uy;
            let (cell, _, _) = origin.locate(x, y);
            let Some(e) = slot_of(low, cell).and_then(|slot| evidence.get_mut(slot)) else {
                return;
            };
            if *e > EVIDENCE_MIN {
                *e -= 1;
                if *e == FORGET {
                    forget_block(submap, cell);
                }
            }
        }
    }
}

/// The place of a cell of the map in a grid whose lowest cell is `low`.
#[inline]
fn slot_of(low: Cell, cell: Cell) -> Option<usize> {
    let (x, y) = (cell.x >> SCALE_SHIFT, cell.y >> SCALE_SHIFT);
    let inside = (x - low.x) as u32 | (y - low.y) as u32;
    (inside < GRID as u32).then_some(((y & (GRID - 1)) * GRID + (x & (GRID - 1))) as usize)
}

fn is_known_free(known: &KnownMap, x: i32, y: i32) -> bool {
    let (x, y) = (x << SCALE_SHIFT, y << SCALE_SHIFT);
    let mut cells =
        (0..1 << SCALE_SHIFT).flat_map(|dy| (0..1 << SCALE_SHIFT).map(move |dx| (dx, dy)));
    cells.all(|(dx, dy)| {
        known.is_free(Cell {
            x: x + dx,
            y: y + dy,
        })
    })
}

fn forget_block(submap: &mut Submap, cell: Cell) {
    let (x, y) = (
        cell.x >> SCALE_SHIFT << SCALE_SHIFT,
        cell.y >> SCALE_SHIFT << SCALE_SHIFT,
    );
    for dy in 0..1 << SCALE_SHIFT {
        for dx in 0..1 << SCALE_SHIFT {
            submap.forget(Cell {
                x: x + dx,
                y: y + dy,
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell_at(x: f32, y: f32) -> Cell {
        LocalOrigin::near(0.0, 0.0).locate(x, y).0
    }

    #[test]
    fn where_beams_went_through_a_return_is_a_moving_objects() {
        let (mut free, mut submap) = (FreeSpace::default(), Submap::default());
        for _ in 0..6 {
            free.begin_update(cell_at(0.0, 0.0), None);
            free.pass(
                LocalOrigin::near(0.0, 0.0),
                (0.1, 0.1),
                (5.1, 0.1),
                1.0,
                &mut submap,
            );
        }
        assert!(free.was_free(cell_at(2.5, 0.1)));
        assert!(!free.was_free(cell_at(5.1, 0.1)), "the surface itself");
        assert!(!free.was_free(cell_at(4.95, 0.1)), "just before it");
        assert!(!free.was_free(cell_at(2.5, 1.1)), "nobody looked there");
        for _ in 0..20 {
            free.begin_update(cell_at(0.0, 0.0), None);
            free.hit(cell_at(2.5, 0.1));
            free.hit(cell_at(2.5, 0.1));
        }
        assert!(
            !free.was_free(cell_at(2.5, 0.1)),
            "what stays is a surface in the end"
        );
    }

    #[test]
    fn a_beam_along_a_wall_does_not_wear_it_away() {
        let (mut free, mut submap) = (FreeSpace::default(), Submap::default());
        let origin = LocalOrigin::near(0.0, 0.0);
        for _ in 0..20 {
            free.begin_update(cell_at(0.0, 0.0), None);
            // From 0.5 m beside the wall to a place 5 m along it.
            free.pass(origin, (0.1, 0.5), (5.1, 0.0), 0.0995, &mut submap);
        }
        assert!(!free.was_free(cell_at(4.0, 0.1)));
        assert!(free.was_free(cell_at(1.2, 0.39)));
    }

    #[test]
    fn what_a_beam_goes_through_is_forgotten() {
        let (mut free, mut submap) = (FreeSpace::default(), Submap::default());
        let origin = LocalOrigin::near(0.0, 0.0);
        submap.begin_update(cell_at(0.0, 0.0), 0.02);
        for i in 0..40 {
            submap.insert(origin, (3.0, 0.01 * i as f32), (1.0, 0.0), 1.0);
        }
        submap.end_update();
        assert!(submap.line(cell_at(3.0, 0.2)).exists());
        for _ in 0..12 {
            submap.begin_update(cell_at(0.0, 0.0), 0.02);
            free.begin_update(cell_at(0.0, 0.0), None);
            for y in [-0.1, 0.05, 0.15, 0.25, 0.35, 0.45] {
                free.pass(origin, (0.1, 0.1), (9.0, y * 3.0 - 0.2), 1.0, &mut submap);
            }
            submap.end_update();
        }
        assert!(!submap.line(cell_at(3.0, 0.2)).exists());
    }

    #[test]
    fn the_grid_rolls_along_and_forgets_what_it_leaves() {
        let (mut free, mut submap) = (FreeSpace::default(), Submap::default());
        let origin = LocalOrigin::near(0.0, 0.0);
        for _ in 0..8 {
            free.begin_update(cell_at(0.0, 0.0), None);
            free.pass(origin, (0.1, 0.1), (9.1, 0.1), 1.0, &mut submap);
        }
        free.begin_update(cell_at(10.0, 0.0), None);
        assert!(free.was_free(cell_at(4.0, 0.1)), "still inside");
        free.begin_update(cell_at(40.0, 0.0), None);
        free.begin_update(cell_at(0.0, 0.0), None);
        assert!(!free.was_free(cell_at(4.0, 0.1)), "was outside");
    }
}
