//! Planar LiDAR odometry: the LiDAR's pose in its own odometry frame, scan by scan.
//!
//! The odometry frame is the LiDAR's frame at the first scan, or the frame of a known map. Nothing
//! here knows of wheels, steering or where the LiDAR sits on the vehicle.

mod beam_filter;
mod correlative_search;
mod covariance;
mod fit;
mod floor;
mod local_map;
mod local_motion;
mod motion;
mod normal_equations;
mod point_to_line;
mod range_errors;
mod scanner;
mod sensitivity;
mod submap;
mod surroundings;
mod tracking;

use std::sync::Arc;

use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use crate::RobotTime;
use crate::field::FieldRefused;
use crate::geometry::Pose2;
use crate::occupancy_grid::{ORIGIN_MAX_M, OccupancyGrid};
use crate::scan::Scan;
use beam_filter::{BeamFilter, ScanPoints};
use covariance::OpenDirection;
use fit::Fit;
use floor::{FloorWatch, LearntFloor};
use local_map::LocalMap;
use local_motion::LocalMotion;
use motion::Motion;
use point_to_line::Alignment;
use scanner::{Remap, Scanner};
use submap::{KnownMap, LocalOrigin};
use tracking::Track;

pub use floor::FloorLine;
pub use scanner::{BeamTimes, ScannerReport};
pub use surroundings::Surroundings;
pub use tracking::Tracking;

/// Result of LiDAR odometry for one scan.
#[derive(Debug, Clone, PartialEq)]
pub struct OdometryPose {
    /// The scan's reference time.
    pub stamp: RobotTime,
    /// The LiDAR's pose in the odometry frame at that time.
    pub lidar_in_odom: Pose2,
    /// Covariance of (x, y, yaw) in the LiDAR's own frame (a right perturbation), m and rad.
    pub covariance: Matrix3<f64>,
    /// Direction in the LiDAR's frame that the scene leaves open (a corridor's axis), rad.
    pub unconstrained_rad: Option<f64>,
    /// Share of the used beams that lie on the map, 0 to 1.
    pub fitness: f64,
    /// Trust in the pose.
    pub tracking: Tracking,
    /// True if the map was begun again with this scan: poses before and after do not compare.
    pub map_restarted: bool,
    /// Cause that misled the poses before, as this scan shows.
    pub misled_by: Option<MisledBy>,
}

/// Cause that misled the poses before a scan that shows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MisledBy {
    /// Returns of the floor counted as a wall's.
    Floor,
    /// Scanner that turns within a scan counted as one that does not.
    BeamTimes,
}

/// Fewest usable returns of a scan.
const POINTS_MIN: usize = 20;
/// Most Gauss-Newton iterations.
const ITERATIONS_MAX: usize = 8;
/// Largest step that ends the iteration, m and rad.
const STEP_MIN: f64 = 5e-5;
/// Corrections of a map's first scan with the motion that results from it.
const FIRST_REDONE: usize = 3;
/// Range noise of a scanner before it is measured, m.
const RANGE_NOISE_AT_START_M: f32 = 0.02;
/// Fewest points on which range noise is measured.
const NOISE_POINTS_MIN: f32 = 50.0;
/// Stride of the points that are used where a fit is judged.
const ASSESS_STRIDE: usize = 3;
/// Fewest updates of a map that shows the scanner's errors: a younger one repeats the scan.
const ASKED_FROM_UPDATE: u32 = 8;
/// Motion since the last scan, m or rad, beyond which a scan whose ranges all repeat that one's was
/// sent twice.
const REPEATED_MOTION: f64 = 0.01;
/// Time between scans, s, from which their bend by acceleration counts where their pose is searched
/// for. Shorter ones are bent by a quarter of that or less, and the velocity of one that the floor
/// made fit poorly is not to be trusted.
const BENT_FROM_S: f64 = 0.15;

/// Knowledge of the scanner that LiDAR odometry has learnt: it holds as long as the scanner does,
/// in any map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LearntScanner {
    scanner: Scanner,
    range_noise_m: f32,
    #[serde(default)]
    floor: LearntFloor,
}

