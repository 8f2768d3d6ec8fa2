//! The last minute of motion, in cells of a tenth of a second.

/// Length of a cell, s.
pub(crate) const CELL_S: f64 = 0.1;
/// Cells that are kept: a minute.
pub(crate) const CELLS: usize = 600;
/// Longest gap that is filled by a straight line, s.
const GAP_MAX_S: f64 = 0.75;
/// Jump of a clock back that begins the ring again, s.
const BACK_MAX_S: f64 = 1.0;

/// Quantities of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Channel {
    /// Speed as sent.
    Speed,
    /// Steering angle as sent.
    Steering,
    /// LiDAR's velocity along its x, m/s.
    Ahead,
    /// LiDAR's velocity along its y, m/s.
    Left,
    /// LiDAR's yaw rate, rad/s.
    Turn,
}

const CHANNELS: usize = 5;

/// Means over a cell; NaN where something is missing.
type Cell = [f32; CHANNELS];

const EMPTY: Cell = [f32::NAN; CHANNELS];

/// A ring of cells. Times are seconds from any common start.
#[derive(Debug, Clone)]
pub(crate) struct Grid {
    cells: Box<[Cell]>,
    /// Number of the newest cell since the start.
    newest: i64,
    /// Last value of the speed and of the angle, and its time.
    last: [Option<(f64, f64)>; 2],
    /// Cells of a channel before this one are complete.
    complete: [i64; CHANNELS],
}

impl Default for Grid {
    fn default() -> Self {
        Self {
            cells: vec![EMPTY; CELLS].into_boxed_slice(),
            newest: i64::MIN,
            last: [None; 2],
            complete: [i64::MIN; CHANNELS],
        }
    }
}

impl Grid {
    /// Adds the next value of the speed or the angle: a straight line from the last one.
    pub fn take(&mut self, channel: Channel, time_s: f64, value: f64) {
        let Some(last) = self.last.get_mut(channel as usize) else {
            return;
        };
        let before = *last;
        if before.is_some_and(|(before_s, _)| time_s < before_s - BACK_MAX_S) {
            *self = Self::default();
            return;
        }
        if before.is_some_and(|(before_s, _)| time_s <= before_s) {
            return;
        }
        *last = Some((time_s, value));
        let Some((before_s, before)) = before.filter(|(at_s, _)| time_s - at_s <= GAP_MAX_S) else {
            self.spoil(channel, before.map(|(at_s, _)| at_s), time_s);
            return;
        };
        let slope = (value - before) / (time_s - before_s);
        self.spread(channel, before_s, time_s, |from_s, to_s| {
            before + slope * (0.5 * (from_s + to_s) - before_s)
        });
    }

    /// Adds a velocity of the LiDAR that it kept from one time to another.
    pub fn take_motion(&mut self, from_s: f64, to_s: f64, velocity: [f64; 3]) {
        let channels = [Channel::Ahead, Channel::Left, Channel::Turn];
        for (channel, value) in channels.into_iter().zip(velocity) {
            self.spread(channel, from_s, to_s, |_, _| value);
        }
    }

    /// Notes that the LiDAR's motion is unknown between two times.
    pub fn lose_motion(&mut self, before_s: Option<f64>, time_s: f64) {
        for channel in [Channel::Ahead, Channel::Left, Channel::Turn] {
            self.spoil(channel, before_s, time_s);
        }
    }

    /// Forgets the steering angles.
    pub fn forget_steering(&mut self) {
        for cell in &mut self.cells {
            cell[Channel::Steering as usize] = f32::NAN;
        }
        self.last[Channel::Steering as usize] = None;
    }

    /// Numbers of the cells that are complete in every channel, as far as the ring reaches back.
    pub fn range(&self) -> std::ops::Range<i64> {
        let end = self.complete.iter().copied().min().unwrap_or(i64::MIN);
        let start = self.newest.saturating_sub(CELLS as i64 - 1);
        if end == i64::MIN || end < start {
            return 0..0;
        }
        start..end
    }

