//! The mean of the LiDAR's poses around the end of a window.
//!
//! A sensor that sends poses has as much noise in the pose that ends a window as in any other, and
//! there are several for each window. Those around the end are carried there by the wheels and
//! averaged. They are averaged in pairs, one before and one after by the same motion: the effect of
//! wrong parameters on the way there cancels.

use std::collections::VecDeque;

use nalgebra::{Matrix3, Vector3};

use crate::drive_history::{DriveHistory, DriveSegment};
use crate::estimate::Parameter;
use crate::filter::constraint::LidarMotion;
use crate::filter::prediction::PredictedMotion;
use crate::filter::{OdometryReading, Values, drive_parameters, lidar_in_base, steering_response};
use crate::geometry::Pose2;
use crate::motion_noise::MotionNoise;
use crate::stream::RobotTime;
use crate::vehicle::Vehicle;

/// Most pairs of poses in a mean.
pub(super) const PAIRS_MAX: usize = 8;
/// Squared distance of a pose from the one at the end, normalised, above which (four sigmas) it is
/// not averaged: the LiDAR jumped between them, or the wheels slipped.
const APART_CHI2_MAX: f64 = 16.0;
/// Difference below which two motions are the same, m,
const SAME_WAY_M: f64 = 0.02;
/// and rad: a twentieth of a window.
const SAME_TURN_RAD: f64 = 0.01;

/// Way between two poses, by the wheels and the parameters.
#[derive(Debug, Clone, Copy)]
pub struct Way<'a> {
    /// The wheel odometry.
    pub drive: &'a DriveHistory,
    /// The vehicle.
    pub vehicle: &'a Vehicle,
    /// The parameters.
    pub values: &'a Values,
    /// Noise of a driven metre, as configured.
    pub noise: &'a MotionNoise,
    /// Scale of this robot's noise, of its motion and of its poses, as a variance.
    pub noise_scale: f64,
}

impl Way<'_> {
    /// A time of the LiDAR in drive time.
    fn drive_time(&self, stamp: RobotTime) -> RobotTime {
        stamp.plus_seconds(self.values[Parameter::TimeOffset.index()].clamp(-0.25, 0.25))
    }

    /// True if the drive's readings are there between two times of the LiDAR.
    pub(super) fn is_covered(&self, from: RobotTime, to: RobotTime) -> bool {
        self.drive
            .covers(self.drive_time(from), self.drive_time(to))
    }

    /// Way of the wheels between two times of the LiDAR, m.
    pub(super) fn driven_m(&self, from: RobotTime, to: RobotTime) -> f64 {
        self.drive
            .driven_m(self.drive_time(from), self.drive_time(to))
    }

    /// The drive's readings between two times of the LiDAR.
    pub(super) fn segments(
        &self,
        from: RobotTime,
        to: RobotTime,
    ) -> impl Iterator<Item = DriveSegment> + '_ {
        let response = steering_response(self.values);
        self.drive
            .segments(self.drive_time(from), self.drive_time(to), response)
    }

    /// The body's motion between two times of the LiDAR; none where the drive's readings are missing.
    fn motion(&self, from: RobotTime, to: RobotTime) -> Option<PredictedMotion> {
        let parameters = drive_parameters(self.values);
        self.is_covered(from, to).then(|| {
            let mut motion = PredictedMotion::none();
            for segment in self.segments(from, to) {
                motion.advance(self.vehicle, &parameters, self.noise, &segment);
            }
            motion
        })
    }
}

/// A pose that was carried to the time of another one.
#[derive(Debug, Clone, Copy)]
struct Carried {
    /// The body's motion in between, in the direction of time.
    body: Pose2,
    /// Offset from that one, as a right perturbation of it.
    apart: Vector3<f64>,
    /// Covariance of the pose, carried along.
    pose: Matrix3<f64>,
    /// Covariance of the way.
    way: Matrix3<f64>,
}

impl Carried {
    fn is_near(&self, at: &OdometryReading, noise_scale: f64) -> bool {
        let covariance = (at.covariance + self.pose + self.way) * noise_scale;
        covariance
            .cholesky()
            .is_some_and(|factor| self.apart.dot(&factor.solve(&self.apart)) <= APART_CHI2_MAX)
    }

    fn is_by_the_same_motion(&self, other: &Self) -> bool {
        let (one, other) = (&self.body, &other.body);
        (one.x_m - other.x_m).abs() < SAME_WAY_M
            && (one.yaw_rad - other.yaw_rad).abs() < SAME_TURN_RAD
    }

