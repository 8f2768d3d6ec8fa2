//! Windows of motion: the same 0.4 m by drive and by LiDAR, and their disagreement.

use std::collections::VecDeque;

use nalgebra::{Matrix3, Vector2, Vector3};

use super::evidence::{Evidence, Innovation, WINDOW_CHI2_MAX};
use super::mean_pose::{PAIRS_MAX, Way, mean_pose};
use crate::estimate::Parameter;
use crate::filter::constraint::{ByParameters, LidarMotion};
use crate::filter::prediction::PredictedMotion;
use crate::filter::{OdometryReading, Values, apart, drive_parameters, lidar_in_base};
use crate::motion_noise::MotionNoise;
use crate::stream::RobotTime;

/// Distance after which a window ends, m,
const WINDOW_M: f64 = 0.4;
/// or turn, rad.
const WINDOW_RAD: f64 = 0.2;
/// Time after an end up to which poses are averaged around it, s.
const AROUND_S: f64 = 1.0;

/// Least turn for each radian of steering over a window that shows anything of the steering.
const STEERED_MIN: f64 = 0.1;

/// Way of a window by drive and LiDAR, before any statistics.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Track {
    /// Way of the wheels, m.
    pub driven_m: f64,
    /// Way of the body by the LiDAR, m.
    pub moved_m: f64,
    /// First steering reading, rad.
    pub steering_rad: f64,
    /// Difference between its largest and smallest reading, rad.
    pub steering_spread_rad: f64,
    /// Steering angle by which the LiDAR's turn differs from the drive's, rad.
    pub steering_error_rad: f64,
    /// Its standard deviation by the configured noise, rad.
    pub steering_sigma_rad: f64,
    /// Duration, s.
    pub duration_s: f64,
    /// Distance of the LiDAR from where the wheels would have taken it, m.
    pub off_m: f64,
    /// Distance of it from any point of the way there, m: wheels that slip leave it on that way.
    pub off_way_m: f64,
    /// Sigma of the LiDAR odometry's way, along the direction it knows least, m.
    pub odometry_sigma_m: f64,
}

/// One window: residual of `B X = X Z` under some parameters, linear around them.
#[derive(Debug, Clone)]
pub struct Window {
    /// LiDAR time at its beginning.
    pub begin: RobotTime,
    /// LiDAR time at its end.
    pub end: RobotTime,
    /// Measured less predicted LiDAR motion, in the LiDAR's frame.
    pub residual: Vector3<f64>,
    /// Derivatives of the prediction by the parameters.
    pub jacobian: ByParameters,
    /// Covariance of the residual at the right parameters.
    pub covariance: Matrix3<f64>,
    /// A right perturbation of the LiDAR at the beginning, carried to the end.
    pub carry: Matrix3<f64>,
    /// Part of the covariance that is the motion's.
    pub motion_covariance: Matrix3<f64>,
    /// Part of the covariance that is the pose's at the end.
    pub end_covariance: Matrix3<f64>,
    /// The parameters of the residual.
    pub values: Values,
    /// Way of the window by drive and LiDAR.
    pub track: Track,
    /// Part of the residual that is new.
    pub innovation: Innovation,
    /// Evidence of that part about the parameters.
    pub evidence: Evidence,
}

impl Innovation {
    /// Whitens with `Cov(r_k, r_k-1) = -Ad(h^-1) R_k-1`; `own` is the window's residual as it is.
    fn after(own: Self, carry: &Matrix3<f64>, values: &Values, before: &Window) -> Option<Self> {
        let last = &before.innovation;
        let last_residual = last.residual + last.jacobian * apart(&before.values, values);
        let inverse = last.covariance.cholesky()?.inverse();
        let gain = -carry * before.end_covariance * inverse;
        Some(Self {
            residual: own.residual - gain * last_residual,
            jacobian: own.jacobian - gain * last.jacobian,
            covariance: own.covariance - gain * last.covariance * gain.transpose(),
        })
    }