    /// Mean of a channel over a cell; `None` where it is unknown.
    pub fn value(&self, channel: Channel, cell: i64) -> Option<f64> {
        if cell > self.newest || cell <= self.newest.saturating_sub(CELLS as i64) {
            return None;
        }
        let value = self.cells[cell.rem_euclid(CELLS as i64) as usize][channel as usize];
        value.is_finite().then_some(f64::from(value))
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(&*self.cells)
    }

    /// Adds the mean of each piece between two times to the cells that they lie in.
    fn spread(&mut self, channel: Channel, from_s: f64, to_s: f64, mean: impl Fn(f64, f64) -> f64) {
        let (first, last) = (cell_of(from_s), cell_of(to_s));
        if last - first > CELLS as i64 {
            return;
        }
        for cell in first..=last {
            let piece_from_s = from_s.max(cell as f64 * CELL_S);
            let piece_to_s = to_s.min((cell + 1) as f64 * CELL_S);
            if piece_to_s <= piece_from_s {
                continue;
            }
            let part = mean(piece_from_s, piece_to_s) * (piece_to_s - piece_from_s) / CELL_S;
            if let Some(value) = self.reach(cell).map(|cell| &mut cell[channel as usize]) {
                *value = if value.is_nan() {
                    part as f32
                } else {
                    *value + part as f32
                };
            }
        }
        self.complete[channel as usize] = last;
    }

    /// Makes the cells at both ends of a gap unusable; those between stay empty.
    fn spoil(&mut self, channel: Channel, before_s: Option<f64>, time_s: f64) {
        for at_s in before_s.into_iter().chain([time_s]) {
            if let Some(cell) = self.reach(cell_of(at_s)) {
                cell[channel as usize] = f32::INFINITY;
            }
        }
        self.complete[channel as usize] = cell_of(time_s);
    }

    /// A cell, which may be newer than all before; `None` for one that is too old.
    fn reach(&mut self, cell: i64) -> Option<&mut Cell> {
        let ring = CELLS as i64;
        if self.newest == i64::MIN || cell >= self.newest.saturating_add(ring) {
            self.cells.fill(EMPTY);
            self.newest = cell;
        }
        while self.newest < cell {
            self.newest += 1;
            self.cells[self.newest.rem_euclid(ring) as usize] = EMPTY;
        }
        (cell > self.newest - ring).then(|| &mut self.cells[cell.rem_euclid(ring) as usize])
    }
}

fn cell_of(time_s: f64) -> i64 {
    (time_s / CELL_S).floor() as i64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_has_the_mean_of_a_line_through_uneven_samples() {
        let mut grid = Grid::default();
        let mut time_s = 100.0;
        for step in 0..400 {
            grid.take(Channel::Speed, time_s, 3.0 * time_s);
            time_s += if step % 3 == 0 { 0.013 } else { 0.027 };
        }
        let middle = grid.value(Channel::Speed, 1_040).unwrap();
        assert!((middle - 3.0 * 104.05).abs() < 1e-3, "{middle}");
        assert_eq!(grid.value(Channel::Steering, 1_040), None);
    }

    #[test]
    fn a_gap_is_unknown_and_old_cells_are_overwritten() {
        let mut grid = Grid::default();
        for step in 0..1_000 {
            let time_s = f64::from(step) * 0.1;
            if !(400..420).contains(&step) {
                grid.take(Channel::Steering, time_s, 1.0);
                grid.take(Channel::Speed, time_s, 1.0);
            }
            grid.take_motion(time_s, time_s + 0.1, [1.0, 0.0, 0.5]);
        }
        assert_eq!(grid.range(), 400..999);
        assert_eq!(grid.value(Channel::Steering, 410), None);
        assert_eq!(grid.value(Channel::Steering, 420), None);
        assert!(grid.value(Channel::Steering, 421).is_some());
        assert_eq!(grid.value(Channel::Turn, 300), None);
        assert_eq!(grid.value(Channel::Turn, 500), Some(0.5));
    }
}
