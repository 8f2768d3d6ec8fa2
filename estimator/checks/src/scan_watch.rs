//! Content of scans: units, returns, own body, repetition and the times of beams.

use std::f64::consts::TAU;

use fleetcal_odometry::Scan;

use crate::cause::Cause;
use crate::finding::Suspicion;
use crate::fit::quantile;

/// Scans from one that is looked at closely to the next.
const LOOKED_AT_EVERY: u64 = 5;
/// Fewest scans of either kind that show anything.
const LOOKED_AT_MIN: u32 = 5;
const SCANS_MIN: u64 = 40;
/// Share of the scans looked at that has to show the same.
const AGREED_SHARE: f64 = 0.8;
/// Range below which nine ranges in ten lie where they are in metres, m.
const METRES_MAX: f64 = 90.0;
/// Share of beams with a return below which a scan shows little.
const RETURNS_MIN: f64 = 0.1;
/// Share of beams with exactly the scan's largest range that is no accident.
const LARGEST_MIN_SHARE: f64 = 0.1;
/// Share of scans that repeat the one before that is no accident.
const REPEATED_MIN: f64 = 0.2;
/// Number of scans within the duration of one, from which there are two scanners.
const CROWDED: f64 = 1.6;
/// Largest relative difference between the time of a turn by its beams and the time between scans.
const TURN_OFF_MAX: f64 = 0.15;
/// Change of the first beam's direction from segment to segment, rad.
const SEGMENT_STEP_RAD: f64 = 0.2;

/// Scans of one robot.
#[derive(Debug, Clone, Default)]
pub(crate) struct ScanWatch {
    scans: u64,
    looked_at: u32,
    in_millimetres: u32,
    largest_range: f64,
    with_few_returns: u32,
    returns: f64,
    with_one_range: u32,
    one_range_m: f32,
    last_content: u64,
    repeated: u64,
    first_beam_rad: f64,
    segments: u64,
    scan_time_s: f64,
    /// Time of a full turn by its beams, s; 0 where they have no times.
    turn_s: f64,
    body: BodyWatch,
}

impl ScanWatch {
    /// Adds a scan and the time from one scan to the next that it states, s (0 for none).
    pub fn take(&mut self, scan: &Scan, scan_time_s: f64) {
        let shape = scan.shape();
        let content = content_of(scan.ranges_m());
        let is_turned = (shape.angle_min_rad - self.first_beam_rad).abs() > SEGMENT_STEP_RAD;
        if self.scans > 0 {
            self.repeated += u64::from(content == self.last_content);
            self.segments += u64::from(is_turned);
        }
        (self.last_content, self.first_beam_rad) = (content, shape.angle_min_rad);
        self.scan_time_s = scan_time_s;
        self.turn_s = shape.time_increment_s * TAU / shape.angle_increment_rad.abs();
        if self.scans.is_multiple_of(LOOKED_AT_EVERY) {
            self.look_at(scan);
        }
        self.scans += 1;
    }

    /// Notes the robot's way so far, by its LiDAR or its wheels, m.
    pub fn moved_to(&mut self, way_m: f64) {
        self.body.way_m = self.body.way_m.max(way_m);
    }

    /// Notes the LiDAR's heading, rad.
    pub fn turned_to(&mut self, heading_rad: f64) {
        self.body.heading_rad = heading_rad;
    }

    fn look_at(&mut self, scan: &Scan) {
        let shape = scan.shape();
        self.looked_at += 1;
        let ranges = scan.ranges_m().iter();
        let mut positive: Vec<f64> = ranges
            .filter(|range| range.is_finite() && **range > 0.0)
            .map(|range| f64::from(*range))
            .collect();
        let valid = |range: &f64| (shape.range_min_m..shape.range_max_m).contains(range);
        let beams = scan.ranges_m().len() as f64;
        let returns = positive.iter().filter(|range| valid(range)).count() as f64 / beams;
        self.returns += returns;
        self.with_few_returns += u32::from(returns < RETURNS_MIN);
        if positive.len() as f64 > 0.1 * beams {
            let most = quantile(&mut positive, 0.9);
            self.in_millimetres += u32::from(most > METRES_MAX);
            self.largest_range = most;
        }
        let in_limits = positive.iter().copied().filter(valid);
        let largest_m = in_limits.fold(0.0, f64::max) as f32;
        let equal = scan
            .ranges_m()
            .iter()
            .filter(|range| (**range - largest_m).abs() < 1e-4)
            .count();
        if equal as f64 > LARGEST_MIN_SHARE * beams && largest_m > 0.0 {
            let is_same = (largest_m - self.one_range_m).abs() < 1e-3;
            self.with_one_range = if is_same { self.with_one_range + 1 } else { 1 };
            self.one_range_m = largest_m;
        }
        self.body.take(scan);
    }

