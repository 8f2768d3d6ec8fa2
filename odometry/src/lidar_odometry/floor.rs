//! Returns of the floor. A scanner whose plane is tilted meets the floor in a line that comes along
//! with the robot: to a matcher it is a wall that never gets nearer.
//!
//! The beam at the angle `a` of a plane at the height `h`, tilted by `t` towards `d`, goes down by
//! `sin t cos(a - d)` on each metre, so its range `r` on the floor follows `n · u(a) r = 1` with
//! `n = (sin t / h) (cos d, sin d)` and `u(a) = (cos a, sin a)`: a straight line of the LiDAR's frame.
//! A line that was there before a motion and is there after it, where a wall would have moved away,
//! is the floor's. So is any other straight edge that the robot carries before its whole view.

use serde::{Deserialize, Serialize};

use crate::geometry::Pose2;
use crate::scan::{Scan, ScanShape};

/// Step of the LiDAR between two scans that are compared, m,
const STEP_M: f64 = 0.4;
/// or its turn, rad; and again after each further step, while they decide nothing.
const STEP_RAD: f64 = 0.12;
/// Most steps over which scans are compared: after more, too little of the first view is still
/// visible.
const STEPS_MAX: f64 = 5.0;
/// Most beams that are compared; of more, an evenly spread part is compared.
const BEAMS_MAX: usize = 360;
/// Largest distance of a return on the line from it, m: a scanner's noise,
const NEAR_M: f32 = 0.05;
/// plus this part of its range: floors are uneven, and robots pitch.
const NEAR_PART: f32 = 0.015;
/// Multiple of that distance within which returns beside the line count as the floor's as well.
const DROPPED_NEAR: f32 = 2.0;
/// Fewest beams that see a line.
const SEEN_MIN: usize = 8;
/// Largest part of them that a wall would explain as well.
const AS_WALL_MAX: f32 = 0.25;
/// Largest part, of the beams that reach the line, that end beyond it: no beam reaches through the
/// floor.
const BEYOND_MAX: f32 = 0.2;
/// Largest part without a return, of the beams that meet the line within the scanner's range and
/// reach it: the floor is everywhere. Behind a vehicle in the open that has the same speed, most
/// have none.
const MISSING_MAX: f32 = 0.5;
/// Multiple of that distance on the near side within which returns are counted against the line: a
/// wall that bends towards the robot leaves its tangent beam by beam, an object on the floor leaves
/// the floor at once.
const BENDS_WITHIN: f32 = 4.0;
/// Largest number of those returns, as a part of the returns on the line.
const BENDS_MAX: f32 = 0.4;
/// Votes, motions in favour less those against, that make a line the floor's.
const FOUND_VOTES: u32 = 3;
/// Most votes that are counted, so that a vanished line is forgotten.
const VOTES_MAX: u32 = 6;
/// Silent motions in a row after which a sought line is given up.
const SILENT_MAX: u32 = 12;
/// Distances between which a line is looked for, m: nearer is the robot itself.
const DISTANCE_M: [f64; 2] = [0.5, 40.0];
/// Pairs of beams that a line is laid through.
const PAIRS: usize = 24;
/// Parts of the beams between the two of a pair, in turn: the line may be visible between two racks
/// alone.
const PAIRS_APART: [usize; 3] = [3, 6, 12];
/// Smallest angle between two beams that determine a line, rad.
const APART_MIN_RAD: f32 = 0.02;
/// Largest determinant of the returns' moments, over the square of their trace, at which they
/// determine no line: over 4 degrees it is larger.
const NARROW: f32 = 4e-4;
/// Gain of the line's place.
const GAIN: f32 = 0.3;

/// The floor's line in the LiDAR's frame, `n · q = 1`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FloorLine {
    nx_per_m: f32,
    ny_per_m: f32,
}

/// Compared beam of two scans.
#[derive(Debug, Clone, Copy)]
struct Beam {
    cos: f32,
    sin: f32,
    /// 0 where there is no return.
    range_m: f32,
    /// Range in the scan before, m; 0 where there was no return.
    before_m: f32,
}

/// Beams of two scans, and the motion between these.
struct Compared {
    beams: Vec<Beam>,
    /// The later scan's LiDAR in the earlier one's frame.
    moved: Pose2,
    /// The scanner's longest range, m.
    range_max_m: f32,
}

