//! A rolling 2D LiDAR: each beam is cast from where the sensor is at that beam's own time.

use std::f64::consts::{PI, TAU};

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use super::beams::Beams;
use super::imperfections::ScannerImperfections;
use super::message::Scan;
use super::people::{Crowd, Disc, aside};
use super::plane::{Point, Pose2};
use super::random::{Stream, stream};
use super::ray::{Direction, Met, circle_range_m};
use super::track::Track;
use super::world::World;

/// Fewest beams of a scan.
pub(super) const BEAMS_MIN: u32 = 8;
/// Most beams of a scan.
pub(super) const BEAMS_MAX: u32 = 16_384;

/// The scanner's settings. The default is the scanner of the project's figures.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LidarSettings {
    /// Beams of a scan.
    pub beams: u32,
    /// Scans in a second.
    pub rate_hz: f64,
    /// Angle the beams cover, rad; a full turn at most. A narrower view is centred on x and takes
    /// its part of the turn's time.
    pub field_of_view_rad: f64,
    /// True if the beams run clockwise: the first at the largest angle, negative increment.
    pub clockwise: bool,
    /// True if all beams are measured at the stamp (`time_increment` 0) instead of one by one.
    pub instantaneous: bool,
    /// Range below which a beam has no return, m.
    pub range_min_m: f64,
    /// Range above which a beam has no return, m.
    pub range_max_m: f64,
    /// Standard deviation of a range, m.
    pub range_sigma_m: f64,
    /// Share of the beams that randomly return nothing, 0 to 1.
    pub dropped_beams: f64,
    /// Time from the start of the simulation to the first beam, s.
    pub phase_s: f64,
}

impl Default for LidarSettings {
    fn default() -> Self {
        Self {
            beams: 1024,
            rate_hz: 10.0,
            field_of_view_rad: TAU,
            clockwise: false,
            instantaneous: false,
            range_min_m: 0.2,
            range_max_m: 40.0,
            range_sigma_m: 0.015,
            dropped_beams: 0.0,
            phase_s: 0.0037,
        }
    }
}

impl LidarSettings {
    /// Returns the time from one scan's first beam to the next one's, ns.
    pub(super) fn period_ns(&self) -> i64 {
        (1e9 / self.rate_hz).round() as i64
    }

    /// Returns the time from one beam to the next, s.
    pub fn time_increment_s(&self) -> f64 {
        if self.instantaneous {
            return 0.0;
        }
        self.field_of_view_rad / TAU / self.rate_hz / f64::from(self.beams)
    }

    /// Returns the time from a scan's first beam to its end, ns.
    pub(super) fn duration_ns(&self) -> i64 {
        (self.time_increment_s() * f64::from(self.beams) * 1e9).round() as i64
    }

    /// Returns the time from a scan's first beam to its middle, the time of its pose, ns.
    pub(super) fn reference_ns(&self) -> i64 {
        (0.5e9 * self.time_increment_s() * f64::from(self.beams - 1)).round() as i64
    }

    /// Returns the angle of the first beam and that from one beam to the next, rad.
    pub fn angles_rad(&self) -> (f64, f64) {
        let full = self.field_of_view_rad > TAU - 1e-6;
        let gaps = if full { self.beams } else { self.beams - 1 };
        let first_rad = if full {
            -PI
        } else {
            -0.5 * self.field_of_view_rad
        };
        let increment_rad = self.field_of_view_rad / f64::from(gaps);
        if self.clockwise {
            (-first_rad, -increment_rad)
        } else {
            (first_rad, increment_rad)
        }
    }
}

/// The scanner with its noise and its work space.
#[derive(Debug)]
pub(super) struct Lidar {
    settings: LidarSettings,
    imperfections: ScannerImperfections,
    beams: Beams,
    random: ChaCha8Rng,
    met: Vec<Met>,
    people_ranges_m: Vec<f64>,
    discs_at_start: Vec<Disc>,
    discs_at_end: Vec<Disc>,
}

impl Lidar {
    pub fn new(
        settings: LidarSettings,
        imperfections: ScannerImperfections,
        range_scale: f64,
        seed: u64,
    ) -> Self {
        Self {
            settings,
            imperfections,
            beams: Beams::new(imperfections, range_scale, seed),
            random: stream(seed, Stream::Lidar),
            met: Vec::new(),
            people_ranges_m: Vec::new(),
            discs_at_start: Vec::new(),
            discs_at_end: Vec::new(),
        }
    }

    /// Makes the scan whose first beam is at `time_ns` of simulated time; the track must reach to
    /// its end.
    pub fn scan(&mut self, world: &World, crowd: &mut Crowd, track: &Track, time_ns: i64) -> Scan {
        let settings = self.settings;
        let beams = settings.beams as usize;
        let step_ns = settings.time_increment_s() * 1e9;
        let pose_at = |beam: usize| track.at(time_ns + (beam as f64 * step_ns) as i64).lidar;
        let (angle_min_rad, angle_increment_rad) = settings.angles_rad();
        self.see_people(crowd, time_ns, &pose_at);
        self.met.clear();
        for beam in 0..beams {
            let pose = pose_at(beam);
            let aim = self
                .beams
                .aim(angle_min_rad + beam as f64 * angle_increment_rad);
            let bearing_rad =
                pose.yaw_rad + angle_min_rad + beam as f64 * angle_increment_rad + aim.turned_rad;
            let direction = Direction::from_angle_rad(bearing_rad);
            let wall = world
                .index()
                .met(pose.point(), direction, settings.range_max_m);
            let person_m = self
                .people_ranges_m
                .get(beam)
                .copied()
                .unwrap_or(f64::INFINITY);
            let person = Met {
                range_m: person_m,
                cos_incidence: 1.0,
            };
            let nearer = if person_m < wall.range_m {
                person
            } else {
                wall
            };
            self.met.push(aim.along(nearer));
        }
        self.shown(time_ns)
    }

