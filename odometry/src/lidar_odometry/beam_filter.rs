//! Points of a scan's beams: the usable returns, their positions and their times.

use super::floor::FloorLine;
use crate::scan::{Scan, ScanShape};

/// Most used points of a scan; of more, an evenly spread part is used.
pub const POINTS_MAX: usize = 1024;
/// Largest range of a used return, m: the local map ends there.
pub const RANGE_USED_MAX_M: f32 = 60.0;
/// Largest step in range from beam to beam that is noise, not an edge, m.
const EDGE_STEP_MIN_M: f32 = 0.08;
/// Largest tangent of incidence at which a return is not an edge (81 degrees).
const EDGE_TANGENT: f32 = 6.5;
/// Largest tangent of incidence at which the surface between two returns counts as seen (60
/// degrees).
const JOINED_TANGENT: f32 = 1.7;
/// Most missing beams between two neighbouring returns.
const NEIGHBOUR_GAP_MAX: usize = 4;

/// Points in a block.
pub const LANES: usize = 32;

/// A usable return.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// Position as measured, in the LiDAR's frame, m.
    pub x: f32,
    /// Position as measured, m.
    pub y: f32,
    /// Time of the beam relative to the scan's reference time, s.
    pub tau_s: f32,
    /// Time of the beam as a part of the scan, -1/2 to 1/2.
    pub phase: f32,
    /// One over the range, 1/m.
    pub inverse_range: f32,
    /// True if the surface continues to the next point in the open: both see it well.
    pub joined: bool,
}

/// Consecutive points, one array a coordinate.
#[derive(Debug, Clone)]
pub struct Block {
    /// Positions as measured, m.
    pub x: [f32; LANES],
    /// Positions as measured, m.
    pub y: [f32; LANES],
    /// Times of the beams, s.
    pub tau_s: [f32; LANES],
    /// Times of the beams as parts of the scan.
    pub phase: [f32; LANES],
    /// One over the ranges, 1/m.
    pub inverse_range: [f32; LANES],
    /// True where the surface continues to the next point in the open: both see it well.
    pub joined: [bool; LANES],
    count: usize,
}

impl Block {
    const EMPTY: Self = Self {
        x: [0.0; LANES],
        y: [0.0; LANES],
        tau_s: [0.0; LANES],
        phase: [0.0; LANES],
        inverse_range: [0.0; LANES],
        joined: [false; LANES],
        count: 0,
    };

    /// Number of points; the lanes beyond are zero.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Mean time of the points, s.
    pub fn mean_tau_s(&self) -> f32 {
        self.tau_s.iter().sum::<f32>() / self.count.max(1) as f32
    }

    fn iter(&self) -> impl Iterator<Item = Point> {
        let positions = self.x.iter().zip(&self.y);
        let times = self.tau_s.iter().zip(&self.phase).zip(&self.inverse_range);
        positions.zip(times).zip(&self.joined).take(self.count).map(
            |(((&x, &y), ((&tau_s, &phase), &inverse_range)), &joined)| Point {
                x,
                y,
                tau_s,
                phase,
                inverse_range,
                joined,
            },
        )
    }
}

/// The usable returns of one scan in the LiDAR's frame, in the order they were taken.
#[derive(Debug, Clone, Default)]
pub struct ScanPoints {
    blocks: Vec<Block>,
    len: usize,
}

impl ScanPoints {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        self.blocks.capacity() * size_of::<Block>()
    }

    /// Mean square of the beams' times, s².
    pub fn mean_tau2_s2(&self) -> f64 {
        let sum: f32 = self
            .blocks
            .iter()
            .flat_map(|block| &block.tau_s)
            .map(|t| t * t)
            .sum();
        f64::from(sum) / self.len.max(1) as f64
    }

    /// The points, block by block.
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// The points, one by one.
    pub fn iter(&self) -> impl Iterator<Item = Point> {
        self.blocks.iter().flat_map(Block::iter)
    }

    fn clear(&mut self) {
        self.blocks.clear();
        self.len = 0;
    }

    /// Sets on the last point whether its surface continues to the next one.
    fn join_last(&mut self, is_joined: bool) {
        if let Some(block) = self.blocks.last_mut()
            && let Some(joined) = block.joined.get_mut(block.count.wrapping_sub(1))
        {
            *joined = is_joined;
        }
    }

    fn push(&mut self, point: Point) {
        if self.blocks.last().is_none_or(|block| block.count == LANES) {
            self.blocks.push(Block::EMPTY);
        }
        if let Some(block) = self.blocks.last_mut()
            && block.count < LANES
        {
            let lane = block.count;
            block.x[lane] = point.x;
            block.y[lane] = point.y;
            block.tau_s[lane] = point.tau_s;
            block.phase[lane] = point.phase;
            block.inverse_range[lane] = point.inverse_range;
            block.joined[lane] = point.joined;
            block.count += 1;
            self.len += 1;
        }
    }
}

