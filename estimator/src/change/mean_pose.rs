//! The mean of the LiDAR's poses around the end of a window.
//!
//! A sensor that sends poses has as much noise in the pose that ends a window as in any other, and there
//! are several for each window. Those around the end are carried there by the wheels and their mean is
//! taken. It is taken of pairs, one before and one after: what wrong parameters do to the way there
//! cancels.

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
/// A pose whose squared distance from the one at the end, normalised, is above this (four sigmas) is not
/// taken in: the LiDAR jumped between them, or the wheels slipped.
const APART_CHI2_MAX: f64 = 16.0;

/// What the wheels and the parameters say of the way between two poses.
#[derive(Debug, Clone, Copy)]
pub struct Way<'a> {
    /// The wheel odometry.
    pub drive: &'a DriveHistory,
    /// The vehicle.
    pub vehicle: &'a Vehicle,
    /// The parameters.
    pub values: &'a Values,
    /// How far a driven metre can go astray, as configured.
    pub noise: &'a MotionNoise,
    /// How much of that this robot really goes astray, as a variance.
    pub noise_scale: f64,
}

impl Way<'_> {
    /// A time of the LiDAR in drive time.
    fn drive_time(&self, stamp: RobotTime) -> RobotTime {
        stamp.plus_seconds(self.values[Parameter::TimeOffset.index()].clamp(-0.25, 0.25))
    }

    /// Whether the drive's readings are there between two times of the LiDAR.
    pub(super) fn is_covered(&self, from: RobotTime, to: RobotTime) -> bool {
        self.drive
            .covers(self.drive_time(from), self.drive_time(to))
    }

    /// How far the wheels went between two times of the LiDAR, m.
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
    /// How far it is from that one, as that one's right perturbation.
    apart: Vector3<f64>,
    /// Covariance of the pose, carried along.
    pose: Matrix3<f64>,
    /// Covariance of the way.
    way: Matrix3<f64>,
}

impl Carried {
    fn of(
        at: &OdometryReading,
        seen: Pose2,
        reading: &OdometryReading,
        carry: Matrix3<f64>,
        way: Matrix3<f64>,
    ) -> Self {
        Self {
            apart: at.lidar_in_odom.between(&seen).log(),
            pose: carry * reading.covariance * carry.transpose(),
            way,
        }
    }