/// Position of two scans' beams relative to a line.
#[derive(Debug, Clone, Copy, Default)]
struct Sight {
    /// Beams on the line in both.
    stayed: usize,
    /// Part of these that a wall would explain as well.
    as_wall: usize,
    /// Beams on the line in the later one.
    on: usize,
    /// Beams beyond it in the later one.
    beyond: usize,
    /// Beams not far before it in the later one.
    before: usize,
    /// Beams without a return in the later one, though the line is within range.
    missing: usize,
}

/// Vote of one motion on a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Vote {
    For,
    Against,
    /// Line that is hidden, or that a wall would look like.
    Silent,
}

/// A scan that later ones are compared with.
#[derive(Debug, Clone)]
struct Before {
    pose: Pose2,
    shape: ScanShape,
    /// Ranges of one beam in so many: 0 where there was no return.
    ranges_m: Vec<f32>,
    /// Steps after which the next scan is compared with it.
    due_steps: f64,
}

/// A line with its votes.
#[derive(Debug, Clone, Copy)]
struct Voted {
    line: FloorLine,
    votes: u32,
    /// Silent motions in a row.
    silent: u32,
}

/// Looks for the floor's line.
#[derive(Debug, Clone, Default)]
pub struct FloorWatch {
    found: Option<Voted>,
    /// Candidate for the line, while none is found or the found one is hidden.
    sought: Option<Voted>,
    /// True if a line was ever found: the poses before were misled, and this is reported once.
    was_found: bool,
    before: Option<Before>,
}

/// Knowledge of the scanner that a floor watch has learnt.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct LearntFloor {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    line: Option<FloorLine>,
    was_found: bool,
}

impl FloorLine {
    /// Distance of the line from the LiDAR, m.
    pub fn distance_m(self) -> f64 {
        f64::from(self.nx_per_m.hypot(self.ny_per_m).recip())
    }

    /// The direction in which it is nearest, rad, in the LiDAR's frame: the plane is tilted towards it.
    pub fn direction_rad(self) -> f64 {
        f64::from(self.ny_per_m.atan2(self.nx_per_m))
    }

    /// True if a return is the floor's.
    pub fn drops(self, cos: f32, sin: f32, range_m: f32) -> bool {
        self.beside(cos, sin, range_m)
            .is_some_and(|beside| beside.abs() < DROPPED_NEAR)
    }

    /// Lays a line through two returns; `None` where they do not determine it, or it is at no
    /// floor's distance.
    fn through(a: &Beam, b: &Beam) -> Option<Self> {
        let det = a.cos * b.sin - a.sin * b.cos;
        if det.abs() < APART_MIN_RAD {
            return None;
        }
        let (ia, ib) = (a.range_m.recip(), b.range_m.recip());
        Self {
            nx_per_m: (ia * b.sin - ib * a.sin) / det,
            ny_per_m: (ib * a.cos - ia * b.cos) / det,
        }
        .plausible()
    }

    fn plausible(self) -> Option<Self> {
        let [nearest, farthest] = DISTANCE_M;
        (nearest..farthest)
            .contains(&self.distance_m())
            .then_some(self)
    }

    /// Distance of a return beyond the line, as a multiple of what counts as near; negative on this
    /// side. `None` where there is no return, or the beam never meets the line.
    fn beside(self, cos: f32, sin: f32, range_m: f32) -> Option<f32> {
        let inverse = self.nx_per_m * cos + self.ny_per_m * sin;
        (range_m > 0.0 && inverse > 0.0)
            .then(|| (inverse * range_m - 1.0) / (NEAR_PART + NEAR_M * inverse))
    }

    fn is_on(self, cos: f32, sin: f32, range_m: f32) -> bool {
        self.beside(cos, sin, range_m)
            .is_some_and(|beside| beside.abs() < 1.0)
    }

    /// Place of a wall on this line after the motion `(R, t)`: `n' = Rᵀ n / (1 - n · t)`.
    fn as_wall_after(self, moved: &Pose2) -> Self {
        let (sin, cos) = (moved.yaw_rad.sin() as f32, moved.yaw_rad.cos() as f32);
        let (x, y) = (moved.x_m as f32, moved.y_m as f32);
        let left = 1.0 - (self.nx_per_m * x + self.ny_per_m * y);
        Self {
            nx_per_m: (cos * self.nx_per_m + sin * self.ny_per_m) / left,
            ny_per_m: (cos * self.ny_per_m - sin * self.nx_per_m) / left,
        }
    }