    /// Extent of the body's motion, in the units of [`Self::is_by_the_same_motion`].
    fn extent(&self) -> f64 {
        (self.body.x_m / SAME_WAY_M).abs() + (self.body.yaw_rad / SAME_TURN_RAD).abs()
    }
}

/// Pairs of poses by the same motion, of two rows that begin with the nearest.
fn pairs(
    before: impl Iterator<Item = Carried>,
    after: impl Iterator<Item = Carried>,
) -> Vec<[Carried; 2]> {
    let (mut before, mut after) = (before.peekable(), after.peekable());
    let mut pairs = Vec::with_capacity(PAIRS_MAX);
    while let (Some(&one), Some(&other)) = (before.peek(), after.peek()) {
        let is_pair = one.is_by_the_same_motion(&other);
        if is_pair {
            pairs.push([one, other]);
        }
        // The one that has moved less finds its like further away.
        let less = one.extent() < other.extent();
        if is_pair || less {
            before.next();
        }
        if is_pair || !less {
            after.next();
        }
    }
    pairs
}

/// Poses before `at`, nearest first, carried forwards to it.
fn carried_from_before<'a>(
    at: &'a OdometryReading,
    before: &'a VecDeque<OdometryReading>,
    way: Way<'a>,
) -> impl Iterator<Item = Carried> + 'a {
    let mount = lidar_in_base(way.values);
    let (mut to, mut body, mut noise) = (at.stamp, Pose2::IDENTITY, Matrix3::zeros());
    before.iter().rev().map_while(move |reading| {
        let step = way.motion(reading.stamp, to)?;
        to = reading.stamp;
        let rest = body.inverse().adjoint();
        noise += rest * step.noise * rest.transpose();
        body = step.end_in_begin.compose(&body);
        let moved = LidarMotion::new(&mount, &body);
        let seen = reading.lidar_in_odom.compose(&moved.end_in_begin);
        Some(Carried {
            body,
            apart: at.lidar_in_odom.between(&seen).log(),
            pose: moved.carry * reading.covariance * moved.carry.transpose(),
            way: moved.by_body * noise * moved.by_body.transpose(),
        })
    })
}

/// Poses after `at`, nearest first, carried back to it.
fn carried_from_after<'a>(
    at: &'a OdometryReading,
    after: &'a [OdometryReading],
    way: Way<'a>,
) -> impl Iterator<Item = Carried> + 'a {
    let mount = lidar_in_base(way.values);
    let (mut from, mut body, mut noise) = (at.stamp, Pose2::IDENTITY, Matrix3::zeros());
    after.iter().map_while(move |reading| {
        let step = way.motion(from, reading.stamp)?;
        from = reading.stamp;
        let over = step.end_in_begin.inverse().adjoint();
        noise = over * noise * over.transpose() + step.noise;
        body = body.compose(&step.end_in_begin);
        let moved = LidarMotion::new(&mount, &body);
        let seen = reading.lidar_in_odom.compose(&moved.end_in_begin.inverse());
        let back = moved.end_in_begin.adjoint();
        let by_body = back * moved.by_body;
        Some(Carried {
            body,
            apart: at.lidar_in_odom.between(&seen).log(),
            pose: back * reading.covariance * back.transpose(),
            way: by_body * noise * by_body.transpose(),
        })
    })
}

/// The mean of `at` and the poses around it, as a reading at the same time. `before` ends with the nearest,
/// `after` begins with it.
pub(super) fn mean_pose(
    at: &OdometryReading,
    before: &VecDeque<OdometryReading>,
    after: &[OdometryReading],
    way: Way<'_>,
) -> OdometryReading {
    let mut pairs = pairs(
        carried_from_before(at, before, way),
        carried_from_after(at, after, way),
    );
    pairs.retain(|pair| pair.iter().all(|one| one.is_near(at, way.noise_scale)));
    let mut count = 1.0;
    let mut apart = Vector3::zeros();
    let (mut poses, mut ways) = (at.covariance, Matrix3::zeros());
    for carried in pairs.iter().flatten() {
        count += 1.0;
        apart += carried.apart;
        poses += carried.pose;
        ways += carried.way;
    }
    OdometryReading {
        stamp: at.stamp,
        lidar_in_odom: at.lidar_in_odom.compose(&Pose2::exp(&(apart / count))),
        // The poses err each on its own. The ways share what the wheels err by: each is a random walk away
        // from `at`, and the mean over a random walk has a third of its end's variance on either side, a
        // third of the mean variance over both. These are errors of the windows' own ways as well; taken
        // for others', they make one window up to half its way's variance less sure, and sums over many no
        // less.
        covariance: poses / (count * count) + ways / (3.0 * count),
    }
}