/// LiDAR odometry of one robot.
#[derive(Debug, Clone)]
pub struct LidarOdometry {
    beam_filter: BeamFilter,
    points: ScanPoints,
    map: LocalMap,
    motion: Option<Motion>,
    /// Reference time of the last scan, once there was one.
    last_stamp: Option<RobotTime>,
    last_ranges: Vec<f32>,
    /// The scan that began the map, until its distortion is known.
    first_scan: Option<(ScanPoints, RobotTime, Pose2)>,
    range_noise_m: f32,
    scanner: Scanner,
    floor: FloorWatch,
    track: Track,
}

/// A pose of a scan, and how it fits there.
#[derive(Debug, Clone)]
struct Solution {
    motion: Motion,
    fit: Fit,
    open: Option<OpenDirection>,
    /// Squared residuals over their variances, and the number of them.
    chi2: (f32, f32),
}

impl Default for LidarOdometry {
    fn default() -> Self {
        Self {
            beam_filter: BeamFilter::default(),
            points: ScanPoints::default(),
            map: LocalMap::default(),
            motion: None,
            last_stamp: None,
            last_ranges: Vec::new(),
            first_scan: None,
            range_noise_m: RANGE_NOISE_AT_START_M,
            scanner: Scanner::default(),
            floor: FloorWatch::default(),
            track: Track::default(),
        }
    }
}

impl LidarOdometry {
    /// Localises in a map that was made before, from a start known to half a metre and 15 degrees;
    /// farther off it reports that it is lost, and looks around for the place. Poses are the
    /// LiDAR's in the map. Beside the map it keeps the LiDAR's surroundings as it does without one;
    /// the map itself never changes. A grid places a wall to within half a cell, so motions over a
    /// few metres are known better without it.
    ///
    /// # Errors
    /// Names the start when it is no pose.
    pub fn with_map(grid: &OccupancyGrid, lidar_in_map: Pose2) -> Result<Self, FieldRefused> {
        let Pose2 { x_m, y_m, yaw_rad } = lidar_in_map;
        if !lidar_in_map.is_finite() || x_m.abs() > ORIGIN_MAX_M || y_m.abs() > ORIGIN_MAX_M {
            let accepted = "a finite pose within 1000 km";
            let value = format!("[{x_m}, {y_m}, {yaw_rad}]");
            return Err(FieldRefused::new("start", value, accepted));
        }
        Ok(Self {
            map: LocalMap::knowing(Arc::new(KnownMap::new(grid))),
            motion: Some(Motion::searched(lidar_in_map, None)),
            track: Track::in_known_map(),
            ..Self::default()
        })
    }

    /// Processes one scan and returns the LiDAR's pose; `None` when the scan has too few returns,
    /// is not later than the last one, or repeats it.
    pub fn process(&mut self, scan: &Scan) -> Option<OdometryPose> {
        // 1. Beams to points.
        let stamp = self.read(scan);
        if self.points.len() < POINTS_MIN {
            return None;
        }
        let Some(last) = self.motion.clone() else {
            let start = Motion::starting_at(Pose2::IDENTITY);
            return Some(self.begin_map(start, stamp, Tracking::Tracking));
        };

        // 2. Where the LiDAR should be by its own motion.
        let dt = self.last_stamp.map(|before| stamp.seconds_since(before));
        if dt.is_some_and(|dt| dt <= 0.0 || self.repeats(scan, &last, dt)) {
            return None;
        }
        self.last_stamp = Some(stamp);
        if let Some(interval_s) = dt {
            self.scanner.note_interval(interval_s);
        }
        let predicted = dt.map_or_else(|| last.clone(), |dt| last.predicted(dt));

        // 3. Alignment from there; where it does not fit, from the best poses of a coarse search.
        let mut solution = self.align(&predicted)?;
        if self.track.distrusts(&solution.fit) || Track::is_vague(&predicted) {
            self.search(&mut solution, &predicted, dt.unwrap_or_default());
        }

        // 4. Is it to be believed?
        if !self.track.accepts(&solution.fit) {
            return Some(self.remain_lost(&predicted, &solution, stamp));
        }
        let tracking = self.track.found(&solution.fit, solution.open.is_some());

        // 5. The map learns.
        if let Some((first, first_stamp, first_pose)) = self.first_scan.take() {
            self.redo_first(&first, (first_stamp, stamp), first_pose, &mut solution);
        }
        if self.map.submap.known().is_none() {
            self.learn_noise(solution.chi2);
        }
        let is_due = self.map.is_due(&solution.motion.pose, stamp);
        let (misled_by, begins_again) = self.learn_of_scanner(scan, is_due, &solution);
        if begins_again {
            let stamp = self.read(scan);
            return Some(OdometryPose {
                misled_by,
                ..self.begin_map(solution.motion, stamp, tracking)
            });
        }
        if is_due {
            self.map
                .update(&self.points, &solution.motion, stamp, self.range_noise_m);
        }

        // 6. The result.
        self.motion = Some(solution.motion.clone());
        Some(OdometryPose {
            stamp,
            lidar_in_odom: solution.motion.pose,
            covariance: covariance::of_pose(
                &solution.motion,
                &predicted,
                self.points.mean_tau2_s2(),
            ) + self.scanner.pose_covariance(),
            unconstrained_rad: solution.open.map(|open| open.angle_rad()),
            fitness: solution.fit.fitness(),
            tracking,
            map_restarted: false,
            misled_by,
        })
    }

