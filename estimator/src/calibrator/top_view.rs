//! The top view of a robot, for people: its surroundings, and its way so far.

use nalgebra::Vector3;

use super::Calibrator;
use crate::drive_history::DriveSegment;
use crate::estimate::Parameter;
use crate::filter::{OdometryReading, Values, drive_parameters, lidar_in_base};
use crate::geometry::Pose2;
use crate::lidar_odometry::Surroundings;
use crate::settings::Freedom;
use crate::stream::RobotTime;
use crate::vehicle::{DriveParameters, SteeringCurve, SteeringResponse, Vehicle};

/// Limits of a requested top view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TopViewLimits {
    /// Surfaces at most this far from the LiDAR, m.
    pub reach_m: f64,
    /// Most points of surfaces.
    pub surfaces_max: usize,
    /// Length of the trajectories, m by the wheels.
    pub trajectory_m: f64,
    /// Most points of them.
    pub trajectory_points_max: usize,
}

/// The top view of a robot, in the LiDAR's odometry frame.
#[derive(Debug, Clone, PartialEq)]
pub struct TopView {
    /// Time of the latest scan or pose.
    pub stamp: RobotTime,
    /// The LiDAR's pose then.
    pub lidar_in_odom: Pose2,
    /// The latest scan on the local map; `None` for a robot that sends poses.
    pub surroundings: Option<Surroundings>,
    /// The LiDAR's pose on the vehicle as it is estimated; `None` before the first guess.
    pub lidar_in_base: Option<Pose2>,
    /// Way of the rear axle so far, oldest first; empty before the first guess.
    pub trajectory: Vec<TrajectoryPoint>,
    /// Length of the trajectory, m by the wheels.
    pub distance_m: f64,
}

/// The rear axle at one time. The trajectories of the two steerings begin at the LiDAR's pose and
/// are nothing but speed and steering from there. They differ in steering offset and gain alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrajectoryPoint {
    /// The time, of the LiDAR.
    pub stamp: RobotTime,
    /// Pose by LiDAR odometry and the estimated mount.
    pub by_lidar: Pose2,
    /// Pose by the measured steering.
    pub by_raw_steering: Pose2,
    /// Pose by the steering less its estimated offset.
    pub by_corrected_steering: Pose2,
}

impl Calibrator {
    /// The top view of now; `None` before the first scan or pose.
    pub fn top_view(&self, limits: &TopViewLimits) -> Option<TopView> {
        let odometry = &self.lidar_odometry;
        let surroundings = odometry.surroundings(limits.reach_m, limits.surfaces_max);
        let last = self.readings.back();
        let (stamp, lidar_in_odom) = match &surroundings {
            Some(seen) => (seen.stamp, seen.lidar_in_odom),
            None => last.map(|last| (last.stamp, last.lidar_in_odom))?,
        };
        let values = self.told_values();
        let (distance_m, mut trajectory) = values
            .map(|values| self.trajectory(values, limits.trajectory_m))
            .unwrap_or_default();
        thin_out(&mut trajectory, limits.trajectory_points_max);
        Some(TopView {
            stamp,
            lidar_in_odom,
            surroundings,
            lidar_in_base: values.map(lidar_in_base),
            trajectory,
            distance_m,
        })
    }

    /// The values of a published estimate; `None` while it only has its prior.
    fn told_values(&self) -> Option<&Values> {
        match self.held() {
            Some(held) => Some(&held.values),
            None => self.filter().map(super::Filter::values),
        }
    }