#[cfg(test)]
mod tests {
    use rand::rngs::StdRng;
    use rand::{Rng, SeedableRng};
    use rand_distr::StandardNormal;

    use super::*;
    use crate::stream::DriveSample;
    use crate::vehicle::VehicleModel;

    const WHEELBASE_M: f64 = 1.2;
    const STEERING_RAD: f64 = 0.2;
    const SIGMA_M: f64 = 0.003;
    /// Time between poses, ns.
    const PERIOD_NS: i64 = 50_000_000;
    const BEGIN_NS: i64 = 1_800_000_000_000_000_000;
    /// The pose that ends the window.
    const AT: i64 = 20;

    fn values() -> Values {
        let mut values = Values::zeros();
        for (parameter, value) in [
            (Parameter::LidarX, 0.4),
            (Parameter::SpeedScale, 1.0),
            (Parameter::Wheelbase, WHEELBASE_M),
            (Parameter::SteeringGain, 1.0),
        ] {
            values[parameter.index()] = value;
        }
        values
    }

    fn wrong_values() -> Values {
        let mut wrong = values();
        wrong[Parameter::SteeringOffset.index()] = 0.02;
        wrong[Parameter::LidarX.index()] += 0.02;
        wrong
    }

    /// A robot on a circle, with its speed before that pose and behind it, m/s.
    #[derive(Clone, Copy)]
    struct Robot(f64, f64);

    const STEADY: Robot = Robot(0.5, 0.5);

    impl Robot {
        /// Drive samples of two seconds at 50 Hz.
        fn drive(self) -> DriveHistory {
            let mut drive = DriveHistory::new(10.0);
            for number in 0..=4 * AT {
                let speed_mps = if number <= 2 * AT { self.0 } else { self.1 };
                let stamp = RobotTime(BEGIN_NS + number * PERIOD_NS / 2);
                drive.push(DriveSample::new(stamp, speed_mps, STEERING_RAD).unwrap());
            }
            drive
        }

        /// The LiDAR's pose there, off by a draw.
        fn reading(self, number: i64, random: Option<&mut StdRng>) -> OdometryReading {
            let seconds = |periods: i64| (periods * PERIOD_NS) as f64 * 1e-9;
            let way_m = self.0 * seconds(number.min(AT)) + self.1 * seconds((number - AT).max(0));
            let arc = Vector3::new(1.0, 0.0, STEERING_RAD.tan() / WHEELBASE_M) * way_m;
            let sigmas = Vector3::new(SIGMA_M, SIGMA_M, 5e-4);
            let off = random.map_or(Vector3::zeros(), |random| {
                sigmas.map(|sigma| sigma * random.sample::<f64, _>(StandardNormal))
            });
            OdometryReading {
                stamp: RobotTime(BEGIN_NS + number * PERIOD_NS),
                lidar_in_odom: Pose2::exp(&arc)
                    .compose(&lidar_in_base(&values()))
                    .compose(&Pose2::exp(&off)),
                covariance: Matrix3::from_diagonal(&sigmas.map(|sigma| sigma * sigma)),
            }
        }

        /// The mean at the pose of the end, of as many poses as are averaged on either side.
        fn mean_of(
            self,
            readings: impl Fn(i64) -> OdometryReading,
            values: &Values,
            noise_scale: f64,
        ) -> OdometryReading {
            let pairs = PAIRS_MAX as i64;
            let before = (AT - pairs..AT).map(&readings).collect();
            let after: Vec<_> = (AT + 1..=AT + pairs).map(&readings).collect();
            let way = Way {
                drive: &self.drive(),
                vehicle: &Vehicle::new(VehicleModel::Bicycle, WHEELBASE_M),
                values,
                noise: &MotionNoise::default(),
                noise_scale,
            };
            mean_pose(&readings(AT), &before, &after, way)
        }

        fn off(self, mean: &OdometryReading) -> Vector3<f64> {
            let right = self.reading(AT, None).lidar_in_odom;
            right.between(&mean.lidar_in_odom).log()
        }
    }