    /// Turns a scan into points; returns the time of its middle, which its pose is for.
    fn read(&mut self, scan: &Scan) -> RobotTime {
        let time_increment_s = self.scanner.time_increment_s(scan);
        self.beam_filter
            .filter(scan, time_increment_s, self.floor.line(), &mut self.points);
        scan.middle_stamp(time_increment_s)
    }

    /// Bytes held for this robot, without a known map, which clones share.
    pub fn memory_bytes(&self) -> usize {
        self.map.memory_bytes()
            + self.points.memory_bytes()
            + self.beam_filter.memory_bytes()
            + self.floor.memory_bytes()
            + self.last_ranges.capacity() * size_of::<f32>()
            + self
                .first_scan
                .as_ref()
                .map_or(0, |(points, _, _)| points.memory_bytes())
    }

    /// Knowledge of the scanner: the times of its beams, the errors of its ranges, and its line of
    /// the floor.
    pub fn scanner(&self) -> ScannerReport {
        self.scanner.report(self.floor.line())
    }

    /// Knowledge of the scanner, to begin another odometry with.
    pub fn learnt_scanner(&self) -> LearntScanner {
        LearntScanner {
            scanner: self.scanner.without_map(),
            range_noise_m: self.range_noise_m,
            floor: self.floor.learnt(),
        }
    }

    /// Replaces the scanner by one that was learnt before.
    #[must_use]
    pub fn with_scanner(mut self, learnt: LearntScanner) -> Self {
        self.scanner = learnt.scanner;
        self.range_noise_m = learnt.range_noise_m;
        self.floor = FloorWatch::knowing(learnt.floor);
        self
    }

    /// Forgets the LiDAR's pose and the local map: the next scan may be of any time and from any
    /// place. The scanner stays, and so does a map that was made before, in which the LiDAR is
    /// looked for around its last place.
    pub fn begin_anew(&mut self) {
        self.map.clear();
        self.first_scan = None;
        self.last_stamp = None;
        self.floor.break_off();
        let is_known = self.map.submap.known().is_some();
        let last = self.motion.take().filter(|_| is_known);
        self.motion = last.map(|last| Motion::searched(last.pose, None));
        self.track = if is_known {
            Track::in_known_map()
        } else {
            Track::default()
        };
    }

    /// The scanner's range noise as measured so far, m (one sigma).
    pub fn range_noise_m(&self) -> f64 {
        f64::from(self.range_noise_m)
    }

    /// Begins the map with the present scan, at this motion.
    fn begin_map(&mut self, motion: Motion, stamp: RobotTime, tracking: Tracking) -> OdometryPose {
        let pose = motion.pose;
        self.scanner.note_map();
        self.map.clear();
        self.floor.break_off();
        self.map
            .update(&self.points, &motion, stamp, self.range_noise_m);
        // A scan whose motion is known is corrected for it already.
        self.first_scan = (!motion.is_known()).then(|| (self.points.clone(), stamp, pose));
        self.last_stamp = Some(stamp);
        self.track = Track::default();
        let covariance = covariance::of_pose(&motion, &motion, 0.0);
        self.motion = Some(motion);
        OdometryPose {
            stamp,
            lidar_in_odom: pose,
            covariance,
            unconstrained_rad: None,
            fitness: 1.0,
            tracking,
            map_restarted: true,
            misled_by: None,
        }
    }

