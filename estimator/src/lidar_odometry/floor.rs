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
use crate::stream::Scan;

/// Two scans are compared when the LiDAR has moved by so much between them, m,
const STEP_M: f64 = 0.4;
/// or has turned by so much, rad; and again after each further step, while they tell nothing.
const STEP_RAD: f64 = 0.12;
/// After so many steps too little of what was seen is seen still.
const STEPS_MAX: f64 = 5.0;
/// Beams that are compared; of more, an evenly spread part.
const BEAMS_MAX: usize = 360;
/// A return is on the line when it is as near to it as this, m: a scanner's noise,
const NEAR_M: f32 = 0.05;
/// and this part of its range: floors are uneven, and robots pitch.
const NEAR_PART: f32 = 0.015;
/// Beside the line so many times farther off returns are taken for the floor's as well.
const DROPPED_NEAR: f32 = 2.0;
/// A line is seen by so many beams at least,
const SEEN_MIN: usize = 8;
/// and by this part of those that are compared.
const SEEN_PART: f32 = 0.02;
/// Were it a wall, at most this part of them would fit as well.
const AS_WALL_MAX: f32 = 0.25;
/// No beam reaches through the floor: beyond the line is at most this part of those that reach it.
const BEYOND_MAX: f32 = 0.2;
/// A wall that bends towards the robot leaves its tangent beam by beam, what stands on the floor leaves
/// the floor at once: of the returns up to so many times farther off on the near side
const BENDS_WITHIN: f32 = 4.0;
/// there are at most this part of those on the line.
const BENDS_MAX: f32 = 0.4;
/// So many motions in favour, less those against, make a line the floor's.
const FOUND_VOTES: u32 = 3;
/// More are not counted, so that a line that is gone is forgotten.
const VOTES_MAX: u32 = 6;
/// No line is looked for nearer than the first, which is the robot's own, or farther than the second, m.
const DISTANCE_M: [f64; 2] = [0.5, 40.0];
/// Pairs of beams that a line is laid through.
const PAIRS: usize = 24;
/// Pairs are so many parts of the beams apart, in turn: the line may be seen between two racks alone.
const PAIRS_APART: [usize; 3] = [3, 6, 12];
/// Two beams nearer to each other than this tell no line, rad.
const APART_MIN_RAD: f32 = 0.02;
/// Gain of the line's place.
const GAIN: f32 = 0.3;

/// The floor's line in the LiDAR's frame, `n · q = 1`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FloorLine {
    nx_per_m: f32,
    ny_per_m: f32,
}

/// What of a beam is compared.
#[derive(Debug, Clone, Copy)]
struct Beam {
    cos: f32,
    sin: f32,
    /// 0 where there is no return.
    range_m: f32,
    /// In the scan before; 0 where there was none.
    before_m: f32,
}

/// How the beams of two scans lie to a line.
#[derive(Debug, Clone, Copy, Default)]
struct Sight {
    /// On the line in both.
    stayed: usize,
    /// Of these, those that a wall would explain as well.
    as_wall: usize,
    /// On the line in the later one.
    on: usize,
    /// Beyond it in the later one.
    beyond: usize,
    /// Not far before it in the later one.
    before: usize,
}

/// What one motion says of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Vote {
    For,
    Against,
    /// It is hidden, or a wall would look alike.
    Silent,
}

/// A scan that later ones are compared with.
#[derive(Debug, Clone)]
struct Before {
    pose: Pose2,
    /// 0 where there was no return.
    ranges_m: Vec<f32>,
    /// The steps after which a scan is compared with it.
    due_steps: f64,
}

/// Looks for the floor's line.
#[derive(Debug, Clone, Default)]
pub struct FloorWatch {
    line: Option<FloorLine>,
    votes: u32,
    is_found: bool,
    /// Whether one was found before: the poses of then were misled, and that is told once.
    was_found: bool,
    before: Option<Before>,
}

impl FloorLine {
    /// How far the line is from the LiDAR, m.
    pub fn distance_m(self) -> f64 {
        f64::from(self.nx_per_m.hypot(self.ny_per_m).recip())
    }

    /// The direction in which it is nearest, rad, in the LiDAR's frame: the plane is tilted towards it.
    pub fn direction_rad(self) -> f64 {
        f64::from(self.ny_per_m.atan2(self.nx_per_m))
    }

    /// Whether a return is the floor's.
    pub fn drops(self, cos: f32, sin: f32, range_m: f32) -> bool {
        self.beside(cos, sin, range_m)
            .is_some_and(|beside| beside.abs() < DROPPED_NEAR)
    }

    /// Through two returns; `None` where they do not tell it, or it is at no floor's distance.
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

    /// How far a return is beyond the line, in units of what is near; negative on this side. `None`
    /// where there is no return, or the beam never meets the line.
    fn beside(self, cos: f32, sin: f32, range_m: f32) -> Option<f32> {
        let inverse = self.nx_per_m * cos + self.ny_per_m * sin;
        (range_m > 0.0 && inverse > 0.0)
            .then(|| (inverse * range_m - 1.0) / (NEAR_PART + NEAR_M * inverse))
    }

    fn is_on(self, cos: f32, sin: f32, range_m: f32) -> bool {
        self.beside(cos, sin, range_m)
            .is_some_and(|beside| beside.abs() < 1.0)
    }