    fn is_wild(&self, noise_scale: f64) -> bool {
        self.covariance.cholesky().is_none_or(|factor| {
            let square = self.residual.dot(&factor.solve(&self.residual));
            square > WINDOW_CHI2_MAX * noise_scale
        })
    }
}

/// A window's end, as it is known at once.
#[derive(Debug, Clone, Copy)]
pub struct WindowEnd {
    /// LiDAR time at its beginning and at its end.
    pub lasts: (RobotTime, RobotTime),
    /// Way of the window by drive and LiDAR.
    pub track: Track,
}

/// Effects of a reading on the windows, in this order.
#[derive(Debug)]
pub struct Cut<K> {
    /// The ended window before, now complete, with the knowledge at its beginning.
    pub complete: Option<(Window, K)>,
    /// The window that ends with the reading.
    pub end: Option<WindowEnd>,
    /// Same window, where it is complete at once.
    pub complete_at_end: Option<(Window, K)>,
}

/// Start of a window, and the knowledge then.
#[derive(Debug, Clone)]
struct Begin<K> {
    reading: OdometryReading,
    /// The same by the mean of the poses around it.
    mean: OdometryReading,
    known: K,
}

/// A window whose end is known, while poses that follow its end are awaited.
#[derive(Debug, Clone)]
struct Ended<K> {
    begin: Begin<K>,
    end: OdometryReading,
    /// The window by the single poses.
    window: Window,
    before: VecDeque<OdometryReading>,
    after: Vec<OdometryReading>,
    noise: MotionNoise,
    noise_scale: f64,
}

impl<K> Ended<K> {
    /// True if a reading is still around the end; it is averaged then.
    fn awaits(&mut self, reading: &OdometryReading, way: Way<'_>) -> bool {
        let (from, to) = (self.end.stamp, reading.stamp);
        let is_around = to.seconds_since(from) < AROUND_S
            && way.is_covered(from, to)
            && windows_between(&self.end, reading, way) < 0.5;
        if is_around {
            self.after.push(*reading);
        }
        is_around && self.after.len() < PAIRS_MAX.min(self.before.len())
    }
}

/// Cuts a robot's readings into windows, and keeps the knowledge at the beginning of each.
#[derive(Debug, Clone)]
pub struct WindowCutter<K> {
    begin: Option<Begin<K>>,
    /// The newest readings.
    newest: VecDeque<OdometryReading>,
    ended: Option<Box<Ended<K>>>,
    /// The window before, when it ends where the next one begins and nothing wild was in it.
    before: Option<Window>,
}

impl<K> Default for WindowCutter<K> {
    fn default() -> Self {
        Self {
            begin: None,
            newest: VecDeque::with_capacity(PAIRS_MAX),
            ended: None,
            before: None,
        }
    }
}

impl<K> WindowCutter<K> {
    /// Begins again with the next reading; returns the window that has ended and still waited for
    /// poses, by its single ones.
    pub fn restart(&mut self) -> Option<(Window, K)> {
        let mut former = std::mem::take(self);
        let ended = former.ended.take()?;
        let window = former.whiten(ended.window, ended.noise_scale)?;
        Some((window, ended.begin.known))
    }

    /// Adds a reading.
    pub fn push(
        &mut self,
        reading: &OdometryReading,
        way: Way<'_>,
        known: impl FnOnce() -> K,
    ) -> Cut<K> {
        let mut cut = Cut {
            complete: None,
            end: None,
            complete_at_end: None,
        };
        if let Some(ended) = self.ended.as_mut()
            && !ended.awaits(reading, way)
        {
            cut.complete = self.complete(way);
        }
        let is_covered = |begin: &Begin<K>| way.is_covered(begin.reading.stamp, reading.stamp);
        if !self.begin.as_ref().is_some_and(is_covered) {
            let ended = self.restart();
            cut.complete = cut.complete.or(ended);
            self.begin(reading, known());
        } else if self.ended.is_none()
            && let Some(begin) = self
                .begin
                .take_if(|begin| windows_between(&begin.reading, reading, way) >= 1.0)
        {
            self.begin(reading, known());
            self.end(begin, reading, way, &mut cut);
        }
        if self.newest.len() >= PAIRS_MAX {
            self.newest.pop_front();
        }
        self.newest.push_back(*reading);
        cut
    }