    /// True if the driver sent the last scan again, under a new stamp. At rest this is no fault.
    fn repeats(&mut self, scan: &Scan, last: &Motion, dt: f64) -> bool {
        let is_equal = self.last_ranges == scan.ranges_m();
        if !is_equal {
            self.last_ranges.clear();
            self.last_ranges.extend_from_slice(scan.ranges_m());
        }
        is_equal && (last.velocity * dt).amax() > REPEATED_MOTION
    }

    /// Gauss-Newton from a prediction: each iteration corrects the scan with the velocity found
    /// by the one before. The fit is that of the last but one, whose pose is less than [`STEP_MIN`] off.
    fn align(&self, predicted: &Motion) -> Option<Solution> {
        let mut information = predicted.information()?;
        let origin = LocalOrigin::near(predicted.pose.x_m, predicted.pose.y_m);
        let alignment = self.alignment();
        let mut motion = predicted.clone();
        let mut open = None;
        let mut chi2 = (0.0, 0.0);
        let mut matches = alignment.unmatched();
        let mut is_settled = false;
        for iteration in 0..ITERATIONS_MAX {
            let local = LocalMotion::new(&motion, origin);
            let stride = if iteration == 0 { 2 } else { 1 };
            let mut equations = alignment.linearise(&local, stride, &mut matches);
            if let Some(direction) = covariance::suspect_direction(&equations) {
                let facing = alignment.information_facing(&local, direction, &mut matches);
                open = covariance::is_open(facing).then_some(OpenDirection { direction });
            }
            if let Some(open) = &open {
                open.remove_from(&mut equations);
                information = open.decouple(&predicted.covariance).cholesky()?.inverse();
            }
            let (correction, covariance) = predicted.step(&information, &motion, &equations)?;
            predicted.correct(&mut motion, &correction);
            motion.covariance = covariance;
            chi2 = (equations.chi2, equations.on_map);
            is_settled = iteration > 0 && correction.fixed_rows::<3>(0).amax() < STEP_MIN;
            if is_settled {
                break;
            }
        }
        let local = LocalMotion::new(&motion, origin);
        if !is_settled {
            alignment.linearise(&local, 1, &mut matches);
        }
        let fit = alignment.assess(&local, &self.map.free_space, &matches, ASSESS_STRIDE);
        Some(Solution {
            motion,
            fit,
            open,
            chi2,
        })
    }

