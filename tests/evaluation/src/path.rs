//! Path of a robot over time.

use fleetcal_estimator::Vehicle;
use fleetcal_estimator::geometry::Pose2;
use fleetcal_estimator::vehicle::{DriveParameters, DriveReading};
use nalgebra::Vector3;

/// Poses over time, in the order of their stamps.
#[derive(Debug, Clone, Default)]
pub struct Path {
    poses: Vec<(i64, Pose2)>,
}

impl Path {
    /// Adds the newest pose; `stamp_ns` in ns.
    pub fn push(&mut self, stamp_ns: i64, pose: Pose2) {
        self.poses.push((stamp_ns, pose));
    }

    /// Returns the pose at a time, between its neighbours; `None` outside.
    pub fn at(&self, stamp_ns: i64) -> Option<Pose2> {
        let after = self.poses.partition_point(|(stamp, _)| *stamp < stamp_ns);
        let (end_ns, end) = self.poses.get(after)?;
        if *end_ns == stamp_ns {
            return Some(*end);
        }
        let (begin_ns, begin) = self.poses.get(after.checked_sub(1)?)?;
        let share = (stamp_ns - begin_ns) as f64 / (end_ns - begin_ns) as f64;
        let motion = begin.between(end).log();
        Some(begin.compose(&Pose2::exp(&(motion * share))))
    }

    /// Returns the positions, m.
    pub fn points(&self) -> Vec<(f64, f64)> {
        let points = self.poses.iter();
        points.map(|(_, pose)| (pose.x_m, pose.y_m)).collect()
    }
}

/// Dead reckoning by wheels and steering alone, on exact arcs.
#[derive(Debug, Clone)]
pub struct DeadReckoning {
    vehicle: Vehicle,
    parameters: DriveParameters,
    /// Assumed delay of the wheel odometry, ns.
    late_ns: i64,
    at: Option<(i64, Pose2)>,
    /// Path by dead reckoning.
    pub path: Path,
}

impl DeadReckoning {
    /// Makes the dead reckoning, which starts at a pose (of `base`, in the world) with the next
    /// drive reading.
    pub fn new(vehicle: Vehicle, parameters: DriveParameters, late_s: f64) -> Self {
        Self {
            vehicle,
            parameters,
            late_ns: (late_s * 1e9).round() as i64,
            at: None,
            path: Path::default(),
        }
    }

    /// Adds a drive reading, which describes the interval that ends at its stamp. The first one
    /// sets the robot to its true pose.
    pub fn take(&mut self, stamp_ns: i64, reading: DriveReading, truly: &Pose2) {
        let pose = match self.at {
            None => *truly,
            Some((last_ns, last)) => {
                let motion = self.vehicle.motion(reading, &self.parameters);
                let interval_s = (stamp_ns - last_ns) as f64 * 1e-9;
                let twist = Vector3::new(
                    motion.speed_mps,
                    motion.side_speed_mps,
                    motion.yaw_rate_radps,
                );
                last.compose(&Pose2::exp(&(twist * interval_s)))
            }
        };
        self.at = Some((stamp_ns, pose));
        self.path.push(stamp_ns - self.late_ns, pose);
    }
}