    /// The trajectories, and their length.
    fn trajectory(&self, values: &Values, length_m: f64) -> (f64, Vec<TrajectoryPoint>) {
        let (distance_m, intervals) = self.last_stretch(values, length_m);
        let base_from_lidar = lidar_in_base(values).inverse();
        let at = |reading: &OdometryReading| TrajectoryPoint::at(reading, &base_from_lidar);
        let Some(mut point) = intervals.last().map(|interval| at(interval.before)) else {
            return (0.0, Vec::new());
        };
        // What a robot can correct: the steering's curve, response and play are no part of a calibration.
        let mut corrected = DriveParameters {
            curve: SteeringCurve::default(),
            response: SteeringResponse::default(),
            half_play_rad: 0.0,
            ..drive_parameters(values)
        };
        let settings = &self.config.settings;
        if settings.freedom(Parameter::SteeringGain) == Freedom::Off {
            corrected.steering_gain = 1.0;
        }
        let raw = DriveParameters {
            steering_offset_rad: 0.0,
            steering_gain: 1.0,
            ..corrected
        };
        let vehicle = &self.config.vehicle;
        let mut points = vec![point];
        for interval in intervals.iter().rev() {
            for segment in self
                .drive
                .segments(interval.from, interval.to, raw.response)
            {
                let on = |pose: Pose2, by| pose.compose(&driven(vehicle, by, &segment));
                point.by_raw_steering = on(point.by_raw_steering, &raw);
                point.by_corrected_steering = on(point.by_corrected_steering, &corrected);
            }
            let TrajectoryPoint {
                stamp, by_lidar, ..
            } = at(interval.reading);
            point = TrajectoryPoint {
                stamp,
                by_lidar,
                ..point
            };
            points.push(point);
        }
        (distance_m, points)
    }

    /// Intervals from reading to reading over the last stretch without a gap, the newest first,
    /// until `length_m` is reached; and their length.
    fn last_stretch(&self, values: &Values, length_m: f64) -> (f64, Vec<Interval<'_>>) {
        let limit_s = self.config.settings.time_offset_max_s;
        let offset_s = values[Parameter::TimeOffset.index()].clamp(-limit_s, limit_s);
        let mut intervals = Vec::new();
        let mut distance_m = 0.0;
        let newest_first = || self.readings.iter().rev();
        for (reading, before) in newest_first().zip(newest_first().skip(1)) {
            let from = before.stamp.plus_seconds(offset_s);
            let to = reading.stamp.plus_seconds(offset_s);
            if distance_m >= length_m {
                break;
            }
            if self.drive.covers(from, to) {
                let segments = self.drive.segments(from, to, SteeringResponse::default());
                distance_m += segments
                    .map(|segment| segment.drive.speed_mps.abs() * segment.duration_s)
                    .sum::<f64>();
                intervals.push(Interval {
                    before,
                    reading,
                    from,
                    to,
                });
            } else if !intervals.is_empty() {
                break;
            }
        }
        (distance_m, intervals)
    }
}

/// Two readings, and the drive time between them.
struct Interval<'a> {
    before: &'a OdometryReading,
    reading: &'a OdometryReading,
    from: RobotTime,
    to: RobotTime,
}

impl TrajectoryPoint {
    /// Begins all trajectories at a reading.
    fn at(reading: &OdometryReading, base_from_lidar: &Pose2) -> Self {
        let base_in_odom = reading.lidar_in_odom.compose(base_from_lidar);
        Self {
            stamp: reading.stamp,
            by_lidar: base_in_odom,
            by_raw_steering: base_in_odom,
            by_corrected_steering: base_in_odom,
        }
    }
}

/// The arc that the rear axle drives over one reading.
fn driven(vehicle: &Vehicle, parameters: &DriveParameters, segment: &DriveSegment) -> Pose2 {
    let motion = vehicle.motion(segment.drive, parameters);
    let twist = Vector3::new(
        motion.speed_mps,
        motion.side_speed_mps,
        motion.yaw_rate_radps,
    );
    Pose2::exp(&(twist * segment.duration_s))
}

/// Leaves at most `max` points, evenly spread: the oldest, where all trajectories begin, and the
/// newest stay.
fn thin_out(points: &mut Vec<TrajectoryPoint>, max: usize) {
    let newest = points.len().saturating_sub(1);
    let stride = newest.div_ceil(max.saturating_sub(1).max(1)).max(1);
    let mut index = 0;
    points.retain(|_| {
        let keeps = index == 0 || (newest - index).is_multiple_of(stride);
        index += 1;
        keeps
    });
}