    /// Returns the suspicion at this median time between stamps, s: a single one, since it explains the others.
    pub fn suspicion(&self, period_s: Option<f64>, has_one_frame: bool) -> Option<Suspicion> {
        let content = self.content();
        if content.is_some() || self.scans < SCANS_MIN {
            return content;
        }
        let scans = self.scans as f64;
        if self.segments as f64 > 0.5 * scans {
            let seen = "scans begin at another angle each time".to_owned();
            return Some(Suspicion::new(Cause::Segments, seen));
        }
        if self.repeated as f64 > REPEATED_MIN * scans {
            let share = 100.0 * self.repeated as f64 / scans;
            let seen = format!("{share:.0} % of the scans have the ranges of the one before");
            return Some(Suspicion::new(Cause::RepeatedScans, seen));
        }
        self.timing(period_s?, has_one_frame)
    }

    fn content(&self) -> Option<Suspicion> {
        let agrees = |count: u32| {
            self.looked_at >= LOOKED_AT_MIN
                && f64::from(count) > AGREED_SHARE * f64::from(self.looked_at)
        };
        let most = self.largest_range;
        let (cause, seen) = if agrees(self.in_millimetres) {
            let unit = if most > 4_000.0 {
                "millimetres"
            } else {
                "centimetres or millimetres"
            };
            (
                Cause::Millimetres,
                format!("nine ranges in ten are below {most:.0}: {unit}"),
            )
        } else if agrees(self.with_few_returns) {
            let share = 100.0 * self.returns();
            (
                Cause::FewReturns,
                format!("{share:.0} % of the beams have a return"),
            )
        } else if agrees(self.with_one_range) {
            let range_m = self.one_range_m;
            (
                Cause::OneRange,
                format!("more than a tenth of the beams have a range of {range_m:.2} m"),
            )
        } else {
            let share = 100.0 * self.body.fixed()?;
            (
                Cause::OwnBody,
                format!("{share:.0} % of the beams have one range while the robot drives"),
            )
        };
        Some(Suspicion::new(cause, seen))
    }

    fn timing(&self, period_s: f64, has_one_frame: bool) -> Option<Suspicion> {
        let Self {
            scan_time_s,
            turn_s,
            ..
        } = *self;
        if has_one_frame && scan_time_s > CROWDED * period_s && turn_s > CROWDED * period_s {
            let seen = format!(
                "scans come every {:.0} ms, each said to take {:.0} ms",
                1e3 * period_s,
                1e3 * scan_time_s
            );
            return Some(Suspicion::new(Cause::SeveralScanners, seen));
        }
        // A scanner may leave out turns, so that a turn is shorter than the time between scans.
        let is_longer = turn_s > (1.0 + TURN_OFF_MAX) * period_s;
        let states_period = (scan_time_s / period_s - 1.0).abs() < 0.05;
        let contradicts =
            states_period && turn_s > 0.0 && turn_s < (1.0 - TURN_OFF_MAX) * scan_time_s;
        (has_one_frame && (is_longer || contradicts)).then(|| {
            let seen = format!(
                "by time_increment a turn takes {:.0} ms, and scans come every {:.0} ms",
                1e3 * turn_s,
                1e3 * period_s
            );
            Suspicion::new(Cause::BeamTimes, seen)
        })
    }

    /// Returns `true` once enough scans were seen to judge them.
    pub fn is_judged(&self) -> bool {
        self.scans >= SCANS_MIN && self.looked_at >= LOOKED_AT_MIN
    }

    /// Share of the beams with a return.
    pub fn returns(&self) -> f64 {
        self.returns / f64::from(self.looked_at.max(1))
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        self.body.beams.capacity() * size_of::<Spread>()
    }
}