/// Turns scans into points; keeps the beams' directions from scan to scan.
#[derive(Debug, Clone, Default)]
pub struct BeamFilter {
    directions_of: Option<(ScanShape, usize)>,
    cos: Vec<f32>,
    sin: Vec<f32>,
    /// Beams with a return, each with a flag for a neighbouring edge.
    returns: Vec<Return>,
}

#[derive(Debug, Clone, Copy)]
struct Return {
    beam: u32,
    range: f32,
    beside_edge: bool,
    joined: bool,
    is_floor: bool,
}

impl BeamFilter {
    /// Puts the usable returns of `scan`, whose beams follow each other after `time_increment_s`,
    /// into `points`, but for those of the floor, where its line is known.
    pub fn filter(
        &mut self,
        scan: &Scan,
        time_increment_s: f64,
        floor: Option<FloorLine>,
        points: &mut ScanPoints,
    ) {
        self.prepare_directions(scan.shape(), scan.ranges_m().len());
        self.collect_returns(scan);
        self.mark_edges(scan.shape().angle_increment_rad.abs() as f32);
        if let Some(line) = floor {
            self.leave_out(line);
        }
        self.emit(scan, time_increment_s as f32, points);
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        (self.cos.capacity() + self.sin.capacity()) * size_of::<f32>()
            + self.returns.capacity() * size_of::<Return>()
    }

    fn prepare_directions(&mut self, shape: &ScanShape, beams: usize) {
        if self.directions_of == Some((*shape, beams)) {
            return;
        }
        self.cos.clear();
        self.sin.clear();
        for beam in 0..beams {
            let (s, c) = (shape.angle_min_rad + beam as f64 * shape.angle_increment_rad).sin_cos();
            self.cos.push(c as f32);
            self.sin.push(s as f32);
        }
        self.directions_of = Some((*shape, beams));
    }

    fn collect_returns(&mut self, scan: &Scan) {
        let shortest = (scan.shape().range_min_m as f32).max(0.02);
        let longest = (scan.shape().range_max_m as f32).min(RANGE_USED_MAX_M);
        self.returns.clear();
        for (beam, &range) in scan.ranges_m().iter().enumerate() {
            // Written so that NaN fails.
            if range >= shortest && range < longest {
                self.returns.push(Return {
                    beam: beam as u32,
                    range,
                    beside_edge: false,
                    joined: false,
                    is_floor: false,
                });
            }
        }
    }

    /// Marks the returns at depth discontinuities: mixed pixels lie there, and edges move with
    /// the viewpoint.
    fn mark_edges(&mut self, increment: f32) {
        let mut rest = self.returns.as_mut_slice();
        while let Some((first, tail)) = rest.split_first_mut() {
            if let Some(second) = tail.first_mut() {
                let gap = second.beam - first.beam;
                if gap <= NEIGHBOUR_GAP_MAX as u32 {
                    let step = (second.range - first.range).abs();
                    let width = second.range.min(first.range) * increment * gap as f32;
                    let is_edge = step > EDGE_STEP_MIN_M + EDGE_TANGENT * width;
                    first.joined = step < EDGE_STEP_MIN_M + JOINED_TANGENT * width;
                    first.beside_edge |= is_edge;
                    second.beside_edge |= is_edge;
                }
            }
            rest = tail;
        }
    }

    /// Leaves the returns of the floor out; the surface before one does not continue behind it.
    fn leave_out(&mut self, floor: FloorLine) {
        let Self {
            returns, cos, sin, ..
        } = self;
        let mut was_left_out = false;
        for index in (0..returns.len()).rev() {
            let Some(one) = returns.get_mut(index) else {
                continue;
            };
            one.joined &= !was_left_out;
            let beam = one.beam as usize;
            let direction = cos.get(beam).zip(sin.get(beam));
            was_left_out = direction.is_some_and(|(&c, &s)| floor.drops(c, s, one.range));
            one.is_floor = was_left_out;
        }
        returns.retain(|one| !one.is_floor);
    }