    /// Least squares of `n · u r = 1` over the returns on this line.
    fn fitted(self, beams: &[Beam]) -> Option<Self> {
        let (mut xx, mut xy, mut yy, mut x, mut y) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for beam in beams {
            if self.is_on(beam.cos, beam.sin, beam.range_m) {
                let (px, py) = (beam.cos * beam.range_m, beam.sin * beam.range_m);
                (xx, xy, yy) = (xx + px * px, xy + px * py, yy + py * py);
                (x, y) = (x + px, y + py);
            }
        }
        let det = xx * yy - xy * xy;
        if det <= NARROW * (xx + yy) * (xx + yy) {
            return None;
        }
        Self {
            nx_per_m: (x * yy - y * xy) / det,
            ny_per_m: (y * xx - x * xy) / det,
        }
        .plausible()
    }

    fn towards(self, other: Self) -> Self {
        Self {
            nx_per_m: self.nx_per_m + GAIN * (other.nx_per_m - self.nx_per_m),
            ny_per_m: self.ny_per_m + GAIN * (other.ny_per_m - self.ny_per_m),
        }
    }
}

impl Sight {
    fn of(line: FloorLine, compared: &Compared) -> Self {
        let wall = line.as_wall_after(&compared.moved);
        let mut sight = Self::default();
        for beam in &compared.beams {
            let Some(beside) = line.beside(beam.cos, beam.sin, beam.range_m) else {
                let is_near = line.beside(beam.cos, beam.sin, compared.range_max_m);
                sight.missing += usize::from(is_near.is_some_and(|beside| beside > 1.0));
                continue;
            };
            if beside.abs() < 1.0 {
                sight.on += 1;
                if line.is_on(beam.cos, beam.sin, beam.before_m) {
                    sight.stayed += 1;
                    sight.as_wall += usize::from(wall.is_on(beam.cos, beam.sin, beam.range_m));
                }
            } else if beside > DROPPED_NEAR {
                sight.beyond += 1;
            } else if (-BENDS_WITHIN..=-1.0).contains(&beside) {
                sight.before += 1;
            }
        }
        sight
    }

    fn vote(self) -> Vote {
        let is_part = |some: usize, part: f32, of: usize| some as f32 > part * of as f32;
        if is_part(self.beyond, BEYOND_MAX, self.on + self.beyond) {
            return if self.beyond >= SEEN_MIN {
                Vote::Against
            } else {
                Vote::Silent
            };
        }
        let is_wall = is_part(self.as_wall, AS_WALL_MAX, self.stayed)
            || is_part(self.before, BENDS_MAX, self.on)
            || is_part(self.missing, MISSING_MAX, self.on + self.missing);
        if self.stayed >= SEEN_MIN && !is_wall {
            Vote::For
        } else {
            Vote::Silent
        }
    }
}

impl Before {
    fn new(pose: &Pose2, scan: &Scan) -> Self {
        Self {
            pose: *pose,
            shape: *scan.shape(),
            ranges_m: compared_ranges(scan).collect(),
            due_steps: 1.0,
        }
    }

    /// True if a scan has the same beams.
    fn has_beams_of(&self, scan: &Scan) -> bool {
        self.shape == *scan.shape() && self.ranges_m.len() == compared_ranges(scan).count()
    }
}

impl Voted {
    fn new(line: FloorLine, votes: u32) -> Self {
        Self {
            line,
            votes,
            silent: 0,
        }
    }

    /// Adds the vote of a motion.
    fn take(&mut self, compared: &Compared) -> Vote {
        let vote = Sight::of(self.line, compared).vote();
        self.silent = if vote == Vote::Silent {
            self.silent + 1
        } else {
            0
        };
        match vote {
            Vote::For => {
                self.votes = (self.votes + 1).min(VOTES_MAX);
                if let Some(fitted) = self.line.fitted(&compared.beams) {
                    self.line = self.line.towards(fitted);
                }
            }
            Vote::Against => self.votes = self.votes.saturating_sub(1),
            Vote::Silent => {}
        }
        vote
    }
}

impl FloorWatch {
    /// Begins with a scanner that is known already.
    pub fn knowing(learnt: LearntFloor) -> Self {
        Self {
            found: learnt.line.map(|line| Voted::new(line, VOTES_MAX)),
            was_found: learnt.was_found,
            ..Self::default()
        }
    }

    /// Returns what it has learnt of the scanner.
    pub fn learnt(&self) -> LearntFloor {
        LearntFloor {
            line: self.line(),
            was_found: self.was_found,
        }
    }

    /// The floor's line, once it is found.
    pub fn line(&self) -> Option<FloorLine> {
        self.found.map(|found| found.line)
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        let before = self.before.as_ref();
        before.map_or(0, |before| before.ranges_m.capacity() * size_of::<f32>())
    }