    /// Ratio of a single pose's variance to that of this mean.
    fn gain(mean: &OdometryReading) -> f64 {
        SIGMA_M * SIGMA_M / mean.covariance[(1, 1)]
    }

    #[test]
    fn a_mean_of_seventeen_poses_errs_as_its_covariance_says() {
        const RUNS: u64 = 400;
        let (mut squares, mut variance) = (Vector3::zeros(), Vector3::zeros());
        for seed in 0..RUNS {
            let mut random = StdRng::seed_from_u64(seed);
            let all: Vec<_> = (0..2 * AT)
                .map(|number| STEADY.reading(number, Some(&mut random)))
                .collect();
            let mean = STEADY.mean_of(|number| all[number as usize], &values(), 1.0);
            squares += STEADY.off(&mean).map(|error| error * error) / RUNS as f64;
            variance = mean.covariance.diagonal();
        }
        // Wheels err by nothing here, so that their share of the covariance is left over.
        let ratios = squares.component_div(&variance);
        assert!(
            ratios.iter().all(|ratio| (0.2..1.2).contains(ratio)),
            "{ratios}"
        );
        let single_m2 = SIGMA_M * SIGMA_M;
        assert!(
            squares.x < single_m2 / 12.0 && squares.y < single_m2 / 12.0,
            "{squares}"
        );
    }

    #[test]
    fn wrong_parameters_do_not_move_the_mean() {
        // At a steady speed, in braking, in starting, in turning back, and at a stop.
        for robot in [
            STEADY,
            Robot(1.0, 0.1),
            Robot(0.1, 1.0),
            Robot(0.5, -0.5),
            Robot(1.0, 0.0),
        ] {
            let mean = robot.mean_of(|number| robot.reading(number, None), &wrong_values(), 1.0);
            let off = robot.off(&mean);
            // What is left of a degree and more: by less than a pair's two ways may differ.
            assert!(
                off.xy().norm() < 1e-4 && off.z.abs() < 2e-4,
                "{} m/s, then {}: {off}",
                robot.0,
                robot.1
            );
        }
        // 0.2 m of way alone carry a pose by as much:
        let way = Way {
            drive: &STEADY.drive(),
            vehicle: &Vehicle::new(VehicleModel::Bicycle, WHEELBASE_M),
            values: &wrong_values(),
            noise: &MotionNoise::default(),
            noise_scale: 1.0,
        };
        let before = [STEADY.reading(AT - 8, None)].into();
        let at = STEADY.reading(AT, None);
        let single = carried_from_before(&at, &before, way).next().unwrap();
        assert!(single.apart.norm() > 2e-3, "{}", single.apart);
    }

    #[test]
    fn poses_beyond_a_jump_are_left_out_and_those_before_it_are_not() {
        let jumped = |from: i64| {
            move |number: i64| {
                let mut reading = STEADY.reading(number, None);
                if number >= from {
                    let pose = reading.lidar_in_odom;
                    reading.lidar_in_odom = pose.compose(&Pose2::new(0.0, 0.03, 0.0));
                }
                reading
            }
        };
        let at_once = STEADY.mean_of(jumped(AT + 1), &values(), 1.0);
        assert_eq!(at_once, STEADY.reading(AT, None));
        let later = STEADY.mean_of(jumped(AT + 5), &values(), 1.0);
        assert!((8.0..9.0).contains(&gain(&later)), "{}", gain(&later));
        assert!(STEADY.off(&later).norm() < 1e-9, "{}", STEADY.off(&later));
    }

    #[test]
    fn a_sensor_with_more_noise_than_it_says_is_averaged_all_the_same() {
        // Three times the noise that is told: nine times, as a variance.
        let mut random = StdRng::seed_from_u64(1);
        let all: Vec<_> = (0..2 * AT)
            .map(|number| {
                let noisy = STEADY.reading(number, Some(&mut random));
                let right = STEADY.reading(number, None).lidar_in_odom;
                let off = 3.0 * right.between(&noisy.lidar_in_odom).log();
                OdometryReading {
                    lidar_in_odom: right.compose(&Pose2::exp(&off)),
                    ..noisy
                }
            })
            .collect();
        let mean = STEADY.mean_of(|number| all[number as usize], &values(), 9.0);
        assert!(gain(&mean) > 12.0, "{}", gain(&mean));
    }
}