    /// Cosines and sines of the beams' angles, of the last scan.
    pub fn directions(&self) -> (&[f32], &[f32]) {
        (&self.cos, &self.sin)
    }

    fn emit(&self, scan: &Scan, time_increment: f32, points: &mut ScanPoints) {
        points.clear();
        let beams = scan.ranges_m().len() as f32;
        let stride = self.returns.len().div_ceil(POINTS_MAX).max(1);
        let mut is_joined = false;
        for (group, chunk) in self.returns.chunks(stride).enumerate() {
            // Of a group one is taken, which one by a hash: no pattern of the scene can hide in it.
            let choice = hash(group as u32) as usize % chunk.len();
            for (index, taken) in chunk.iter().enumerate() {
                if index == choice && !taken.beside_edge {
                    self.emit_return(taken, beams, time_increment, points, is_joined);
                    is_joined = true;
                }
                is_joined &= taken.joined;
            }
        }
    }

    /// Adds one return; `is_joined` is true if its surface continues back to the point before it.
    fn emit_return(
        &self,
        taken: &Return,
        beams: f32,
        time_increment: f32,
        points: &mut ScanPoints,
        is_joined: bool,
    ) {
        let beam = taken.beam as usize;
        let (Some(c), Some(s)) = (self.cos.get(beam), self.sin.get(beam)) else {
            return;
        };
        let from_middle = beam as f32 - 0.5 * (beams - 1.0);
        points.join_last(is_joined);
        points.push(Point {
            x: taken.range * c,
            y: taken.range * s,
            tau_s: from_middle * time_increment,
            phase: from_middle / beams,
            inverse_range: taken.range.recip(),
            joined: false,
        });
    }
}

/// A fixed integer hash (a finaliser after Steele et al.): the same choice on every machine.
fn hash(value: u32) -> u32 {
    let mut h = value.wrapping_add(0x9e37_79b9);
    h = (h ^ (h >> 16)).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    h ^ (h >> 16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RobotTime;

    fn points_of(ranges: &[f32], increment: f64, time_increment_s: f64) -> ScanPoints {
        let shape = ScanShape {
            angle_min_rad: 0.0,
            angle_increment_rad: increment,
            time_increment_s,
            range_min_m: 0.1,
            range_max_m: 30.0,
        };
        let scan = Scan::new(RobotTime(1), shape, ranges.to_vec().into()).unwrap();
        let mut points = ScanPoints::default();
        BeamFilter::default().filter(&scan, time_increment_s, None, &mut points);
        points
    }

    #[test]
    fn only_finite_ranges_inside_the_limits_are_points() {
        let ranges = [
            f32::NAN,
            f32::INFINITY,
            -1.0,
            0.05,
            30.0,
            5.0,
            f32::NEG_INFINITY,
        ];
        let points: Vec<_> = points_of(&ranges, 0.01, 0.0).iter().collect();
        assert_eq!(points.len(), 1);
        assert!((points[0].x - 5.0 * 0.05_f32.cos()).abs() < 1e-6);
        assert!((points[0].inverse_range - 0.2).abs() < 1e-7);
    }

    #[test]
    fn times_are_about_the_middle_of_the_scan() {
        let points = points_of(&[3.0; 101], 0.01, 1e-3);
        let times: Vec<_> = points.iter().map(|point| point.tau_s).collect();
        assert!((times[0] + 0.05).abs() < 1e-6 && (times[100] - 0.05).abs() < 1e-6);
        assert!((points.mean_tau2_s2() - 0.1 * 0.1 / 12.0).abs() < 2e-5);
    }

    #[test]
    fn both_sides_of_an_edge_are_left_out() {
        let mut ranges = vec![2.0; 40];
        ranges[20..].fill(6.0);
        let points = points_of(&ranges, 0.006, 0.0);
        assert_eq!(points.len(), 38);
        // The surfaces before and after are not joined over it.
        let joined = points.iter().filter(|point| point.joined).count();
        assert_eq!(joined, 36);
    }

    #[test]
    fn more_beams_than_are_used_are_thinned_evenly_and_always_alike() {
        let points = points_of(&[4.0; 4000], 0.0015, 0.0);
        assert_eq!(points.len(), 1000);
        assert!(points.blocks().iter().all(|block| block.count() <= LANES));
        let again = points_of(&[4.0; 4000], 0.0015, 0.0);
        assert!(
            points
                .iter()
                .zip(again.iter())
                .all(|(a, b)| a.x.to_bits() == b.x.to_bits())
        );
    }
}