    /// Compares the next scan with none before it: the LiDAR's way between them is not known.
    pub fn break_off(&mut self) {
        self.before = None;
    }

    /// Adds a scan taken at `pose`, with cosines and sines of its beams. Returns true if it is the
    /// first with which the floor's line is found.
    pub fn take(&mut self, pose: &Pose2, (cos, sin): (&[f32], &[f32]), scan: &Scan) -> bool {
        let with_same_beams = self
            .before
            .as_mut()
            .filter(|before| before.has_beams_of(scan));
        let Some(before) = with_same_beams else {
            self.before = Some(Before::new(pose, scan));
            return false;
        };
        let moved = before.pose.between(pose);
        let steps = (moved.translation().norm() / STEP_M).max(moved.yaw_rad.abs() / STEP_RAD);
        if steps < before.due_steps {
            return false;
        }
        before.due_steps = steps + 1.0;
        let directions = cos.iter().zip(sin).step_by(stride(scan));
        let ranges = compared_ranges(scan).zip(before.ranges_m.iter());
        let beams = directions
            .zip(ranges)
            .map(|((&cos, &sin), (range_m, &before_m))| Beam {
                cos,
                sin,
                range_m,
                before_m,
            });
        let compared = Compared {
            beams: beams.collect(),
            moved,
            range_max_m: scan.shape().range_max_m as f32,
        };
        if self.judge(&compared) != Vote::Silent || steps > STEPS_MAX {
            self.before = Some(Before::new(pose, scan));
        }
        let is_first = self.found.is_some() && !self.was_found;
        self.was_found |= self.found.is_some();
        is_first
    }

    /// Adds a motion's vote to the found line, and to the sought one where that is hidden or there
    /// is none.
    fn judge(&mut self, compared: &Compared) -> Vote {
        if let Some(found) = &mut self.found {
            let vote = found.take(compared);
            if vote != Vote::Silent {
                self.found = self.found.filter(|found| found.votes > 0);
                self.sought = None;
                return vote;
            }
        }
        let Some(sought) = &mut self.sought else {
            self.sought = candidate(compared).map(|line| Voted::new(line, 1));
            return self.sought.map_or(Vote::Silent, |_| Vote::For);
        };
        let vote = sought.take(compared);
        if sought.votes >= FOUND_VOTES {
            self.found = self.sought.take();
        } else if sought.votes == 0 || sought.silent >= SILENT_MAX {
            self.sought = None;
        }
        vote
    }
}

/// Step from one compared beam to the next.
fn stride(scan: &Scan) -> usize {
    scan.ranges_m().len().div_ceil(BEAMS_MAX).max(1)
}

/// Ranges of the compared beams, m; 0 where there is no return.
fn compared_ranges(scan: &Scan) -> impl Iterator<Item = f32> {
    let shape = scan.shape();
    let returned_m = (shape.range_min_m as f32)..(shape.range_max_m as f32);
    scan.ranges_m()
        .iter()
        .step_by(stride(scan))
        .map(move |range_m| {
            if returned_m.contains(range_m) {
                *range_m
            } else {
                0.0
            }
        })
}

/// The line on which most returns stayed that no wall explains.
fn candidate(compared: &Compared) -> Option<FloorLine> {
    let has_stayed = |beam: &&Beam| {
        let near_m = NEAR_M + NEAR_PART * beam.range_m;
        beam.range_m > 0.0 && (beam.range_m - beam.before_m).abs() < near_m
    };
    let stayed = Compared {
        beams: compared.beams.iter().filter(has_stayed).copied().collect(),
        ..*compared
    };
    let beams = &stayed.beams;
    if beams.len() < SEEN_MIN {
        return None;
    }
    let mut best = None;
    for pair in 0..PAIRS {
        let first = pair * beams.len() / PAIRS;
        let parts = PAIRS_APART[pair % PAIRS_APART.len()];
        let second = (first + (beams.len() / parts).max(1)) % beams.len();
        let through = match (beams.get(first), beams.get(second)) {
            (Some(a), Some(b)) => FloorLine::through(a, b),
            _ => None,
        };
        let Some(line) = through else {
            continue;
        };
        let sight = Sight::of(line, &stayed);
        let unexplained = sight.stayed - sight.as_wall;
        if best.is_none_or(|(most, _)| unexplained > most) {
            best = Some((unexplained, line));
        }
    }
    let (_, line) = best?;
    let line = line.fitted(beams)?;
    (Sight::of(line, compared).vote() == Vote::For).then_some(line)
}