    /// Where a wall on this line is after the motion `(R, t)`: `n' = Rᵀ n / (1 - n · t)`.
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
        if det <= 1e-3 * xx * yy {
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
    fn of(line: FloorLine, beams: &[Beam], moved: &Pose2) -> Self {
        let wall = line.as_wall_after(moved);
        let mut sight = Self::default();
        for beam in beams {
            let Some(beside) = line.beside(beam.cos, beam.sin, beam.range_m) else {
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

    /// What it says of a line, where so many beams are compared.
    fn vote(self, beams: usize) -> Vote {
        let is_part = |some: usize, part: f32, of: usize| some as f32 > part * of as f32;
        let seen_min = SEEN_MIN.max((SEEN_PART * beams as f32) as usize);
        if is_part(self.beyond, BEYOND_MAX, self.on + self.beyond) {
            return if self.beyond >= seen_min {
                Vote::Against
            } else {
                Vote::Silent
            };
        }
        let is_wall = is_part(self.as_wall, AS_WALL_MAX, self.stayed)
            || is_part(self.before, BENDS_MAX, self.on);
        if self.stayed >= seen_min && !is_wall {
            Vote::For
        } else {
            Vote::Silent
        }
    }
}

impl Before {
    fn new(pose: &Pose2, ranges_m: impl Iterator<Item = f32>) -> Self {
        Self {
            pose: *pose,
            ranges_m: ranges_m.collect(),
            due_steps: 1.0,
        }
    }
}

impl FloorWatch {
    /// One that knows the line of the scanner already.
    pub fn knowing(line: Option<FloorLine>) -> Self {
        Self {
            line,
            votes: if line.is_some() { VOTES_MAX } else { 0 },
            is_found: line.is_some(),
            was_found: line.is_some(),
            before: None,
        }
    }

    /// The floor's line, once it is found.
    pub fn line(&self) -> Option<FloorLine> {
        self.line.filter(|_| self.is_found)
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        let before = self.before.as_ref();
        before.map_or(0, |before| before.ranges_m.capacity() * size_of::<f32>())
    }

    /// The next scan is compared with none before it: the LiDAR's way between them is not known.
    pub fn break_off(&mut self) {
        self.before = None;
    }

    /// Takes a scan that was taken at `pose`, with cosines and sines of its beams. Whether the floor's
    /// line has been found with it, for the first time.
    pub fn take(&mut self, pose: &Pose2, (cos, sin): (&[f32], &[f32]), scan: &Scan) -> bool {
        let stride = scan.ranges_m().len().div_ceil(BEAMS_MAX).max(1);
        let returned_m = (scan.shape().range_min_m as f32)..(scan.shape().range_max_m as f32);
        let ranges = || {
            let every = scan.ranges_m().iter().step_by(stride);
            every.map(|range_m| {
                if returned_m.contains(range_m) {
                    *range_m
                } else {
                    0.0
                }
            })
        };
        let Some(before) = &mut self.before else {
            self.before = Some(Before::new(pose, ranges()));
            return false;
        };
        let moved = before.pose.between(pose);
        let steps = (moved.translation().norm() / STEP_M).max(moved.yaw_rad.abs() / STEP_RAD);
        if steps < before.due_steps {
            return false;
        }
        before.due_steps = steps + 1.0;
        let directions = cos.iter().zip(sin).step_by(stride);
        let beams: Vec<Beam> = directions
            .zip(ranges().zip(before.ranges_m.iter()))
            .map(|((&cos, &sin), (range_m, &before_m))| Beam {
                cos,
                sin,
                range_m,
                before_m,
            })
            .collect();
        let vote = self.judge(&beams, &moved);
        if vote != Vote::Silent || steps > STEPS_MAX {
            self.before = Some(Before::new(pose, ranges()));
        }
        let is_first = self.is_found && !self.was_found;
        self.was_found |= self.is_found;
        is_first
    }

    fn judge(&mut self, beams: &[Beam], moved: &Pose2) -> Vote {
        let Some(line) = self.line else {
            self.line = candidate(beams, moved);
            self.votes = u32::from(self.line.is_some());
            return self.line.map_or(Vote::Silent, |_| Vote::For);
        };
        let vote = Sight::of(line, beams, moved).vote(beams.len());
        match vote {
            Vote::For => {
                self.votes = (self.votes + 1).min(VOTES_MAX);
                if let Some(fitted) = line.fitted(beams) {
                    self.line = Some(line.towards(fitted));
                }
            }
            Vote::Against => self.votes = self.votes.saturating_sub(1),
            Vote::Silent => {}
        }
        if self.votes == 0 {
            self.line = None;
        }
        self.is_found = self.line.is_some() && (self.is_found || self.votes >= FOUND_VOTES);
        vote
    }
}

/// The line on which most returns stayed that no wall explains.
fn candidate(beams: &[Beam], moved: &Pose2) -> Option<FloorLine> {
    let stayed: Vec<Beam> = beams
        .iter()
        .filter(|beam| {
            let near_m = NEAR_M + NEAR_PART * beam.range_m;
            beam.range_m > 0.0 && (beam.range_m - beam.before_m).abs() < near_m
        })
        .copied()
        .collect();
    if stayed.len() < SEEN_MIN {
        return None;
    }
    let mut best = None;
    for pair in 0..PAIRS {
        let first = pair * stayed.len() / PAIRS;
        let parts = PAIRS_APART[pair % PAIRS_APART.len()];
        let second = (first + (stayed.len() / parts).max(1)) % stayed.len();
        let through = match (stayed.get(first), stayed.get(second)) {
            (Some(a), Some(b)) => FloorLine::through(a, b),
            _ => None,
        };
        let Some(line) = through else {
            continue;
        };
        let stays = Sight::of(line, &stayed, moved).stayed;
        if best.is_none_or(|(most, _)| stays > most) {
            best = Some((stays, line));
        }
    }
    let (_, line) = best?;
    let line = line.fitted(&stayed)?;
    (Sight::of(line, beams, moved).vote(beams.len()) == Vote::For).then_some(line)
}