    /// Leaves out the window that has ended and is not complete.
    pub fn leave_out_ended(&mut self) {
        self.ended = None;
        self.before = None;
    }

    fn begin(&mut self, reading: &OdometryReading, known: K) {
        self.begin = Some(Begin {
            reading: *reading,
            mean: *reading,
            known,
        });
    }

    /// Ends a window with a reading. Where its pose is surer than the way of the window it is used
    /// as it is; else the poses that follow are awaited.
    fn end(&mut self, begin: Begin<K>, end: &OdometryReading, way: Way<'_>, cut: &mut Cut<K>) {
        let Some(window) = measure(&begin.mean, end, way) else {
            self.before = None;
            return;
        };
        cut.end = Some(WindowEnd {
            lasts: (window.begin, window.end),
            track: window.track,
        });
        if position_variance_m2(&window.end_covariance)
            <= position_variance_m2(&window.motion_covariance)
        {
            let window = self.whiten(window, way.noise_scale);
            cut.complete_at_end = window.map(|window| (window, begin.known));
            return;
        }
        self.ended = Some(Box::new(Ended {
            begin,
            end: *end,
            window,
            before: self.newest.clone(),
            after: Vec::new(),
            noise: *way.noise,
            noise_scale: way.noise_scale,
        }));
    }

    /// Measures the window whose end is known by the mean of the poses around it.
    fn complete(&mut self, way: Way<'_>) -> Option<(Window, K)> {
        let ended = *self.ended.take()?;
        let Ended { begin, end, .. } = &ended;
        let way = Way {
            values: &ended.window.values,
            noise: &ended.noise,
            noise_scale: ended.noise_scale,
            ..way
        };
        // The drive's readings of a long window may be gone by now; its single poses are measured already.
        let is_covered = way.is_covered(begin.reading.stamp, end.stamp);
        let mean = is_covered.then(|| mean_pose(end, &ended.before, &ended.after, way));
        let measured = mean.and_then(|mean| Some((mean, measure(&begin.mean, &mean, way)?)));
        let mut window = ended.window;
        if let Some((mean, by_means)) = measured {
            if let Some(next) = self.begin.as_mut() {
                next.mean = mean;
            }
            // Faults are jumps: a mean would blur them.
            let track = window.track;
            window = Window { track, ..by_means };
        }
        let window = self.whiten(window, ended.noise_scale)?;
        Some((window, ended.begin.known))
    }

    /// Subtracts from a window what the one before has shown of the pose that they share.
    fn whiten(&mut self, mut window: Window, noise_scale: f64) -> Option<Window> {
        if let Some(before) = self.before.take()
            && let Some(new) =
                Innovation::after(window.innovation, &window.carry, &window.values, &before)
        {
            window.innovation = new;
            window.evidence = Evidence::of_window(&new)?;
        }
        self.before = Some(window.clone()).filter(|window| !window.innovation.is_wild(noise_scale));
        Some(window)
    }
}

/// Distance of a reading from another one, in windows.
fn windows_between(from: &OdometryReading, to: &OdometryReading, way: Way<'_>) -> f64 {
    let moved = from.lidar_in_odom.between(&to.lidar_in_odom).wrapped();
    let driven_m = way.driven_m(from.stamp, to.stamp);
    let moved_m = driven_m.max(moved.translation().norm());
    (moved_m / WINDOW_M).max(moved.yaw_rad.abs() / WINDOW_RAD)
}

/// Variance of a position, both directions together, m².
fn position_variance_m2(covariance: &Matrix3<f64>) -> f64 {
    covariance[(0, 0)] + covariance[(1, 1)]
}