    fn alignment(&self) -> Alignment<'_> {
        Alignment {
            points: &self.points,
            submap: &self.map.submap,
            range_noise_m: self.range_noise_m,
            range_errors: self.scanner.range_errors(),
        }
    }

    /// Learns of the scanner from the aligned scan. Returns the cause that misled the poses before,
    /// and whether the map has to be begun again.
    fn learn_of_scanner(
        &mut self,
        scan: &Scan,
        is_due: bool,
        solution: &Solution,
    ) -> (Option<MisledBy>, bool) {
        if self.learn_floor(scan, solution) {
            return (Some(MisledBy::Floor), self.map.submap.known().is_none());
        }
        let remap = self.learn_beam_times_and_ranges(is_due, solution);
        let turns_after_all = remap == Some(Remap::TurnsAfterAll);
        (
            turns_after_all.then_some(MisledBy::BeamTimes),
            remap.is_some(),
        )
    }

    /// Learns of beam times and ranges. Returns the reason to begin the map again, if any. A known
    /// map is off by its own cells, and an open direction would be learnt from noise.
    fn learn_beam_times_and_ranges(&mut self, is_due: bool, solution: &Solution) -> Option<Remap> {
        if !is_due && !self.scanner.asks_at_once(&solution.motion) {
            return None;
        }
        let submap = &self.map.submap;
        let is_young = submap.updates() < ASKED_FROM_UPDATE;
        let is_poor = solution.open.is_some() || !solution.fit.is_good();
        if submap.known().is_some() || is_young || is_poor {
            return None;
        }
        let motion = &solution.motion;
        let origin = LocalOrigin::near(motion.pose.x_m, motion.pose.y_m);
        let local = LocalMotion::new(motion, origin);
        let phase = self.map.submap.updates() as usize;
        let equations = self.alignment().ask_scanner(&local, phase);
        self.scanner.learn(&equations, motion)
    }

    /// Looks for the floor in the aligned scan. Returns true if it is found: the map so far held
    /// the floor, and so does what was learnt of the ranges in it. Along an open direction the
    /// LiDAR's way is not known.
    fn learn_floor(&mut self, scan: &Scan, solution: &Solution) -> bool {
        if solution.open.is_some() {
            self.floor.break_off();
            return false;
        }
        let directions = self.beam_filter.directions();
        let found = self.floor.take(&solution.motion.pose, directions, scan);
        if found && self.map.submap.known().is_some() {
            self.map.clear();
        } else if found {
            self.scanner.widen();
        }
        found
    }

    /// Looks for a better pose than `solution` around the prediction, and where the last scan was:
    /// the velocity of one that people hid half of may be wrong. Where `solution` fits, only a few poses
    /// count that the prediction allows for.
    fn search(&self, solution: &mut Solution, predicted: &Motion, dt: f64) {
        let mut window = self.track.window(dt);
        let mut last = self.motion.as_ref().map(|motion| motion.pose);
        let mut candidates = correlative_search::CANDIDATES;
        if !self.track.distrusts(&solution.fit) {
            window = window.within(predicted.pose_reach());
            last = None;
            candidates = correlative_search::CANDIDATES_BESIDE;
        }
        let poses = correlative_search::search(
            &self.points,
            &self.map.submap,
            predicted.pose,
            &LocalMotion::new(predicted, LocalOrigin::near(0.0, 0.0)),
            window,
            candidates,
        );
        // The velocity at a map's first scan is not known.
        let is_tracked = !self.track.is_lost() && self.first_scan.is_none();
        let tracked = (is_tracked && dt >= BENT_FROM_S).then_some(predicted);
        for pose in last.into_iter().chain(poses) {
            if let Some(found) = self.align(&Motion::searched(pose, tracked))
                && found.fit.beats(&solution.fit)
            {
                *solution = found;
            }
        }
    }

    /// Holds a scan that fits nowhere at the last sure pose, reports it as lost, and in the end
    /// gives the map up.
    fn remain_lost(
        &mut self,
        predicted: &Motion,
        solution: &Solution,
        stamp: RobotTime,
    ) -> OdometryPose {
        let tracking = self.track.lost();
        self.floor.break_off();
        if self.track.gives_up() && self.map.submap.known().is_some() {
            // What was seen may have misled it; the known map has not changed.
            self.map.clear();
            self.track.forget();
        } else if self.track.gives_up() {
            let start = Motion::starting_at(predicted.pose);
            return self.begin_map(start, stamp, Tracking::Recovered);
        }
        let window = self.track.window(0.0);
        let motion = predicted.lost(window.reach_m, window.yaw_rad);
        let pose = OdometryPose {
            stamp,
            lidar_in_odom: motion.pose,
            covariance: covariance::of_pose(&motion, &motion, 0.0),
            unconstrained_rad: solution.open.map(|open| open.angle_rad()),
            fitness: solution.fit.fitness(),
            tracking,
            map_restarted: false,
            misled_by: None,
        };
        self.motion = Some(motion);
        pose
    }

    /// Makes the map again from the first scan, which went into it distorted by an unknown motion,
    /// now that the second one is aligned: with the velocity between the two, and aligns the second
    /// scan again. Within the scans that velocity would not show: two that are corrected with the
    /// same wrong one lie on each other.
    fn redo_first(
        &mut self,
        first: &ScanPoints,
        (first_stamp, stamp): (RobotTime, RobotTime),
        pose: Pose2,
        solution: &mut Solution,
    ) {
        let dt = stamp.seconds_since(first_stamp);
        for _ in 0..FIRST_REDONE {
            let mut motion = Motion::starting_at(pose);
            motion.velocity = pose.between(&solution.motion.pose).log() / dt;
            self.map.clear();
            self.map
                .update(first, &motion, first_stamp, self.range_noise_m);
            if let Some(again) = self.align(&motion.predicted(dt)) {
                *solution = again;
            }
        }
    }

    fn learn_noise(&mut self, (chi2, points): (f32, f32)) {
        if points < NOISE_POINTS_MIN {
            return;
        }
        let ratio = (chi2 / points).clamp(0.25, 4.0);
        self.range_noise_m = (self.range_noise_m * ratio.powf(0.05)).clamp(0.003, 0.06);
    }
}