/// Number that differs where a range does.
fn content_of(ranges_m: &[f32]) -> u64 {
    let mix = |content: u64, range: &f32| {
        (content.rotate_left(5) ^ u64::from(range.to_bits())).wrapping_mul(0x9e37_79b9_7f4a_7c15)
    };
    ranges_m.iter().fold(0, mix)
}

/// Beams that are followed.
const BODY_BEAMS: usize = 120;
/// Way between two scans that are compared, m.
const BODY_EVERY_M: f64 = 0.3;
/// Scans and turn (rad) after which a wall beside the robot has changed its range.
const BODY_SCANS_MIN: u32 = 40;
const BODY_TURN_MIN_RAD: f64 = 2.5;
/// Spread of the range of a beam that hits the robot, m.
const BODY_SPREAD_MAX_M: f32 = 0.05;
/// Spread, longest range and way, m, where the LiDAR's odometry is misled by the body.
const BODY_UNTURNED_SPREAD_MAX_M: f32 = 0.02;
const BODY_RANGE_MAX_M: f32 = 2.0;
const BODY_UNTURNED_WAY_M: f64 = 30.0;
/// Share of the beams that hit the robot that is reported.
const BODY_MIN_SHARE: f64 = 0.3;

/// Range of a beam so far.
#[derive(Debug, Clone, Copy, Default)]
struct Spread {
    count: u16,
    mean_m: f32,
    squares_m2: f32,
}

/// Finds beams whose range stays the same while the robot drives and turns.
#[derive(Debug, Clone, Default)]
struct BodyWatch {
    beams: Vec<Spread>,
    of_beams: usize,
    scans: u32,
    way_m: f64,
    taken_at_m: f64,
    heading_rad: f64,
    headings_rad: Option<(f64, f64)>,
}

impl BodyWatch {
    fn take(&mut self, scan: &Scan) {
        let ranges = scan.ranges_m();
        if ranges.len() != self.of_beams {
            self.of_beams = ranges.len();
            self.beams = vec![Spread::default(); BODY_BEAMS.min(ranges.len())];
            (self.scans, self.headings_rad) = (0, None);
        }
        if self.scans > 0 && self.way_m < self.taken_at_m + BODY_EVERY_M {
            return;
        }
        self.taken_at_m = self.way_m;
        self.scans += 1;
        let heading_rad = self.heading_rad;
        let (low, high) = self.headings_rad.unwrap_or((heading_rad, heading_rad));
        self.headings_rad = Some((low.min(heading_rad), high.max(heading_rad)));
        let beams = self.beams.len().max(1);
        for (number, beam) in self.beams.iter_mut().enumerate() {
            let Some(range_m) = ranges.get(number * ranges.len() / beams) else {
                continue;
            };
            let limits = scan.shape().range_min_m..scan.shape().range_max_m;
            if range_m.is_finite() && limits.contains(&f64::from(*range_m)) {
                beam.count = beam.count.saturating_add(1);
                let off_m = range_m - beam.mean_m;
                beam.mean_m += off_m / f32::from(beam.count);
                beam.squares_m2 += off_m * (range_m - beam.mean_m);
            }
        }
    }

    /// Share of the beams that hit the robot, where that is much.
    fn fixed(&self) -> Option<f64> {
        let turned = self
            .headings_rad
            .is_some_and(|(low, high)| high - low > BODY_TURN_MIN_RAD);
        if self.scans < BODY_SCANS_MIN || !(turned || self.way_m > BODY_UNTURNED_WAY_M) {
            return None;
        }
        let (spread_m, range_m) = if turned {
            (BODY_SPREAD_MAX_M, f32::INFINITY)
        } else {
            (BODY_UNTURNED_SPREAD_MAX_M, BODY_RANGE_MAX_M)
        };
        let is_fixed = |beam: &&Spread| {
            let spread_m2 = beam.squares_m2 / f32::from(beam.count.max(1));
            u32::from(beam.count) * 2 > self.scans
                && spread_m2 < spread_m * spread_m
                && beam.mean_m < range_m
        };
        let share =
            self.beams.iter().filter(is_fixed).count() as f64 / self.beams.len().max(1) as f64;
        (share > BODY_MIN_SHARE).then_some(share)
    }
}