/// One sigma of a position along the direction it is known least in, m.
fn largest_sigma_m(covariance: &Matrix3<f64>) -> f64 {
    let position = covariance.fixed_view::<2, 2>(0, 0).into_owned();
    position.symmetric_eigenvalues().max().max(0.0).sqrt()
}

/// Distance of a point from the straight way that leads from the origin to `end`, m.
fn distance_from_way_m(end: Vector2<f64>, point: Vector2<f64>) -> f64 {
    let length2_m2 = end.norm_squared().max(f64::MIN_POSITIVE);
    let part = (end.dot(&point) / length2_m2).clamp(0.0, 1.0);
    (point - end * part).norm()
}

fn measure(begin: &OdometryReading, end: &OdometryReading, way: Way<'_>) -> Option<Window> {
    let Way {
        vehicle,
        values,
        noise,
        ..
    } = way;
    let parameters = drive_parameters(values);
    let mut motion = PredictedMotion::none();
    let mut twist_at_begin = None;
    let (mut least_rad, mut most_rad) = (f64::INFINITY, f64::NEG_INFINITY);
    for segment in way.segments(begin.stamp, end.stamp) {
        least_rad = least_rad.min(segment.drive.steering_rad);
        most_rad = most_rad.max(segment.drive.steering_rad);
        motion.advance(vehicle, &parameters, noise, &segment);
        twist_at_begin.get_or_insert(motion.twist);
    }
    let predicted = LidarMotion::new(&lidar_in_base(values), &motion.end_in_begin);
    let measured = begin.lidar_in_odom.between(&end.lidar_in_odom);
    let twist_at_begin = twist_at_begin.unwrap_or(motion.twist);
    let motion_covariance = predicted.by_body * motion.noise * predicted.by_body.transpose();
    let covariance = motion_covariance
        + predicted.carry * begin.covariance * predicted.carry.transpose()
        + end.covariance;
    let residual = predicted.end_in_begin.between(&measured).log();
    let jacobian = predicted.by_parameters(&motion, &twist_at_begin, noise);
    let mount = lidar_in_base(values);
    let body = mount.compose(&measured).compose(&mount.inverse());
    let turn_by_steering = jacobian[(2, Parameter::SteeringOffset.index())]
        .abs()
        .max(STEERED_MIN);
    let track = Track {
        driven_m: motion.distance_m,
        moved_m: body.translation().norm(),
        steering_rad: least_rad,
        steering_spread_rad: most_rad - least_rad,
        steering_error_rad: residual.z / turn_by_steering,
        steering_sigma_rad: covariance[(2, 2)].sqrt() / turn_by_steering,
        duration_s: end.stamp.seconds_since(begin.stamp),
        off_m: residual.xy().norm(),
        off_way_m: distance_from_way_m(
            predicted.end_in_begin.translation(),
            measured.translation(),
        ),
        odometry_sigma_m: largest_sigma_m(&(covariance - motion_covariance)),
    };
    let innovation = Innovation {
        residual,
        jacobian,
        covariance,
    };
    Some(Window {
        begin: begin.stamp,
        end: end.stamp,
        residual,
        jacobian,
        covariance,
        carry: predicted.carry,
        motion_covariance,
        end_covariance: end.covariance,
        values: *values,
        track,
        innovation,
        evidence: Evidence::of_window(&innovation)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive_history::DriveHistory;
    use crate::geometry::Pose2;
    use crate::stream::DriveSample;
    use crate::vehicle::{Vehicle, VehicleModel};

    const PERIOD_NS: i64 = 50_000_000;
    const BEGIN_NS: i64 = 1_800_000_000_000_000_000;
    /// Distance between poses, m: sixteen make a window.
    const STEP_M: f64 = 0.025;

    fn stamp(number: i64) -> RobotTime {
        RobotTime(BEGIN_NS + number * PERIOD_NS)
    }

    fn at(number: i64, sigma_m: f64) -> OdometryReading {
        OdometryReading {
            stamp: stamp(number),
            lidar_in_odom: Pose2::new(number as f64 * STEP_M, 0.0, 0.0),
            covariance: Matrix3::identity() * (sigma_m * sigma_m),
        }
    }

    /// Cuts so many poses of a straight way; returns the numbers at which windows end, and for each
    /// complete one the numbers of its start, its end and the one that was known at its start.
    fn cut(
        cutter: &mut WindowCutter<i64>,
        poses: i64,
        sigma_m: impl Fn(i64) -> f64,
        leave_out: bool,
    ) -> (Vec<i64>, Vec<[i64; 3]>) {
        let mut values = Values::zeros();
        for one in [Parameter::SpeedScale, Parameter::Wheelbase] {
            values[one.index()] = 1.0;
        }
        let mut drive = DriveHistory::new(60.0);
        for number in 0..=poses {
            let speed_mps = STEP_M / (PERIOD_NS as f64 * 1e-9);
            drive.push(DriveSample::new(stamp(number), speed_mps, 0.0).unwrap());
        }
        let way = Way {
            drive: &drive,
            vehicle: &Vehicle::new(VehicleModel::Bicycle, 1.0),
            values: &values,
            noise: &MotionNoise::default(),
            noise_scale: 1.0,
        };
        let (mut ends, mut windows) = (Vec::new(), Vec::new());
        for number in 0..poses {
            let cut = cutter.push(&at(number, sigma_m(number)), way, || number);
            windows.extend(cut.complete.map(numbers));
            if cut.end.is_some() {
                ends.push(number);
                if leave_out {
                    cutter.leave_out_ended();
                }
            }
            windows.extend(cut.complete_at_end.map(numbers));
        }
        (ends, windows)
    }

    fn numbers((window, known): (Window, i64)) -> [i64; 3] {
        let number = |stamp: RobotTime| (stamp.0 - BEGIN_NS) / PERIOD_NS;
        [number(window.begin), number(window.end), known]
    }

    const NOISY_M: f64 = 0.003;
    const SURE_M: f64 = 1e-4;

    #[test]
    fn every_end_gives_one_window_that_begins_where_the_one_before_ended() {
        let mixed = |number: i64| if number % 50 < 25 { NOISY_M } else { SURE_M };
        let sensors: [&dyn Fn(i64) -> f64; 3] = [&|_| NOISY_M, &|_| SURE_M, &mixed];
        for sigma_m in sensors {
            let mut cutter = WindowCutter::default();
            let (ends, mut windows) = cut(&mut cutter, 400, sigma_m, false);
            // One may still wait for the poses behind its end.
            windows.extend(cutter.restart().map(numbers));
            assert!(ends.len() >= 23, "{ends:?}");
            let begins = std::iter::once(&0).chain(&ends);
            let wanted: Vec<_> = begins
                .zip(&ends)
                .map(|(begin, end)| [*begin, *end, *begin])
                .collect();
            assert_eq!(windows, wanted);
        }
    }

    #[test]
    fn a_window_that_is_left_out_while_it_waits_is_not_given_later() {
        let mut cutter = WindowCutter::default();
        let (ends, windows) = cut(&mut cutter, 400, |_| NOISY_M, true);
        assert!(ends.len() >= 23 && windows.is_empty(), "{windows:?}");
        assert!(cutter.restart().is_none());
    }

    #[test]
    fn the_mean_of_poses_makes_a_window_surer() {
        let mut cutter = WindowCutter::<i64>::default();
        let (ends, _) = cut(&mut cutter, 30, |_| NOISY_M, false);
        let single = cutter.ended.map(|ended| ended.window.end_covariance);
        assert!(single.is_none(), "complete eight poses behind {ends:?}");
        let by_mean = cutter.before.unwrap().end_covariance[(0, 0)];
        assert!(by_mean < NOISY_M * NOISY_M / 8.0, "{by_mean}");
    }
}