    /// Makes the scan as it is sent: the hits of its beams, with all effects of the scanner.
    fn shown(&mut self, time_ns: i64) -> Scan {
        let settings = self.settings;
        let (angle_min_rad, angle_increment_rad) = settings.angles_rad();
        let mut met = std::mem::take(&mut self.met);
        self.beams.mix(&mut met);
        let ranges_m = met
            .iter()
            .map(|met| self.measure(self.beams.shown_m(met)))
            .collect();
        self.met = met;
        let late_ns = if self.imperfections.stamped_at_end {
            settings.duration_ns()
        } else {
            0
        };
        let time_increment_s = if self.imperfections.untimed_beams {
            0.0
        } else {
            settings.time_increment_s()
        };
        Scan {
            stamp_ns: time_ns + late_ns,
            angle_min_rad,
            angle_increment_rad,
            time_increment_s,
            scan_time_s: 1.0 / settings.rate_hz,
            range_min_m: settings.range_min_m,
            range_max_m: settings.range_max_m,
            ranges_m,
        }
    }

    fn measure(&mut self, true_m: f64) -> f32 {
        // The same number of draws for each beam: a nearer wall must not shift another beam's noise.
        let noise: f64 = StandardNormal.sample(&mut self.random);
        let dropped = self.settings.dropped_beams > 0.0
            && self.random.random::<f64>() < self.settings.dropped_beams;
        let range_m = true_m + self.settings.range_sigma_m * noise;
        let (min_m, max_m) = (self.settings.range_min_m, self.settings.range_max_m);
        if dropped || !(min_m..=max_m).contains(&range_m) {
            f32::INFINITY
        } else {
            range_m as f32
        }
    }

    /// Casts each person on the few beams that can meet them.
    fn see_people(&mut self, crowd: &mut Crowd, time_ns: i64, pose_at: &impl Fn(usize) -> Pose2) {
        self.people_ranges_m.clear();
        if crowd.is_empty() {
            return;
        }
        let beams = self.settings.beams as usize;
        self.people_ranges_m.resize(beams, f64::INFINITY);
        let (first, last) = (pose_at(0), pose_at(beams - 1));
        let middle = pose_at(beams / 2);
        let start_s = time_ns as f64 * 1e-9;
        let end_s = start_s + self.settings.duration_ns() as f64 * 1e-9;
        crowd.discs_at(start_s, first.point(), &mut self.discs_at_start);
        crowd.discs_at(end_s, last.point(), &mut self.discs_at_end);
        let turn_rad = (last.yaw_rad - first.yaw_rad).abs();
        let travel_m = last.point().distance_m(first.point());
        for (start, end) in self.discs_at_start.iter().zip(&self.discs_at_end) {
            let centre = start.centre.toward(end.centre, 0.5);
            let margin_m = start.radius_m + travel_m + start.centre.distance_m(end.centre);
            let distance_m = centre.distance_m(middle.point());
            if distance_m > self.settings.range_max_m + margin_m {
                continue;
            }
            let half_rad = turn_rad
                + if distance_m > margin_m {
                    (margin_m / distance_m).asin()
                } else {
                    PI
                };
            let bearing_rad = bearing_rad(&middle, centre);
            for beam in beams_around(&self.settings, bearing_rad, half_rad) {
                let pose = pose_at(beam);
                let part = beam as f64 / beams as f64;
                let disc = aside(start.centre.toward(end.centre, part), pose.point());
                let (angle_min_rad, increment_rad) = self.settings.angles_rad();
                let angle_rad = pose.yaw_rad + angle_min_rad + beam as f64 * increment_rad;
                let direction = Direction::from_angle_rad(angle_rad);
                let range_m = circle_range_m(pose.point(), direction, disc, start.radius_m);
                if let Some(nearest_m) = self.people_ranges_m.get_mut(beam) {
                    *nearest_m = nearest_m.min(range_m);
                }
            }
        }
    }
}

/// Returns the bearing of a point in the sensor's frame, rad.
fn bearing_rad(sensor: &Pose2, point: Point) -> f64 {
    (point.y_m - sensor.y_m).atan2(point.x_m - sensor.x_m) - sensor.yaw_rad
}

/// Returns the beams within `half_rad` of a bearing.
fn beams_around(
    settings: &LidarSettings,
    bearing_rad: f64,
    half_rad: f64,
) -> impl Iterator<Item = usize> + use<> {
    let (angle_min_rad, increment_rad) = settings.angles_rad();
    let beams = settings.beams as usize;
    // Counted in beams of a whole turn; those beyond the field of view do not exist.
    let turn = TAU / increment_rad.abs();
    let middle = ((bearing_rad - angle_min_rad) / increment_rad).rem_euclid(turn);
    let half = (half_rad / increment_rad.abs()).min(0.5 * turn);
    let first = (middle - half).floor() as i64;
    let count = (2.0 * half).ceil() as i64 + 2;
    let turn = turn.round() as i64;
    (first..first + count.min(turn))
        .map(move |number| number.rem_euclid(turn) as usize)
        .filter(move |&beam| beam < beams)
}