    fn is_near(&self, at: &OdometryReading, noise_scale: f64) -> bool {
        let covariance = at.covariance + self.pose + self.way * noise_scale;
        covariance
            .cholesky()
            .is_some_and(|factor| self.apart.dot(&factor.solve(&self.apart)) <= APART_CHI2_MAX)
    }
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
        let lost = moved.by_body * noise * moved.by_body.transpose();
        Some(Carried::of(at, seen, reading, moved.carry, lost))
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
        let lost = back * moved.by_body * noise * (back * moved.by_body).transpose();
        Some(Carried::of(at, seen, reading, back, lost))
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
    let pairs = carried_from_before(at, before, way).zip(carried_from_after(at, after, way));
    let near = pairs.filter(|(before, after)| {
        before.is_near(at, way.noise_scale) && after.is_near(at, way.noise_scale)
    });
    let mut count = 1.0;
    let mut apart = Vector3::zeros();
    let (mut poses, mut ways) = (at.covariance, Matrix3::zeros());
    for carried in near.flat_map(|(before, after)| [before, after]) {
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
        // third of the mean variance over both.
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
    const SPEED_MPS: f64 = 0.5;
    const SIGMA_M: f64 = 0.003;
    /// Between poses, ns.
    const PERIOD_NS: i64 = 50_000_000;
    const BEGIN_NS: i64 = 1_800_000_000_000_000_000;

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

    /// Two seconds of a circle at 50 Hz.
    fn drive() -> DriveHistory {
        let mut drive = DriveHistory::new(10.0);
        for number in 0..=100 {
            let stamp = RobotTime(BEGIN_NS + number * PERIOD_NS / 2);
            drive.push(DriveSample::new(stamp, SPEED_MPS, STEERING_RAD).unwrap());
        }
        drive
    }

    /// The LiDAR's pose there, off by a draw.
    fn reading(number: i64, random: Option<&mut StdRng>) -> OdometryReading {
        let time_s = (number * PERIOD_NS) as f64 * 1e-9;
        let yaw_rate_radps = SPEED_MPS * STEERING_RAD.tan() / WHEELBASE_M;
        let body = Pose2::exp(&(Vector3::new(SPEED_MPS, 0.0, yaw_rate_radps) * time_s));
        let sigmas = Vector3::new(SIGMA_M, SIGMA_M, 5e-4);
        let off = random.map_or(Vector3::zeros(), |random| {
            sigmas.map(|sigma| sigma * random.sample::<f64, _>(StandardNormal))
        });
        OdometryReading {
            stamp: RobotTime(BEGIN_NS + number * PERIOD_NS),
            lidar_in_odom: body
                .compose(&lidar_in_base(&values()))
                .compose(&Pose2::exp(&off)),
            covariance: Matrix3::from_diagonal(&sigmas.map(|sigma| sigma * sigma)),
        }
    }

    const AT: i64 = 20;

    /// The mean at the middle, of as many poses as are taken in on either side.
    fn mean_of(readings: impl Fn(i64) -> OdometryReading, values: &Values) -> OdometryReading {
        let pairs = PAIRS_MAX as i64;
        let before = (AT - pairs..AT).map(&readings).collect();
        let after: Vec<_> = (AT + 1..=AT + pairs).map(&readings).collect();
        let way = Way {
            drive: &drive(),
            vehicle: &Vehicle::new(VehicleModel::Bicycle, WHEELBASE_M),
            values,
            noise: &MotionNoise::default(),
            noise_scale: 1.0,
        };
        mean_pose(&readings(AT), &before, &after, way)
    }

    fn off(mean: &OdometryReading) -> Vector3<f64> {
        reading(AT, None)
            .lidar_in_odom
            .between(&mean.lidar_in_odom)
            .log()
    }

    #[test]
    fn a_mean_of_seventeen_poses_errs_as_its_covariance_says() {
        const RUNS: u64 = 400;
        let (mut squares, mut variance) = (Vector3::zeros(), Vector3::zeros());
        for seed in 0..RUNS {
            let mut random = StdRng::seed_from_u64(seed);
            let all: Vec<_> = (0..2 * AT)
                .map(|number| reading(number, Some(&mut random)))
                .collect();
            let mean = mean_of(|number| all[number as usize], &values());
            squares += off(&mean).map(|error| error * error) / RUNS as f64;
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
        let mut wrong = values();
        wrong[Parameter::SteeringOffset.index()] = 0.02;
        wrong[Parameter::LidarX.index()] += 0.02;
        let mean = mean_of(|number| reading(number, None), &wrong);
        let single = {
            let way = Way {
                drive: &drive(),
                vehicle: &Vehicle::new(VehicleModel::Bicycle, WHEELBASE_M),
                values: &wrong,
                noise: &MotionNoise::default(),
                noise_scale: 1.0,
            };
            let before = [reading(AT - 8, None)].into();
            let at = reading(AT, None);
            carried_from_before(&at, &before, way).next().unwrap().apart
        };
        assert!(single.norm() > 2e-3, "{single}");
        assert!(off(&mean).norm() < 0.03 * single.norm(), "{}", off(&mean));
    }

    #[test]
    fn poses_beyond_a_jump_are_left_out() {
        let jumped = |number: i64| {
            let mut reading = reading(number, None);
            if number > AT {
                reading.lidar_in_odom = reading.lidar_in_odom.compose(&Pose2::new(0.0, 0.03, 0.0));
            }
            reading
        };
        let mean = mean_of(jumped, &values());
        assert_eq!(mean, reading(AT, None));
    }
}
